//! A simulator whose tracks are linear in its unknowns, for tests with closed forms.

use crate::case::Case;
use crate::settings::Settings;
use catenary_core::episode::MeasuredTrack;
use catenary_core::simulator::{FrameDerivative, SimulatorError, StartShape, TrackSensitivities};
use catenary_core::track::End;
use catenary_core::{
    DifferentiableSimulator, Fidelity, Frame, GripTrajectory, Model, SimulationRequest, Simulator, Track,
};

/// Frames of a track.
pub const FRAMES: usize = 20;

/// Keypoints lie on a line; each unknown moves them along a pattern of its own, by `gain` for each of its units. Lengths under
/// 0.2 m it refuses.
pub struct Toy {
    pub gain: f64,
}

/// A model of two parameters, without anything that is drawn anew.
pub fn model() -> Model {
    let mut model = Model::from_yaml(include_str!("../../../launch_configs/models/soft_bar.yaml")).unwrap();
    model.effects.clear();
    model.camera.position_jitter_m = 0.0;
    model
}

/// How frame `i` changes with the unknown of that name.
fn pattern(name: &str, i: usize) -> FrameDerivative {
    let phase = name.bytes().map(f64::from).sum::<f64>();
    let rate = 0.4 + 0.05 * name.len() as f64;
    let wave = |k: usize, axis: usize| (phase + rate * i as f64 + 1.3 * k as f64 + 2.1 * axis as f64).sin();
    FrameDerivative { dlo: std::array::from_fn(|k| [wave(k, 0), wave(k, 1)]), target: [0.0; 2], eef: [0.0; 3] }
}

