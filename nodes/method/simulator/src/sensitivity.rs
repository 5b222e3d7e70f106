//! Sensitivities: derivatives of an episode's track by parameters and effects.
//!
//! Each parameter has a simulation of its own, in which the parameter is changed by a millionth or less. The beams of
//! all simulations are stepped together ([`Beam::advance_with`]); arm, camera and everything else run as in any
//! episode. A track and its derivatives by k parameters cost about as much as 1.5 + 0.8 k tracks. Central differences
//! cost 2 k tracks.
//!
//! Accuracy is limited by the solution of the track's own time steps. At the tolerance of `standard`, contact and
//! friction between strands leave an error of some thousandths at the median, and more if an object snaps over.
//! [`BeamSimulator::with_tolerance`] reduces it.
//!
//! [`BeamSimulator::with_tolerance`]: crate::BeamSimulator::with_tolerance
use crate::beam::{Beam, GripState};
use crate::episode::{self, Conditions, EpisodeSimulation};
use crate::parameters::known;
use catenary_core::simulator::{Drive, FrameDerivative, StartShape, TrackSensitivities};
use catenary_core::track::End;
use catenary_core::{Frame, GripPose, Track};

/// Change of a parameter, as a share of its value or of the largest magnitude in its prior, whichever is larger.
// A larger change meets the bends of the forces, a smaller one rounding. Friction on a table bends within micrometres;
// a beam in the air within a fraction of an element.
const SHARE_ON_TABLE: f64 = 1e-8;
const SHARE_IN_AIR: f64 = 1e-6;

/// Change of one parameter.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Change<'a> {
    name: &'a str,
    value: f64,
    /// Changed value less the value.
    by: f64,
}

/// Runs the episode of `conditions` on the first simulation, and differentiates it by the parameters `names`.
/// `simulations` holds one simulation for the track and one per name, all of one model.
///
/// # Errors
/// A message naming the parameter, or the reason why the track has no derivatives.
pub fn differentiate(
    simulations: &mut [EpisodeSimulation],
    conditions: &Conditions<'_>,
    drive: &Drive,
    start: &StartShape,
    frame_times_s: &[f64],
    names: &[&str],
) -> Result<TrackSensitivities, String> {
    assert!(simulations.len() == 1 + names.len(), "one simulation for the track, and one per parameter");
    let (first, others) = simulations.split_at_mut(1);
    let first = &mut first[0];
    first.prepare(conditions).map_err(|e| e.to_string())?;
    let mut changes = names.iter().map(|n| small_change(first, conditions, n)).collect::<Result<Vec<_>, _>>()?;
    let mut alone: Vec<Option<Track>> = Vec::new();
    let mut together: Vec<&mut EpisodeSimulation> = Vec::new();
    for (change, simulation) in changes.iter_mut().zip(others) {
        prepare_changed(simulation, conditions, change)?;
        // Another mesh cannot be stepped together: its track is simulated alone, over a change large against the
        // tolerance.
        if simulation.beam().is_neighbour_of(first.beam()) {
            together.push(simulation);
            alone.push(None);
        } else {
            *change = large_change(first, *change)?;
            prepare_changed(simulation, conditions, change)?;
            alone.push(Some(episode::run(simulation, drive, start, frame_times_s, &episode::never_stop)?));
        }
    }
    let mut group = LockstepGroup { first, others: together };
    let mut tracks = group.run(drive, start, frame_times_s)?.into_iter();
    // A start that still moves has no shape to differentiate.
    if group.simulations().any(|simulation| simulation.beam().counters().unconverged_equilibria > 0) {
        return Err("the object did not come to rest at the start, so that its track has no derivatives".into());
    }
    let track = tracks.next().expect("the first simulation's track comes first");
    let mut derivatives = Vec::new();
    for (change, alone) in changes.iter().zip(alone) {
        let changed = alone.or_else(|| tracks.next()).expect("each simulation has its track");
        derivatives.push(difference(&track, &changed, change.by));
    }
    Ok(TrackSensitivities { track, derivatives, changes: changes.iter().map(|c| c.by).collect() })
}

