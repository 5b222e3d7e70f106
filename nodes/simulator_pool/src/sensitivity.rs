//! How an episode's track changes with parameters and effects.
//!
//! Beside the episode's stage stands one for each parameter, on which the parameter is changed by a millionth or less. Their
//! beams go in step with the episode's ([`Beam::advance_with`]); arm, camera and everything else run as they are. A track
//! and its derivatives by k parameters cost about as much as 1.5 + 0.8 k tracks, where central differences take 2 k.
//!
//! They are as good as the track's own time steps are solved: at the tolerance of `standard`, contact and friction between
//! strands leave some thousandths at the median, and more where an object snaps over ([`BeamSimulator::with_tolerance`]).
//!
//! [`BeamSimulator::with_tolerance`]: crate::BeamSimulator::with_tolerance

use crate::beam::{Beam, GripState};
use crate::episode::{self, Conditions, Stage};
use crate::parameters::known;
use catenary_core::simulator::{Drive, FrameDerivative, StartShape, TrackSensitivities};
use catenary_core::track::End;
use catenary_core::{Frame, GripPose, Track};

/// Change of a parameter, as a share of its value or of the greatest magnitude that its prior holds, whichever is larger. A
/// larger one meets the bends of the forces, a smaller one rounding. Friction bends within micrometres, on a table; a beam
/// without one, within a fraction of an element.
const SHARE_ON_TABLE: f64 = 1e-8;
const SHARE_IN_AIR: f64 = 1e-6;

/// How one parameter is changed.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Change<'a> {
    name: &'a str,
    value: f64,
    /// The changed value less the value.
    by: f64,
}

/// Runs the episode of `conditions` on the first stage and differentiates it by the parameters `names`, for each of which
/// there is one more stage. Stages and model must be the same but for what was on them.
pub fn differentiate(
    stages: &mut [Stage],
    conditions: &Conditions<'_>,
    drive: &Drive,
    start: &StartShape,
    frame_times_s: &[f64],
    names: &[&str],
) -> Result<TrackSensitivities, String> {
    assert!(stages.len() == 1 + names.len(), "one stage for the track, and one a parameter");
    let (first, others) = stages.split_at_mut(1);
    let first = &mut first[0];
    first.prepare(conditions).map_err(|e| e.to_string())?;
    let mut changes = names.iter().map(|n| small_change(first, conditions, n)).collect::<Result<Vec<_>, _>>()?;
    let mut alone: Vec<Option<Track>> = Vec::new();
    let mut together: Vec<&mut Stage> = Vec::new();
    for (change, stage) in changes.iter_mut().zip(others) {
        prepare_changed(stage, conditions, change)?;
        if stage.beam().is_neighbour_of(first.beam()) {
            together.push(stage);
            alone.push(None);
        } else {
            *change = large_change(first, *change)?;
            prepare_changed(stage, conditions, change)?;
            alone.push(Some(episode::run(stage, drive, start, frame_times_s, &episode::whole)?));
        }
    }
    let mut group = Group { first, others: together };
    let mut tracks = group.run(drive, start, frame_times_s)?.into_iter();
    if group.stages().any(|stage| stage.beam().counters().unconverged_equilibria > 0) {
        return Err("the object did not come to rest at the start, so that its track has no derivatives".into());
    }
    let track = tracks.next().expect("the first stage's track comes first");
    let mut derivatives = Vec::new();
    for (change, alone) in changes.iter().zip(alone) {
        let changed = alone.or_else(|| tracks.next()).expect("each stage has its track");
        derivatives.push(difference(&track, &changed, change.by));
    }
    Ok(TrackSensitivities { track, derivatives, changes: changes.iter().map(|c| c.by).collect() })
}