impl Toy {
    fn unknowns(request: &SimulationRequest, episode: usize) -> Vec<(String, f64)> {
        let theta = &request.thetas[episode];
        // Of a size that moves keypoints by some hundredths of the picture.
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
            Frame { time_s: 0.1 * i as f64, dlo, target: [0.0; 2], eef: [0.4, 0.4, 0.0], action: [0.0; 2] }
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

/// The toy, whose tracks are changed in a way that no derivative tells of.
pub struct Twisted<F> {
    pub toy: Toy,
    /// Changes a track of the request, given its episode's number.
    twist: F,
}

/// The toy, which at fast fidelity moves keypoints by `error` for each unit of theta's first parameter, too.
pub fn coarse(toy: Toy, error: f64) -> Twisted<impl Twist> {
    let twist = move |track: &mut Track, request: &SimulationRequest, episode: usize| {
        if request.fidelity == Fidelity::Fast {
            let by = error * request.thetas[episode][0];
            track.frames.iter_mut().flat_map(|f| f.dlo.iter_mut()).for_each(|p| p[0] += by);
        }
    };
    Twisted { toy, twist }
}

/// The toy, whose object folds another way where theta's first parameter less the effects is under `at`: keypoints are moved by
/// 1 in the picture.
pub fn folding(toy: Toy, at: f64) -> Twisted<impl Twist> {
    let twist = move |track: &mut Track, request: &SimulationRequest, episode: usize| {
        let effects: f64 = request.effects.iter().map(|(_, values)| values[episode]).sum();
        if request.thetas[episode][0] - effects < at {
            track.frames.iter_mut().flat_map(|f| f.dlo.iter_mut()).for_each(|p| p[0] += 1.0);
        }
    };
    Twisted { toy, twist }
}

/// The toy, whose object folds where theta's first parameter is under `at`, but at fast fidelity: keypoints are moved by 1 in the
/// picture.
pub fn folding_when_fine(toy: Toy, at: f64) -> Twisted<impl Twist> {
    let twist = move |track: &mut Track, request: &SimulationRequest, episode: usize| {
        if request.fidelity != Fidelity::Fast && request.thetas[episode][0] < at {
            track.frames.iter_mut().flat_map(|f| f.dlo.iter_mut()).for_each(|p| p[0] += 1.0);
        }
    };
    Twisted { toy, twist }
}

/// The toy, whose object folds where theta's first parameter is under `at`, by what undoes `by` of that effect.
pub fn misleading(toy: Toy, at: f64, effect: &'static str, by: f64) -> Twisted<impl Twist> {
    let size = toy.gain * by;
    let twist = move |track: &mut Track, request: &SimulationRequest, episode: usize| {
        if request.thetas[episode][0] < at {
            for (i, frame) in track.frames.iter_mut().enumerate() {
                let (undone, places) = (pattern(effect, i).dlo, frame.dlo.iter_mut().flatten());
                places.zip(undone.iter().flatten()).for_each(|(place, one)| *place -= size * one);
            }
        }
    };
    Twisted { toy, twist }
}

/// What changes a track.
pub trait Twist: Fn(&mut Track, &SimulationRequest, usize) + Send + Sync {}

impl<F: Fn(&mut Track, &SimulationRequest, usize) + Send + Sync> Twist for F {}

impl<F: Twist> Simulator for Twisted<F> {
    fn simulate(&self, request: &SimulationRequest) -> Result<Vec<Track>, SimulatorError> {
        let mut tracks = self.toy.simulate(request)?;
        tracks.iter_mut().enumerate().for_each(|(i, track)| (self.twist)(track, request, i));
        Ok(tracks)
    }
}

impl<F: Twist> DifferentiableSimulator for Twisted<F> {
    fn sensitivities(
        &self,
        request: &SimulationRequest,
        names: &[&str],
    ) -> Result<Vec<TrackSensitivities>, SimulatorError> {
        let mut all = self.toy.sensitivities(request, names)?;
        all.iter_mut().enumerate().for_each(|(i, one)| (self.twist)(&mut one.track, request, i));
        Ok(all)
    }
}

/// The toy, whose object folds in the second half of its frames unless theta's first parameter is within `by` of `about`: there
/// keypoints move with it so that what was measured without a fold draws fits away.
pub struct FoldingLate {
    pub toy: Toy,
    pub about: f64,
    pub by: f64,
}

impl FoldingLate {
    const SLOPE: f64 = 5.0;

    fn folds(&self, request: &SimulationRequest, episode: usize) -> bool {
        (request.thetas[episode][0] - self.about).abs() > self.by
    }

    fn fold(&self, track: &mut Track, request: &SimulationRequest, episode: usize) {
        if self.folds(request, episode) {
            let by = Self::SLOPE * (request.thetas[episode][0] - 0.2) + 0.5;
            track.frames[FRAMES / 2..].iter_mut().flat_map(|f| f.dlo.iter_mut()).for_each(|p| p[0] += by);
        }
    }
}

impl Simulator for FoldingLate {
    fn simulate(&self, request: &SimulationRequest) -> Result<Vec<Track>, SimulatorError> {
        let mut tracks = self.toy.simulate(request)?;
        tracks.iter_mut().enumerate().for_each(|(i, track)| self.fold(track, request, i));
        Ok(tracks)
    }
}

impl DifferentiableSimulator for FoldingLate {
    fn sensitivities(
        &self,
        request: &SimulationRequest,
        names: &[&str],
    ) -> Result<Vec<TrackSensitivities>, SimulatorError> {
        let mut all = self.toy.sensitivities(request, names)?;
        let length = names.iter().position(|n| *n == "length_m");
        for (i, one) in all.iter_mut().enumerate() {
            self.fold(&mut one.track, request, i);
            if let Some(length) = length.filter(|_| self.folds(request, i)) {
                let late = &mut one.derivatives[length][FRAMES / 2..];
                late.iter_mut().flat_map(|f| f.dlo.iter_mut()).for_each(|p| p[0] += Self::SLOPE);
            }
        }
        Ok(all)
    }
}

/// The toy, which below reference fidelity shows less of one effect's pattern the more there is of another effect.
pub struct Mimic {
    pub toy: Toy,
    pub error: f64,
    pub of: &'static str,
    pub as_if: &'static str,
}

impl Mimic {
    /// The request in which the second effect stands for the error of the first.
    fn mimicked(&self, request: &SimulationRequest) -> SimulationRequest {
        let own = request.effects.iter().find(|(name, _)| *name == self.of);
        let mut mimicked = request.clone();
        if let Some((_, values)) = own.filter(|_| request.fidelity != Fidelity::Reference) {
            mimicked.effects.push((self.as_if.to_owned(), values.iter().map(|v| -self.error * v).collect()));
        }
        mimicked
    }
}

impl Simulator for Mimic {
    fn simulate(&self, request: &SimulationRequest) -> Result<Vec<Track>, SimulatorError> {
        self.toy.simulate(&self.mimicked(request))
    }
}

impl DifferentiableSimulator for Mimic {
    fn sensitivities(
        &self,
        request: &SimulationRequest,
        names: &[&str],
    ) -> Result<Vec<TrackSensitivities>, SimulatorError> {
        let mut all = self.toy.sensitivities(&self.mimicked(request), names)?;
        let Some(place) = names.iter().position(|n| *n == self.of) else { return Ok(all) };
        if request.fidelity != Fidelity::Reference {
            for (i, by) in all.iter_mut().flat_map(|one| one.derivatives[place].iter_mut().enumerate()) {
                let other = pattern(self.as_if, i).dlo;
                let pairs = by.dlo.iter_mut().flatten().zip(other.iter().flatten());
                pairs.for_each(|(own, other)| *own -= self.error * self.toy.gain * other);
            }
        }
        Ok(all)
    }
}

/// What is measured, without noise, where theta and effects have these values.
pub fn measured(toy: &Toy, theta: [f64; 2], effects: &[(&str, f64)]) -> MeasuredTrack {
    MeasuredTrack { track: case(toy, theta, effects).measured, ..unmeasured() }
}

fn unmeasured() -> MeasuredTrack {
    MeasuredTrack {
        track: Track { frames: vec![Frame { time_s: 0.0, ..EMPTY }; FRAMES], end: End::Complete },
        grip: GripTrajectory::new(vec![0.0, 5.0], vec![Default::default(); 2]).unwrap(),
        actions: Vec::new(),
        start: StartShape::HangingAtRest,
        target_m: None,
        warnings: Vec::new(),
    }
}

/// An episode with these values of theta and effects, without noise.
pub fn case(toy: &Toy, theta: [f64; 2], effects: &[(&str, f64)]) -> Case {
    let mut case = Case::new(&model(), &unmeasured(), 0, &Settings::default()).unwrap();
    let request = SimulationRequest {
        thetas: vec![theta.to_vec()],
        effects: effects.iter().map(|(n, v)| ((*n).to_owned(), vec![*v])).collect(),
        ..case.template.clone()
    };
    case.measured = toy.track(&request, 0);
    case
}

const EMPTY: Frame = Frame { time_s: 0.0, dlo: [[0.0; 2]; 4], target: [0.0; 2], eef: [0.0; 3], action: [0.0; 2] };

impl Case {
    /// This episode with noise on what was measured.
    pub fn measured_anew<R: rand::Rng>(&self, rng: &mut R) -> Case {
        let mut noisy = self.clone();
        noisy.measured = self.measure(&self.measured, rng);
        noisy
    }
}