/// Returns a change so small that the track responds in proportion.
fn small_change<'a>(
    simulation: &EpisodeSimulation,
    conditions: &Conditions<'_>,
    name: &'a str,
) -> Result<Change<'a>, String> {
    let values = simulation.values(conditions).map_err(|e| e.to_string())?;
    let (_, range) = known(simulation.registry(), name).map_err(|e| e.to_string())?;
    let value =
        values.value(name).ok_or_else(|| format!("parameter `{name}`: expected a value in the model, got none"))?;
    let [low, high] = greatest_span(simulation, name).unwrap_or([value; 2]);
    let share = if simulation.episode_model().beam.table.is_some() { SHARE_ON_TABLE } else { SHARE_IN_AIR };
    let size = share * value.abs().max(low.abs()).max(high.abs());
    if size == 0.0 {
        return Err(format!("parameter `{name}`: expected a prior, or a value that is not 0, to differentiate by it"));
    }
    // Rounded, so that the difference of the two values is exactly `by`.
    let by = if value + size > range[1] { value - size } else { value + size } - value;
    Ok(Change { name, value, by })
}

/// Returns a change as large as the effect is likely to be, for parameters that change the mesh.
fn large_change<'a>(simulation: &EpisodeSimulation, change: Change<'a>) -> Result<Change<'a>, String> {
    let [low, high] = greatest_span(simulation, change.name)
        .ok_or_else(|| format!("parameter `{}`: expected a prior, to differentiate by it", change.name))?;
    let size = 0.5 * (low + high) - change.value;
    let by = if size == 0.0 { 0.25 * (high - low) } else { size };
    Ok(Change { by, ..change })
}

/// Returns the bounds of the model's prior, or of the effect's own.
fn greatest_span(simulation: &EpisodeSimulation, name: &str) -> Option<[f64; 2]> {
    let model = simulation.model();
    let inferred = model.theta.parameters().iter().find(|p| p.name == name).map(|p| p.prior.clone());
    let drawn = || model.effects.iter().find(|e| e.name == name).map(|e| e.distribution.clone());
    let own = || simulation.registry().find(name).map(|e| e.about().prior);
    inferred.or_else(drawn).or_else(own).map(|p| p.bounds().into())
}

fn prepare_changed(
    simulation: &mut EpisodeSimulation,
    conditions: &Conditions<'_>,
    change: &Change<'_>,
) -> Result<(), String> {
    let mut effects = conditions.effects.to_vec();
    effects.push((change.name.to_owned(), change.value + change.by));
    simulation.prepare(&Conditions { effects: &effects, ..*conditions }).map_err(|e| e.to_string())
}

fn difference(track: &Track, changed: &Track, by: f64) -> Vec<FrameDerivative> {
    let slope = |from: f64, to: f64| (to - from) / by;
    let of_frame = |(a, b): (&Frame, &Frame)| FrameDerivative {
        dlo: std::array::from_fn(|k| [0, 1].map(|i| slope(a.dlo[k][i], b.dlo[k][i]))),
        target: [0, 1].map(|i| slope(a.target[i], b.target[i])),
        eef: [0, 1, 2].map(|i| slope(a.eef[i], b.eef[i])),
        wrench: a.wrench.zip(b.wrench).map_or([0.0; 3], |(a, b)| [0, 1, 2].map(|i| slope(a[i], b[i]))),
    };
    track.frames.iter().zip(&changed.frames).map(of_frame).collect()
}

/// Simulations whose beams are stepped together.
struct LockstepGroup<'a> {
    first: &'a mut EpisodeSimulation,
    others: Vec<&'a mut EpisodeSimulation>,
}