/// A change so small that the track changes in proportion to it.
fn small_change<'a>(stage: &Stage, conditions: &Conditions<'_>, name: &'a str) -> Result<Change<'a>, String> {
    let values = stage.values(conditions).map_err(|e| e.to_string())?;
    let (_, range) = known(stage.registry(), name).map_err(|e| e.to_string())?;
    let value =
        values.value(name).ok_or_else(|| format!("parameter `{name}`: expected a value in the model, got none"))?;
    let [low, high] = greatest_span(stage, name).unwrap_or([value; 2]);
    let share = if stage.world().beam.table.is_some() { SHARE_ON_TABLE } else { SHARE_IN_AIR };
    let size = share * value.abs().max(low.abs()).max(high.abs());
    if size == 0.0 {
        return Err(format!("parameter `{name}`: expected a prior, or a value that is not 0, to differentiate by it"));
    }
    // Rounded, so that the difference of the values is exactly this.
    let by = if value + size > range[1] { value - size } else { value + size } - value;
    Ok(Change { name, value, by })
}

/// A change for which the mesh may be another: as large as the effect is likely to be.
fn large_change<'a>(stage: &Stage, change: Change<'a>) -> Result<Change<'a>, String> {
    let [low, high] = greatest_span(stage, change.name)
        .ok_or_else(|| format!("parameter `{}`: expected a prior, to differentiate by it", change.name))?;
    let size = 0.5 * (low + high) - change.value;
    let by = if size == 0.0 { 0.25 * (high - low) } else { size };
    Ok(Change { by, ..change })
}

/// Least and greatest value that the model's prior, or else the effect's own, holds.
fn greatest_span(stage: &Stage, name: &str) -> Option<[f64; 2]> {
    let model = stage.model();
    let inferred = model.theta.parameters().iter().find(|p| p.name == name).map(|p| p.prior.clone());
    let drawn = || model.effects.iter().find(|e| e.name == name).map(|e| e.distribution.clone());
    let own = || stage.registry().find(name).map(|e| e.about().prior);
    inferred.or_else(drawn).or_else(own).map(|p| p.bounds().into())
}

fn prepare_changed(stage: &mut Stage, conditions: &Conditions<'_>, change: &Change<'_>) -> Result<(), String> {
    let mut effects = conditions.effects.to_vec();
    effects.push((change.name.to_owned(), change.value + change.by));
    stage.prepare(&Conditions { effects: &effects, ..*conditions }).map_err(|e| e.to_string())
}

fn difference(track: &Track, changed: &Track, by: f64) -> Vec<FrameDerivative> {
    let slope = |from: f64, to: f64| (to - from) / by;
    let of_frame = |(a, b): (&Frame, &Frame)| FrameDerivative {
        dlo: std::array::from_fn(|k| [0, 1].map(|i| slope(a.dlo[k][i], b.dlo[k][i]))),
        target: [0, 1].map(|i| slope(a.target[i], b.target[i])),
        eef: [0, 1, 2].map(|i| slope(a.eef[i], b.eef[i])),
    };
    track.frames.iter().zip(&changed.frames).map(of_frame).collect()
}

/// Stages whose beams go in step.
struct Group<'a> {
    first: &'a mut Stage,
    others: Vec<&'a mut Stage>,
}

