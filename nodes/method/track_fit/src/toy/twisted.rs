//! Toys whose tracks differ from a linear model: folds and discretisation errors.

use super::{FRAMES, Toy, pattern};
use crate::data::MeasuredEpisode;
use catenary_core::simulator::{SimulatorError, TrackSensitivities};
use catenary_core::{DifferentiableSimulator, Fidelity, SimulationRequest, Simulator, Track};

/// Toy with a change of its tracks that its derivatives do not contain.
pub struct Twisted<F> {
    /// Toy without the change.
    pub toy: Toy,
    /// Change of a track, given the request and the number of the episode.
    twist: F,
}

/// Toy with a discretisation error: at fast fidelity keypoints move by `error` times theta's first parameter.
pub fn coarse(toy: Toy, error: f64) -> Twisted<impl Twist> {
    let twist = move |track: &mut Track, request: &SimulationRequest, episode: usize| {
        if request.fidelity == Fidelity::Fast {
            let by = error * request.thetas[episode][0];
            track.frames.iter_mut().flat_map(|f| f.dlo.iter_mut()).for_each(|p| p[0] += by);
        }
    };
    Twisted { toy, twist }
}

/// Toy with a fold: keypoints jump by 1 if theta's first parameter less the effects is under `at`.
pub fn folding(toy: Toy, at: f64) -> Twisted<impl Twist> {
    let twist = move |track: &mut Track, request: &SimulationRequest, episode: usize| {
        let effects: f64 = request.effects.iter().map(|(_, values)| values[episode]).sum();
        if request.thetas[episode][0] - effects < at {
            track.frames.iter_mut().flat_map(|f| f.dlo.iter_mut()).for_each(|p| p[0] += 1.0);
        }
    };
    Twisted { toy, twist }
}

/// Toy with a fold that only fine simulations show: at other than fast fidelity, keypoints jump by 1 if theta's first
/// parameter is under `at`.
pub fn folding_when_fine(toy: Toy, at: f64) -> Twisted<impl Twist> {
    let twist = move |track: &mut Track, request: &SimulationRequest, episode: usize| {
        if request.fidelity != Fidelity::Fast && request.thetas[episode][0] < at {
            track.frames.iter_mut().flat_map(|f| f.dlo.iter_mut()).for_each(|p| p[0] += 1.0);
        }
    };
    Twisted { toy, twist }
}

/// Toy with a fold that hides an effect: if theta's first parameter is under `at`, keypoints move as if `by` of the
/// effect were missing.
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

/// Change of a track.
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

/// Toy with a late fold: in the second half of its frames keypoints move unless theta's first parameter is within `by`
/// of `about`. The slope of that move draws fits away from an unfolded measurement.
pub struct FoldingLate {
    /// Toy without the fold.
    pub toy: Toy,
    /// First parameter of theta at which nothing folds.
    pub about: f64,
    /// Distance from `about` up to which nothing folds.
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

/// Toy with a misleading discretisation error: below reference fidelity, more of the effect `of` shows as less of the
/// effect `as_if`.
pub struct Mimic {
    /// Toy without the error.
    pub toy: Toy,
    /// Share of the effect `of` that shows as less of `as_if`.
    pub error: f64,
    /// Effect that is shown wrongly.
    pub of: &'static str,
    /// Effect that it resembles.
    pub as_if: &'static str,
}

impl Mimic {
    /// Request in which the second effect stands for the error of the first.
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

impl MeasuredEpisode {
    /// This episode with noise on its measured track.
    pub fn measured_anew<R: rand::Rng>(&self, rng: &mut R) -> MeasuredEpisode {
        let mut noisy = self.clone();
        noisy.measured = self.measure(&self.measured, rng);
        noisy
    }
}

/// Toy that cannot tell a length from its mirror image: theta's first parameter counts by its distance from `at` alone.
pub struct Mirrored {
    /// Toy behind the mirror.
    pub toy: Toy,
    /// Length in m at which the mirror stands.
    pub at: f64,
}

impl Mirrored {
    fn folded(&self, request: &SimulationRequest) -> SimulationRequest {
        let mut folded = request.clone();
        folded.thetas.iter_mut().for_each(|theta| theta[0] = self.at + (theta[0] - self.at).abs());
        folded
    }
}

impl Simulator for Mirrored {
    fn simulate(&self, request: &SimulationRequest) -> Result<Vec<Track>, SimulatorError> {
        self.toy.simulate(&self.folded(request))
    }
}

impl DifferentiableSimulator for Mirrored {
    fn sensitivities(
        &self,
        request: &SimulationRequest,
        names: &[&str],
    ) -> Result<Vec<TrackSensitivities>, SimulatorError> {
        let mut all = self.toy.sensitivities(&self.folded(request), names)?;
        let length = names.iter().position(|name| *name == "length_m");
        for (one, theta) in all.iter_mut().zip(&request.thetas) {
            if let Some(length) = length.filter(|_| theta[0] < self.at) {
                one.derivatives[length].iter_mut().flat_map(|f| f.dlo.iter_mut().flatten()).for_each(|v| *v = -*v);
            }
        }
        Ok(all)
    }
}