impl LockstepGroup<'_> {
    fn simulations(&mut self) -> impl Iterator<Item = &mut EpisodeSimulation> {
        std::iter::once(&mut *self.first).chain(self.others.iter_mut().map(|s| &mut **s))
    }

    /// Runs the episode. Returns the tracks of all simulations, in order.
    fn run(&mut self, drive: &Drive, start: &StartShape, frame_times_s: &[f64]) -> Result<Vec<Track>, String> {
        let frames = match drive {
            Drive::Grip(path) => {
                self.simulations().for_each(|simulation| simulation.start_on(path, start));
                let mut frames = vec![Vec::new(); 1 + self.others.len()];
                for &time_s in frame_times_s {
                    self.advance(time_s, |_, t| path.at(t));
                    for (simulation, frames) in self.simulations().zip(&mut frames) {
                        frames.push(simulation.frame(time_s, path.at(time_s)));
                    }
                }
                frames
            }
            Drive::Actions(actions) => self.act(actions)?,
            Drive::Policy(_) => return Err("drive: expected a path of the grip or actions, got a policy".into()),
        };
        Ok(frames.into_iter().map(|frames| Track { frames, end: End::Complete }).collect())
    }

    /// Executes the actions. Returns the frames of all simulations.
    fn act(&mut self, actions: &[[f64; 2]]) -> Result<Vec<Vec<Frame>>, String> {
        let model = self.first.model();
        let task = model.task.ok_or_else(|| format!("model `{}`: actions need a task", model.name))?;
        let start = model.arm.start;
        let mut arms: Vec<_> = self.simulations().map(|simulation| simulation.arm([start.x_m, start.z_m])).collect();
        self.simulations().for_each(|simulation| simulation.hang(start));
        let mut frames = vec![Vec::new(); arms.len()];
        for step in 0..=actions.len() + task.rest_after(actions.len()) {
            let time_s = step as f64 * task.step_period_s;
            arms.iter_mut().for_each(|arm| arm.run_to(time_s));
            let pose = |arm: usize, t: f64| arms[arm].grip(t, start.pitch_rad);
            self.advance(time_s, pose);
            let action = actions.get(step).copied();
            for (i, (simulation, frames)) in self.simulations().zip(&mut frames).enumerate() {
                let frame = simulation.frame(time_s, pose(i, time_s));
                frames.push(Frame { action: action.unwrap_or_default(), ..frame });
            }
            if let Some(delta) = action {
                arms.iter_mut().for_each(|arm| arm.set_delta(time_s, delta));
            }
        }
        Ok(frames)
    }

    /// Advances all simulations to `time_s`. `pose(i, t)` gives the grip of simulation i at time t in s.
    fn advance(&mut self, time_s: f64, pose: impl Fn(usize, f64) -> GripPose) {
        if self.simulations().any(|simulation| simulation.has_memory()) {
            let step_s = self.first.beam().discretisation().time_step_s;
            loop {
                let next_s = self.first.beam().time_s() + step_s;
                if next_s >= time_s {
                    break;
                }
                self.advance_beams(next_s, &pose);
                self.simulations().for_each(|simulation| simulation.remember(simulation.beam().time_s()));
            }
        }
        self.advance_beams(time_s, &pose);
        self.simulations().for_each(EpisodeSimulation::remember_wrench);
    }

    fn advance_beams(&mut self, time_s: f64, pose: impl Fn(usize, f64) -> GripPose) {
        let angles: Vec<f64> = self.simulations().map(|simulation| simulation.episode_model().grip_angle_rad).collect();
        let grip = |simulation: usize, t: f64| GripState::from_pose(pose(simulation, t), angles[simulation]);
        let mut others: Vec<&mut Beam> = self.others.iter_mut().map(|simulation| simulation.beam_mut()).collect();
        self.first.beam_mut().advance_with(&mut others, time_s, grip);
    }
}

#[cfg(test)]
mod tests {
    use crate::BeamSimulator;
    use crate::parameters::tests::{cable, soft_bar};
    use catenary_core::mlp::Layer;
    use catenary_core::model::WrenchNoise;
    use catenary_core::policy::Observes;
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
        let theta = vec![0.1, 0.02, -1.5, 0.5, 0.05, 1.0, 0.0];
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