impl Group<'_> {
    fn stages(&mut self) -> impl Iterator<Item = &mut Stage> {
        std::iter::once(&mut *self.first).chain(self.others.iter_mut().map(|s| &mut **s))
    }

    /// The tracks of all stages, in order.
    fn run(&mut self, drive: &Drive, start: &StartShape, frame_times_s: &[f64]) -> Result<Vec<Track>, String> {
        let frames = match drive {
            Drive::Grip(path) => {
                self.stages().for_each(|stage| stage.start_on(path, start));
                let mut frames = vec![Vec::new(); 1 + self.others.len()];
                for &time_s in frame_times_s {
                    self.advance(time_s, |_, t| path.at(t));
                    for (stage, frames) in self.stages().zip(&mut frames) {
                        frames.push(stage.frame(time_s, path.at(time_s)));
                    }
                }
                frames
            }
            Drive::Actions(actions) => self.act(actions)?,
            Drive::Policy(_) => return Err("drive: expected a path of the grip or actions, got a policy".into()),
        };
        Ok(frames.into_iter().map(|frames| Track { frames, end: End::Complete }).collect())
    }

    /// Frames of all stages, whose arms execute the actions.
    fn act(&mut self, actions: &[[f64; 2]]) -> Result<Vec<Vec<Frame>>, String> {
        let model = self.first.model();
        let task = model.task.ok_or_else(|| format!("model `{}`: actions need a task", model.name))?;
        let start = model.arm.start;
        let mut arms: Vec<_> = self.stages().map(|stage| stage.arm([start.x_m, start.z_m])).collect();
        self.stages().for_each(|stage| stage.hang(start));
        let mut frames = vec![Vec::new(); arms.len()];
        for step in 0..=actions.len() {
            let time_s = step as f64 * task.step_period_s;
            arms.iter_mut().for_each(|arm| arm.run_to(time_s));
            let pose = |arm: usize, t: f64| arms[arm].grip(t, start.pitch_rad);
            self.advance(time_s, pose);
            let action = actions.get(step).copied();
            for (i, (stage, frames)) in self.stages().zip(&mut frames).enumerate() {
                let frame = stage.frame(time_s, pose(i, time_s));
                frames.push(Frame { action: action.unwrap_or_default(), ..frame });
            }
            if let Some(delta) = action {
                arms.iter_mut().for_each(|arm| arm.set_delta(time_s, delta));
            }
        }
        Ok(frames)
    }

    /// Moves all stages on to `time_s`; `pose` says where the grip of each is.
    fn advance(&mut self, time_s: f64, pose: impl Fn(usize, f64) -> GripPose) {
        if self.stages().any(|stage| stage.eye().has_memory()) {
            let step_s = self.first.beam().discretisation().time_step_s;
            loop {
                let next_s = self.first.beam().time_s() + step_s;
                if next_s >= time_s {
                    break;
                }
                self.advance_beams(next_s, &pose);
                self.stages().for_each(|stage| stage.remember(stage.beam().time_s()));
            }
        }
        self.advance_beams(time_s, &pose);
    }

    fn advance_beams(&mut self, time_s: f64, pose: impl Fn(usize, f64) -> GripPose) {
        let angles: Vec<f64> = self.stages().map(|stage| stage.world().grip_angle_rad).collect();
        let grip = |stage: usize, t: f64| GripState::from_pose(pose(stage, t), angles[stage]);
        let mut others: Vec<&mut Beam> = self.others.iter_mut().map(|stage| stage.beam_mut()).collect();
        self.first.beam_mut().advance_with(&mut others, time_s, grip);
    }
}

#[cfg(test)]
mod tests {
    use crate::BeamSimulator;
    use crate::parameters::tests::{cable, soft_bar};
    use catenary_core::mlp::Layer;
    use catenary_core::simulator::{DifferentiableSimulator, Drive, StartShape};
    use catenary_core::{DeltaAnchor, Fidelity, GripPose, GripTrajectory, Mlp, Policy, SimulationRequest, Simulator};

    fn request() -> SimulationRequest {
        SimulationRequest {
            thetas: vec![vec![0.22, 2e4], vec![0.25, 1e4]],
            effects: Vec::new(),
            drive: Drive::Actions(vec![[0.03, -0.04], [-0.02, 0.01]]),
            start: StartShape::HangingAtRest,
            frame_times_s: Vec::new(),
            target_m: None,
            fidelity: Fidelity::Fast,
            seed: 5,
            first_episode: 0,
            noise: true,
        }
    }

    #[test]
    fn tracks_stay_as_they_are_and_the_number_of_workers_changes_no_bit() {
        let names = ["length_m", "frame_delay_s", "grip_compliance_rad_n_m"];
        let simulator = |workers| BeamSimulator::new(&soft_bar(), workers).unwrap();
        let found = |workers| simulator(workers).sensitivities(&request(), &names).unwrap();
        let one = found(1);
        assert_eq!(one.iter().map(|s| s.track.clone()).collect::<Vec<_>>(), simulator(1).simulate(&request()).unwrap());
        assert_eq!(one, found(2));
        assert_eq!(one, found(8));
        assert!(one.iter().all(|s| s.derivatives.len() == 3 && s.derivatives[0].len() == s.track.frames.len()));
    }

