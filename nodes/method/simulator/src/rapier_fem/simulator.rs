//! Simulator of batches of episodes, one bar of tetrahedra each.

use super::bar::{FemBar, FemDiscretisation};
use crate::beam::{BeamParameters, GripState};
use crate::effects::Registry;
use crate::episode::{Conditions, EpisodeSimulation, Path, effects_of, execute, frame, given, keypoint_fractions};
use crate::parameters::ParameterError;
use crate::{simulator, workers};
use catenary_core::model::Object;
use catenary_core::simulator::{Drive, SimulatorError, StartShape};
use catenary_core::track::End;
use catenary_core::{Camera, Fidelity, Frame, GripPose, Model, SimulationRequest, Simulator, Track};

/// Finite-element simulator of one model.
pub struct RapierFemSimulator {
    model: Model,
    workers: usize,
    discretisation: Option<FemDiscretisation>,
}

/// Camera and target of an episode.
struct View<'a> {
    object: &'a Object,
    camera: Camera,
    target_scaled: [f64; 2],
}

impl RapierFemSimulator {
    /// Makes a simulator with `workers` threads. Equal requests give equal bits for any number of them.
    pub fn new(model: &Model, workers: usize) -> Result<Self, ParameterError> {
        crate::parameters::check(model)?;
        Ok(Self { model: model.clone(), workers, discretisation: None })
    }

    /// Sets the discretisation, instead of the requested fidelity's.
    pub fn with_discretisation(self, discretisation: FemDiscretisation) -> Self {
        Self { discretisation: Some(discretisation), ..self }
    }

    /// Rejects requests that need something this simulator does not have. The message names the field.
    fn check(&self, request: &SimulationRequest) -> Result<(), SimulatorError> {
        let refuse = |what: String| Err(SimulatorError::Input(format!("rapier_fem: {what}")));
        simulator::check(&self.model, request).or_else(refuse)?;
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
        let effects = effects_of(request, index);
        // The beam's simulation draws object, camera and target, so that both simulate the same episode.
        let mut simulation =
            EpisodeSimulation::new(&self.model, Registry::shipped(), Fidelity::Fast).map_err(|e| input(&e))?;
        simulation.prepare(&Conditions::of(request, index, &effects)).map_err(|e| input(&e))?;
        let seen = &simulation.episode_model().camera;
        if seen.memory_s() > 0.0 || seen.keypoint_shift != 0.0 {
            return Err(input(&"a camera with delay, exposure, shutter or biased keypoints is not simulated"));
        }
        let start = match &request.drive {
            Drive::Grip(path) => path.at(0.0),
            Drive::Actions(_) | Drive::Policy(_) => self.model.arm.start,
        };
        simulation.hang(start);
        let grip_angle_rad = simulation.beam().nodes()[0][2] + start.pitch_rad;
        let held = |pose: GripPose| GripState::from_pose(pose, grip_angle_rad);
        let object: &BeamParameters = simulation.beam().parameters();
        let discretisation = self.discretisation.unwrap_or_else(|| FemDiscretisation::of(request.fidelity));
        let mut bar = FemBar::new(object, discretisation, held(start)).map_err(|e| input(&e))?;
        if !bar.hang_at_rest() {
            return Err(SimulatorError::Backend(format!("rapier_fem: episode {index}: the bar did not come to rest")));
        }
        let view = View {
            object: &self.model.object,
            camera: *simulation.camera(),
            target_scaled: simulation.target_scaled(),
        };
        let mut frame_at = |time_s, path: Path<'_>| {
            bar.advance_to(time_s, |t| held(path(t)));
            view.frame(&bar, time_s, path(time_s))
        };
        match &request.drive {
            Drive::Grip(path) => {
                let frames = request.frame_times_s.iter().map(|&time_s| frame_at(time_s, &|t| path.at(t))).collect();
                Ok(Track { frames, end: End::Complete })
            }
            Drive::Actions(actions) => {
                let no_task = || input(&format!("model `{}`: actions need a task", self.model.name));
                let task = self.model.task.ok_or_else(no_task)?;
                let arm = simulation.arm([start.x_m, start.z_m]);
                Ok(execute(&task, start.pitch_rad, arm, frame_at, |step, _, _| given(&task, actions, step)))
            }
            Drive::Policy(_) => Err(input(&"policies are not executed")),
        }
    }
}

impl View<'_> {
    fn frame(&self, bar: &FemBar, time_s: f64, grip: GripPose) -> Frame {
        let dlo = keypoint_fractions(self.object, bar.deformed_length_m()).map(|fraction| {
            let [x, z] = bar.at_deformed_fraction(fraction);
            self.camera.scaled_from_world([x, 0.0, z]).unwrap_or([0.0; 2])
        });
        frame(time_s, dlo, self.target_scaled, grip)
    }
}

impl Simulator for RapierFemSimulator {
    fn simulate(&self, request: &SimulationRequest) -> Result<Vec<Track>, SimulatorError> {
        self.check(request)?;
        let episodes: Vec<usize> = (0..request.thetas.len()).collect();
        workers::map(episodes, self.workers, |_, index| self.simulate_one(request, index)).into_iter().collect()
    }
}