    /// The wrench of the axial, shear and bending forces is much stiffer than the keypoints: a difference over larger steps, at a fine
    /// tolerance, is the derivative.
    #[test]
    fn the_wrench_is_differentiated_too() {
        let mut model = cable();
        // A start in motion makes the cable ring along its length, which no difference over 1e-5 kg resolves.
        model.effects.retain(|effect| !effect.name.starts_with("start_"));
        model.observation.wrench = Some(WrenchNoise { force_sd_n: [1.0, 0.1], torque_sd_n_m: 0.05 });
        let path = |t: f64| GripPose { x_m: 0.4 + 0.05 * (6.0 * t).sin(), z_m: 1.3, pitch_rad: 0.0 };
        let times_s: Vec<f64> = (0..=100).map(|i| 0.01 * f64::from(i)).collect();
        let request = SimulationRequest {
            thetas: vec![vec![0.1, 0.02, 0.5, 0.5, 0.05, 1.0, 0.0]],
            drive: Drive::Grip(
                GripTrajectory::new(times_s.clone(), times_s.iter().map(|t| path(*t)).collect()).unwrap(),
            ),
            frame_times_s: vec![0.0, 0.3, 0.61, 0.9],
            noise: false,
            ..request()
        };
        let simulator = BeamSimulator::new(&model, 1).unwrap().with_tolerance(1e-12);
        let names = ["tip_mass_kg", "wrench_bias_z_n", "wrench_delay_s"];
        let found = simulator.sensitivities(&request, &names).unwrap().remove(0);
        assert_eq!(found.track, simulator.simulate(&request).unwrap()[0]);
        let at = |name: &str, value: f64| {
            let effects = vec![(name.to_owned(), vec![value])];
            simulator.simulate(&SimulationRequest { effects, ..request.clone() }).unwrap().remove(0)
        };
        for (name, derivatives) in names.iter().zip(&found.derivatives) {
            let base = model.parameters.get(*name).copied().unwrap_or(0.0);
            let (before, after) = (at(name, base), at(name, base + 1e-5));
            for (frame, derivative) in derivatives.iter().enumerate() {
                let wrench = |track: &catenary_core::Track| track.frames[frame].wrench.unwrap();
                for i in 0..3 {
                    let difference = (wrench(&after)[i] - wrench(&before)[i]) / 1e-5;
                    let (found, scale) = (derivative.wrench[i], difference.abs().max(1.0));
                    assert!((found - difference).abs() < 5e-3 * scale, "{name} {frame} {i}: {found}, {difference}");
                }
            }
        }
        let weight = found.derivatives[0][0].wrench[1];
        assert!((weight + 9.81).abs() < 1e-3, "a mass at the tip pulls down: {weight}");
    }

    #[test]
    fn parameters_without_derivatives_are_refused_by_name() {
        let simulator = BeamSimulator::new(&soft_bar(), 1).unwrap();
        let message = |request: &SimulationRequest, name: &str| {
            simulator.sensitivities(request, &[name]).unwrap_err().to_string()
        };
        assert!(message(&request(), "youngs_modulus").contains("`youngs_modulus`"));
        assert!(message(&request(), "slip_moment_n_m").contains("slip_moment_n_m"));
        let falling = SimulationRequest { thetas: vec![vec![10.0, 100.0]], ..request() };
        assert!(message(&falling, "length_m").contains("did not come to rest"));
        assert!(message(&SimulationRequest { thetas: Vec::new(), ..request() }, "length").contains("`length`"));
        let layer = Layer { inputs: 12, outputs: 2, weight: vec![0.0; 24], bias: vec![0.0; 2] };
        let policy = Policy {
            name: "still".into(),
            actor: Mlp::new(vec![layer]).unwrap(),
            observes: Observes::default(),
            plan: None,
            observation_mean: [0.0; 12],
            observation_scale: [1.0; 12],
            action_scale: [0.1; 2],
            step_period_s: 0.5,
            delta_anchor: DeltaAnchor::LastTarget,
            steps: 16,
            goal: None,
            arm: None,
            start_speed_m_s: None,
        };
        let drive = Drive::Policy(Box::new(policy));
        assert!(message(&SimulationRequest { drive, ..request() }, "length_m").contains("policy"));
    }
}