    #[test]
    fn a_changed_mesh_gives_the_mean_slope_up_to_a_likely_magnitude() {
        let simulator = BeamSimulator::new(&soft_bar(), 1).unwrap();
        let mut request = request();
        let found = simulator.sensitivities(&request, &["overhang_m"]).unwrap().remove(1);
        let change = found.changes[0];
        request.effects = vec![("overhang_m".into(), vec![change; 2])];
        let changed = simulator.simulate(&request).unwrap().remove(1);
        let (before, after) = (found.track.frames[2].dlo[3][1], changed.frames[2].dlo[3][1]);
        assert!(change > 1e-3 && (found.derivatives[0][2].dlo[3][1] * change - (after - before)).abs() < 1e-12);
    }

    #[test]
    fn a_measured_start_is_differentiated_too() {
        let path = |t: f64| GripPose { x_m: 0.4, z_m: 1.3 + 0.1 * t, pitch_rad: 0.0 };
        let times_s: Vec<f64> = (0..=100).map(|i| 0.01 * f64::from(i)).collect();
        let poses = times_s.iter().map(|t| path(*t)).collect();
        let theta = vec![0.1, 0.02, -1.5, 0.5, 0.05];
        let start = StartShape::Measured {
            points_m: [[0.41, 1.2], [0.44, 1.0], [0.46, 0.8], [0.47, 0.62]],
            velocities_m_s: [[0.0, 0.1], [0.02, 0.1], [0.04, 0.1], [0.06, 0.1]],
        };
        let request = SimulationRequest {
            thetas: vec![theta],
            drive: Drive::Grip(GripTrajectory::new(times_s.clone(), poses).unwrap()),
            start,
            frame_times_s: vec![0.0, 0.3, 0.9],
            noise: false,
            ..request()
        };
        let simulator = BeamSimulator::new(&cable(), 1).unwrap().with_tolerance(1e-12);
        let name = cable().theta.parameters()[0].name.clone();
        let found = simulator.sensitivities(&request, &[&name]).unwrap().remove(0);
        let at = |value: f64| {
            let mut request = request.clone();
            request.thetas[0][0] = value;
            simulator.simulate(&request).unwrap().remove(0)
        };
        let (before, after) = (at(0.1 - 1e-5), at(0.1 + 1e-5));
        for (frame, derivative) in found.derivatives[0].iter().enumerate() {
            let difference = (after.frames[frame].dlo[3][0] - before.frames[frame].dlo[3][0]) / 2e-5;
            let found = derivative.dlo[3][0];
            assert!((found - difference).abs() < 1e-3 * difference.abs(), "frame {frame}: {found}, {difference}");
        }
    }

    #[test]
    fn what_cannot_be_differentiated_is_refused_by_name() {
        let simulator = BeamSimulator::new(&soft_bar(), 1).unwrap();
        let message = |request: &SimulationRequest, name: &str| {
            simulator.sensitivities(request, &[name]).unwrap_err().to_string()
        };
        assert!(message(&request(), "youngs_modulus").contains("`youngs_modulus`"));
        assert!(message(&request(), "slip_moment_n_m").contains("slip_moment_n_m"));
        let falling = SimulationRequest { thetas: vec![vec![10.0, 1.0]], ..request() };
        assert!(message(&falling, "length_m").contains("did not come to rest"));
        assert!(message(&SimulationRequest { thetas: Vec::new(), ..request() }, "length").contains("`length`"));
        let layer = Layer { inputs: 12, outputs: 2, weight: vec![0.0; 24], bias: vec![0.0; 2] };
        let policy = Policy {
            name: "still".into(),
            actor: Mlp::new(vec![layer]).unwrap(),
            observation_mean: [0.0; 12],
            observation_scale: [1.0; 12],
            action_scale: [0.1; 2],
            step_period_s: 0.5,
            delta_anchor: DeltaAnchor::LastTarget,
            steps: 16,
        };
        let drive = Drive::Policy(Box::new(policy));
        assert!(message(&SimulationRequest { drive, ..request() }, "length_m").contains("policy"));
    }
}
