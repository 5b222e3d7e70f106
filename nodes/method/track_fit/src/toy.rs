//! Toy simulator, linear in its unknowns, for examples and for tests against closed forms.

use crate::data::{Candidate, MeasuredEpisode};
use crate::settings::Settings;
use catenary_core::episode::MeasuredTrack;
use catenary_core::simulator::{FrameDerivative, SimulatorError, StartShape, TrackSensitivities};
use catenary_core::track::End;
use catenary_core::{
    DifferentiableSimulator, Frame, GripTrajectory, Model, Prior, SimulationRequest, Simulator, Track,
};

pub mod twisted;

/// Frames of a track.
pub const FRAMES: usize = 20;

/// Toy simulator. Keypoints lie on a line; each unknown moves them along its own pattern, by `gain` a unit. Lengths
/// under 0.2 m are refused.
pub struct Toy {
    /// Displacement of keypoints in scaled image coordinates for each unit of an unknown.
    pub gain: f64,
}

/// Model with two parameters and nothing drawn anew for each episode.
pub fn model() -> Model {
    let mut model = Model::from_yaml(include_str!("../../../../launch_configs/models/soft_bar.yaml"))
        .expect("the sample model is valid");
    model.effects.clear();
    model.camera.position_jitter_m = 0.0;
    model
}

/// Derivative of frame `i` by the named unknown.
fn pattern(name: &str, i: usize) -> FrameDerivative {
    let phase = name.bytes().map(f64::from).sum::<f64>();
    let rate = 0.4 + 0.05 * name.len() as f64;
    let wave = |k: usize, axis: usize| (phase + rate * i as f64 + 1.3 * k as f64 + 2.1 * axis as f64).sin();
    FrameDerivative { dlo: std::array::from_fn(|k| [wave(k, 0), wave(k, 1)]), ..FrameDerivative::default() }
}

impl Toy {
    fn unknowns(request: &SimulationRequest, episode: usize) -> Vec<(String, f64)> {
        let theta = &request.thetas[episode];
        // The scale moves keypoints by some hundredths of the image.
        let mut all = vec![("length_m".to_owned(), theta[0]), ("youngs_modulus_pa".to_owned(), 1e-5 * theta[1])];
        all.extend(request.effects.iter().map(|(name, v)| (name.clone(), v[episode])));
        all
    }

    fn track(&self, request: &SimulationRequest, episode: usize) -> Track {
        let unknowns = Self::unknowns(request, episode);
        let frame = |i: usize| {
            let mut dlo: [[f64; 2]; 4] = std::array::from_fn(|k| [0.3 * k as f64 - 0.4, 0.1]);
            for (name, value) in &unknowns {
                let by = pattern(name, i);
                for k in 0..4 {
                    (0..2).for_each(|axis| dlo[k][axis] += self.gain * value * by.dlo[k][axis]);
                }
            }
            Frame {
                time_s: 0.1 * i as f64,
                dlo,
                target: [0.0; 2],
                eef: [0.4, 0.4, 0.0],
                action: [0.0; 2],
                wrench: None,
            }
        };
        Track { frames: (0..FRAMES).map(frame).collect(), end: End::Complete }
    }
}

impl Simulator for Toy {
    fn simulate(&self, request: &SimulationRequest) -> Result<Vec<Track>, SimulatorError> {
        if let Some(short) = request.thetas.iter().find(|t| t[0] < 0.2) {
            return Err(SimulatorError::Input(format!("length_m: expected at least 0.2, got {}", short[0])));
        }
        Ok((0..request.thetas.len()).map(|i| self.track(request, i)).collect())
    }
}

impl DifferentiableSimulator for Toy {
    fn sensitivities(
        &self,
        request: &SimulationRequest,
        names: &[&str],
    ) -> Result<Vec<TrackSensitivities>, SimulatorError> {
        let tracks = self.simulate(request)?;
        let of = |name: &&str, i: usize| {
            let scale = if *name == "youngs_modulus_pa" { 1e-5 * self.gain } else { self.gain };
            let mut by = pattern(name, i);
            by.dlo.iter_mut().flatten().for_each(|v| *v *= scale);
            by
        };
        let derivatives: Vec<Vec<FrameDerivative>> =
            names.iter().map(|n| (0..FRAMES).map(|i| of(n, i)).collect()).collect();
        let whole =
            |track| TrackSensitivities { track, derivatives: derivatives.clone(), changes: vec![1.0; names.len()] };
        Ok(tracks.into_iter().map(whole).collect())
    }
}

/// Candidate effect of the toy: positive, 0.001 to 0.1, at most 1.
pub fn candidate(name: &str) -> Candidate {
    let prior = Prior::LogUniform { low: 1e-3, high: 0.1 };
    let companions = Vec::new();
    Candidate { name: name.into(), title: name.into(), prior, range: [0.0, 1.0], base: 0.0, odds: 1.0, companions }
}

/// Measured episode without noise, at these values of theta and effects.
pub fn measured(toy: &Toy, theta: [f64; 2], effects: &[(&str, f64)]) -> MeasuredTrack {
    MeasuredTrack { track: episode(toy, theta, effects).measured, ..unmeasured() }
}

fn unmeasured() -> MeasuredTrack {
    MeasuredTrack {
        name: "toy episode".into(),
        track: Track { frames: vec![Frame { time_s: 0.0, ..EMPTY }; FRAMES], end: End::Complete },
        grip: GripTrajectory::new(vec![0.0, 5.0], vec![Default::default(); 2]).expect("the times increase"),
        actions: Vec::new(),
        start: StartShape::HangingAtRest,
        target_m: None,
        warnings: Vec::new(),
    }
}

/// Episode without noise, at these values of theta and effects.
pub fn episode(toy: &Toy, theta: [f64; 2], effects: &[(&str, f64)]) -> MeasuredEpisode {
    let mut episode =
        MeasuredEpisode::new(&model(), &unmeasured(), &Settings::default()).expect("the toy model has noise");
    let request = SimulationRequest {
        thetas: vec![theta.to_vec()],
        effects: effects.iter().map(|(n, v)| ((*n).to_owned(), vec![*v])).collect(),
        ..episode.template.clone()
    };
    episode.measured = toy.track(&request, 0);
    episode
}

const EMPTY: Frame =
    Frame { time_s: 0.0, dlo: [[0.0; 2]; 4], target: [0.0; 2], eef: [0.0; 3], action: [0.0; 2], wrench: None };
