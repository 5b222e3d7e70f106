//! Batches of episodes, one bar of tetrahedra each.

use super::bar::{FemBar, FemDivision};
use crate::arm::ArmModel;
use crate::beam::{BeamParameters, GripState};
use crate::effects::Registry;
use crate::episode::{Conditions, Stage};
use crate::parameters::ParameterError;
use crate::workers;
use catenary_core::simulator::{Drive, SimulatorError, StartShape};
use catenary_core::track::End;
use catenary_core::{Camera, Fidelity, Frame, GripPose, Model, SimulationRequest, Simulator, Track, seed};

/// The finite-element simulator of one model.
pub struct RapierFemSimulator {
    model: Model,
    workers: usize,
    division: Option<FemDivision>,
}

/// What an episode is seen with.
struct View {
    camera: Camera,
    target_scaled: [f64; 2],
    fractions: [f64; 4],
    hidden_length_m: f64,
}

impl RapierFemSimulator {
    /// A simulator with `workers` threads; the same request gives the same bits for any number of them.
    pub fn new(model: &Model, workers: usize) -> Result<Self, ParameterError> {
        crate::parameters::check(model)?;
        Ok(Self { model: model.clone(), workers, division: None })
    }

    /// Divides time and the bar like this, whatever fidelity a request asks for.
    pub fn with_division(self, division: FemDivision) -> Self {
        Self { division: Some(division), ..self }
    }

    /// Rejects requests that need what this simulator does not have; the message names the field.
    fn check(&self, request: &SimulationRequest) -> Result<(), SimulatorError> {
        let refuse = |what: String| Err(SimulatorError::Input(format!("rapier_fem: {what}")));
        let (n, d) = (request.thetas.len(), self.model.theta.dimension());
        if let Some(bad) = request.thetas.iter().find(|t| t.len() != d) {
            return refuse(format!("theta: expected {d} values an episode, got {}", bad.len()));
        }
        if let Some((name, values)) = request.effects.iter().find(|(_, v)| v.len() != n) {
            return refuse(format!("effect `{name}`: expected {n} values, one an episode, got {}", values.len()));
        }
        if request.start != StartShape::HangingAtRest {
            return refuse("start: expected hanging_at_rest, got a measured shape".into());
        }
        if matches!(request.drive, Drive::Policy(_)) {
            return refuse("drive: expected a path of the grip or actions, got a policy".into());
        }
        if request.noise {
            return refuse("noise: expected none, for comparisons, got a request with camera noise".into());
        }
        Ok(())
    }

    fn simulate_one(&self, request: &SimulationRequest, index: usize) -> Result<Track, SimulatorError> {
        let input = |e: &dyn std::fmt::Display| SimulatorError::Input(format!("episode {index}: {e}"));
        let effects: Vec<(String, f64)> =
            request.effects.iter().map(|(name, values)| (name.clone(), values[index])).collect();
        let conditions = Conditions {
            theta: &request.thetas[index],
            effects: &effects,
            seed: seed::derive(request.seed, request.first_episode + index as u64),
            noise: false,
            target_m: request.target_m,
        };
        // The beam's stage draws the object, the camera and the target, so that both simulate the same episode.
        let mut stage = Stage::new(&self.model, Registry::shipped(), Fidelity::Fast).map_err(|e| input(&e))?;
        stage.prepare(&conditions).map_err(|e| input(&e))?;
        let seen = &stage.world().view;
        if seen.memory_s() > 0.0 || seen.keypoint_shift != 0.0 {
            return Err(input(&"a camera with delay, exposure, shutter or biased keypoints is not simulated"));
        }
        let start = match &request.drive {
            Drive::Grip(path) => path.at(0.0),
            Drive::Actions(_) | Drive::Policy(_) => self.model.arm.start,
        };
        stage.hang(start);
        let grip_angle_rad = stage.beam().nodes()[0][2] + start.pitch_rad;
        let held = |pose: GripPose| GripState::from_pose(pose, grip_angle_rad);
        let object: &BeamParameters = stage.beam().parameters();
        let division = self.division.unwrap_or_else(|| FemDivision::of(request.fidelity));
        let mut bar = FemBar::new(object, division, held(start)).map_err(|e| input(&e))?;
        if !bar.hang_at_rest() {
            return Err(SimulatorError::Backend(format!("rapier_fem: episode {index}: the bar did not come to rest")));
        }
        let view = View {
            camera: *stage.camera(),
            target_scaled: stage.target_scaled(),
            fractions: self.model.object.keypoint_fractions,
            hidden_length_m: self.model.object.hidden_length_m,
        };
        match &request.drive {
            Drive::Grip(path) => {
                let frames = request.frame_times_s.iter().map(|&time_s| {
                    bar.advance_to(time_s, |t| held(path.at(t)));
                    view.frame(&bar, time_s, path.at(time_s), [0.0; 2])
                });
                Ok(Track { frames: frames.collect(), end: End::Complete })
            }
            Drive::Actions(actions) => {
                self.act(actions, stage.arm([start.x_m, start.z_m]), &mut bar, held, &view).map_err(|e| input(&e))
            }
            Drive::Policy(_) => Err(input(&"policies are not executed")),
        }
    }

    /// The model's arm executes the actions; frames at each step and after the last.
    fn act(
        &self,
        actions: &[[f64; 2]],
        mut arm: ArmModel,
        bar: &mut FemBar,
        held: impl Fn(GripPose) -> GripState,
        view: &View,
    ) -> Result<Track, String> {
        let task = self.model.task.ok_or_else(|| format!("model `{}`: actions need a task", self.model.name))?;
        let start = self.model.arm.start;
        let mut frames = Vec::new();
        for step in 0..=actions.len() {
            let time_s = step as f64 * task.step_period_s;
            arm.run_to(time_s);
            let pose = |t: f64| {
                let [x_m, z_m] = arm.position_m(t);
                GripPose { x_m, z_m, pitch_rad: start.pitch_rad }
            };
            bar.advance_to(time_s, |t| held(pose(t)));
            let action = actions.get(step).copied();
            frames.push(view.frame(bar, time_s, pose(time_s), action.unwrap_or_default()));
            if let Some(delta) = action {
                arm.set_delta(time_s, delta);
            }
        }
        Ok(Track { frames, end: End::Complete })
    }
}

impl View {
    fn frame(&self, bar: &FemBar, time_s: f64, grip: GripPose, action: [f64; 2]) -> Frame {
        let hidden = (self.hidden_length_m / bar.deformed_length_m()).min(1.0);
        let dlo = self.fractions.map(|f| {
            let [x, z] = bar.at_deformed_fraction(hidden + f * (1.0 - hidden));
            self.camera.scaled_from_world([x, 0.0, z]).unwrap_or([0.0; 2])
        });
        Frame { time_s, dlo, target: self.target_scaled, eef: [grip.x_m, grip.z_m, grip.pitch_rad], action }
    }
}

impl Simulator for RapierFemSimulator {
    fn simulate(&self, request: &SimulationRequest) -> Result<Vec<Track>, SimulatorError> {
        self.check(request)?;
        let episodes: Vec<usize> = (0..request.thetas.len()).collect();
        workers::map(episodes, self.workers, |_, index| self.simulate_one(request, index)).into_iter().collect()
    }
}
