//! Sensitivities compared with differences of tracks: errors, and cost in tracks.

use super::error::VerificationError;
use super::hand_path::random_actions;
use crate::effects::Registry;
use crate::parameters::Values;
use crate::simulator::BeamSimulator;
use catenary_core::model::Effect as DrawnEffect;
use catenary_core::simulator::{DifferentiableSimulator, Drive, FrameDerivative, StartShape};
use catenary_core::statistics::median_high;
use catenary_core::{Fidelity, Frame, GripPose, GripTrajectory, Model, SimulationRequest, Simulator, Track, seed};
use rand::RngExt;
use serde::Serialize;
use std::f64::consts::TAU;
use std::time::Duration;

/// Tolerance in m of the time steps behind the reference derivatives, and step of their central differences as a share
/// of the largest magnitude. Rounding and curvature are both far below the errors to be measured.
const TRUE_TOLERANCE_M: f64 = 1e-12;
const TRUE_SHARE: f64 = 1e-6;
/// Norm of a difference of tracks that is rounding alone.
const ROUNDING: f64 = 1e-12;
/// Steps of the competing differences, as shares of the largest magnitude.
const SHARES: [f64; 4] = [1e-2, 1e-3, 1e-4, 1e-5];

/// Largest median error that is promised, unless differences have a larger one.
const BOUND: f64 = 0.02;
/// Motion of the hand for a model without a task: duration in s, time between samples in s, and largest swing in m.
const SWAY_S: f64 = 8.0;
const SWAY_SAMPLE_S: f64 = 1e-3;
const SWAY_M: f64 = 0.1;

/// Comparison of sensitivities with differences.
#[derive(Debug, Clone, Copy)]
pub struct DerivativeTrial<'a> {
    /// Model. Without a task, a hand path sways its object.
    pub model: &'a Model,
    /// Fidelity of all tracks.
    pub fidelity: Fidelity,
    /// Random episodes of 8 s.
    pub episodes: u64,
    /// CPU time of the program so far.
    pub cpu_time: fn() -> Duration,
}

/// Errors of the derivatives by one parameter, relative to the whole track's true derivative.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct DerivativeRow {
    /// Name of the parameter or effect.
    pub name: String,
    /// Median error of the sensitivities over the episodes.
    pub error: f64,
    /// Largest error of the sensitivities.
    pub worst: f64,
    /// Median error of central differences of tracks, at the best of four steps for this parameter.
    pub difference_error: f64,
    /// Best of the four steps.
    pub difference_step: f64,
    /// True if the median error is within 2 %, or within that of the differences.
    pub passes: bool,
}

/// Result of the comparison.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct DerivativeReport {
    /// Fidelity of the tracks.
    pub fidelity: &'static str,
    /// Episodes that were differentiated.
    pub episodes: u64,
    /// CPU time in s of a track.
    pub track_s: f64,
    /// CPU time in s of a track with all its derivatives.
    pub sensitivities_s: f64,
    /// Cost of a track with all its derivatives, in tracks.
    pub tracks: f64,
    /// Number of tracks that central differences by as many parameters need.
    pub difference_tracks: usize,
    /// True if all rows pass.
    pub passes: bool,
    /// One row per parameter.
    pub rows: Vec<DerivativeRow>,
}

impl DerivativeTrial<'_> {
    /// Runs the comparison on one thread, by all parameters of theta and by all effects that change the track smoothly.
    /// Calls `progress` after each episode.
    pub fn run(&self, mut progress: impl FnMut()) -> Result<DerivativeReport, VerificationError> {
        let simulator = BeamSimulator::new(self.model, 1)?;
        let exact = BeamSimulator::new(self.model, 1)?.with_tolerance(TRUE_TOLERANCE_M);
        let parameters = parameters(self.model)?;
        let names: Vec<&str> = parameters.iter().map(|p| p.name).collect();
        let (mut track_s, mut sensitivities_s) = (0.0, 0.0);
        // By parameter: first the errors of the sensitivities, then those of the differences at each step, one per
        // episode.
        let mut errors = vec![vec![Vec::new(); 1 + SHARES.len()]; names.len()];
        for episode in 0..self.episodes {
            let request = self.request(episode);
            let started = (self.cpu_time)();
            simulator.simulate(&request)?;
            let simulated = (self.cpu_time)();
            let found = simulator.sensitivities(&request, &names)?.remove(0);
            sensitivities_s += ((self.cpu_time)() - simulated).as_secs_f64();
            track_s += (simulated - started).as_secs_f64();
            for (i, parameter) in parameters.iter().enumerate() {
                let truth = parameter.difference(&exact, &request, TRUE_SHARE)?;
                let norm = length(&truth);
                // A track that does not depend on the parameter differs by rounding alone. A large change marks another
                // mesh; a small one exceeds its share by rounding at most.
                let rounding = norm * TRUE_SHARE * parameter.greatest < ROUNDING;
                if rounding || found.changes[i].abs() > 2.0 * TRUE_SHARE * parameter.greatest {
                    continue;
                }
                errors[i][0].push(distance(&truth, &found.derivatives[i]) / norm);
                for (errors, share) in errors[i][1..].iter_mut().zip(SHARES) {
                    errors.push(distance(&truth, &parameter.difference(&simulator, &request, share)?) / norm);
                }
            }
            progress();
        }
        let rows = parameters.iter().zip(errors).filter_map(|(parameter, errors)| {
            let worst = errors[0].iter().copied().fold(0.0, f64::max);
            let medians: Vec<f64> = errors.into_iter().map(|mut e| median_high(&mut e)).collect::<Option<_>>()?;
            let (best, share) = medians[1..].iter().zip(SHARES).min_by(|a, b| a.0.total_cmp(b.0))?;
            Some(DerivativeRow {
                name: parameter.name.to_owned(),
                error: medians[0],
                worst,
                difference_error: *best,
                difference_step: share * parameter.greatest,
                passes: medians[0] <= BOUND.max(*best),
            })
        });
        let rows: Vec<DerivativeRow> = rows.collect();
        Ok(DerivativeReport {
            passes: rows.iter().all(|row| row.passes),
            difference_tracks: 2 * names.len(),
            fidelity: self.fidelity.name(),
            episodes: self.episodes,
            track_s: track_s / self.episodes as f64,
            sensitivities_s: sensitivities_s / self.episodes as f64,
            tracks: sensitivities_s / track_s,
            rows,
        })
    }

    /// Makes a random episode without noise: theta in the middle half of its prior, effects at their medians.
    fn request(&self, episode: u64) -> SimulationRequest {
        let model = self.model;
        let mut rng = seed::rng(episode, 41);
        let unit: Vec<f64> = model.theta.to_unit(&model.theta.sample_prior(&mut rng));
        let theta = model.theta.from_unit(&unit.iter().map(|u| 0.25 + 0.5 * u).collect::<Vec<_>>());
        let middle = |e: &DrawnEffect| (e.name.clone(), vec![e.distribution.from_unit(0.5)]);
        let (drive, frame_times_s) = match random_actions(model, 100 + episode) {
            Some(actions) => (Drive::Actions(actions), Vec::new()),
            None => {
                let path = swaying_path(model.arm.start, [rng.random_range(0.5..1.5), rng.random_range(0.5..1.5)]);
                (Drive::Grip(path), (0..=32).map(|i| SWAY_S * f64::from(i) / 32.0).collect())
            }
        };
        SimulationRequest {
            thetas: vec![theta],
            effects: model.effects.iter().map(middle).collect(),
            drive,
            start: StartShape::HangingAtRest,
            frame_times_s,
            target_m: None,
            fidelity: self.fidelity,
            seed: 1,
            first_episode: episode,
            noise: false,
        }
    }
}

/// Makes the path of a hand that sways from rest at `start`, with the given frequencies in Hz along x and z.
fn swaying_path(start: GripPose, frequencies_hz: [f64; 2]) -> GripTrajectory {
    let times_s: Vec<f64> = (0..=(SWAY_S / SWAY_SAMPLE_S) as usize).map(|i| i as f64 * SWAY_SAMPLE_S).collect();
    let pose = |time_s: f64| {
        let [x, z] = frequencies_hz.map(|f| 0.5 * SWAY_M * (1.0 - (TAU * f * time_s).cos()));
        GripPose { x_m: start.x_m + x, z_m: start.z_m + 0.3 * z, ..start }
    };
    let poses = times_s.iter().map(|t| pose(*t)).collect();
    GripTrajectory::new(times_s, poses).expect("times increase and poses are finite")
}

/// Parameter of the comparison.
#[derive(Debug, Clone, Copy)]
struct Parameter<'a> {
    name: &'a str,
    /// Smallest sensible value.
    low: f64,
    /// Largest magnitude in its prior.
    greatest: f64,
}

fn parameters(model: &Model) -> Result<Vec<Parameter<'_>>, VerificationError> {
    let greatest = |(low, high): (f64, f64)| low.abs().max(high.abs());
    let theta = model.theta.parameters().iter();
    let mut all: Vec<Parameter<'_>> =
        theta.map(|p| Parameter { name: &p.name, low: 0.0, greatest: greatest(p.prior.bounds()) }).collect();
    // A companion does nothing in a model without its effect.
    for effect in Registry::shipped().effects().filter(|e| !Registry::shipped().is_companion(e.about().name)) {
        let about = effect.about();
        let mut episode_model = Values::middle(Registry::shipped(), model)?.episode_model(model)?;
        // Effects of the table need one. A keypoint at an end of the object is clamped there, so that a bias has a
        // kink.
        let acts = effect.apply(about.prior.from_unit(0.5), &mut episode_model).is_ok();
        let is_kinked = about.name == "keypoint_bias" && model.object.keypoint_fractions.iter().any(|f| f % 1.0 == 0.0);
        if acts && !is_kinked && all.iter().all(|p| p.name != about.name) {
            all.push(Parameter { name: about.name, low: about.range[0], greatest: greatest(about.prior.bounds()) });
        }
    }
    Ok(all)
}

impl Parameter<'_> {
    /// Computes the derivative by second-order differences over `share` of the largest magnitude: central, or one-sided
    /// at the lower end of the range.
    fn difference(
        &self,
        simulator: &BeamSimulator,
        request: &SimulationRequest,
        share: f64,
    ) -> Result<Vec<FrameDerivative>, VerificationError> {
        let step = share * self.greatest;
        let index = simulator.model().theta.index_of(self.name);
        let given = request.effects.iter().find(|(name, _)| name == self.name).map(|(_, values)| values[0]);
        let fixed = || simulator.model().parameters.get(self.name).copied();
        let value = index.map(|i| request.thetas[0][i]).or(given).or_else(fixed).unwrap_or_default();
        let track = |value: f64| {
            let mut request = request.clone();
            match index {
                Some(i) => request.thetas[0][i] = value,
                None => {
                    request.effects.retain(|(name, _)| name != self.name);
                    request.effects.push((self.name.to_owned(), vec![value]));
                }
            }
            Ok::<Track, VerificationError>(simulator.simulate(&request)?.remove(0))
        };
        let (first, last) =
            if value - step >= self.low { (value - step, value + step) } else { (value, value + 2.0 * step) };
        let (before, after) = (track(first)?, track(last)?);
        if first < value {
            let ends = before.frames.iter().zip(&after.frames);
            return Ok(ends.map(|(a, b)| combined([(a, -0.5 / step), (b, 0.5 / step), (a, 0.0)])).collect());
        }
        let between = track(value + step)?;
        let frames = before.frames.iter().zip(&between.frames).zip(&after.frames);
        Ok(frames.map(|((a, b), c)| combined([(a, -1.5 / step), (b, 2.0 / step), (c, -0.5 / step)])).collect())
    }
}

/// Returns the weighted sum of three frames.
fn combined(frames: [(&Frame, f64); 3]) -> FrameDerivative {
    let sum = |of: &dyn Fn(&Frame) -> f64| frames.iter().map(|(frame, weight)| weight * of(frame)).sum::<f64>();
    FrameDerivative {
        dlo: std::array::from_fn(|k| [0, 1].map(|i| sum(&|f| f.dlo[k][i]))),
        target: [0, 1].map(|i| sum(&|f| f.target[i])),
        eef: [0, 1, 2].map(|i| sum(&|f| f.eef[i])),
        wrench: [0, 1, 2].map(|i| sum(&|f| f.wrench.map_or(0.0, |wrench| wrench[i]))),
    }
}

/// Returns the root of the sum of squares over all keypoints of a track.
fn length(track: &[FrameDerivative]) -> f64 {
    track.iter().flat_map(|f| f.dlo.as_flattened()).map(|v| v * v).sum::<f64>().sqrt()
}

fn distance(a: &[FrameDerivative], b: &[FrameDerivative]) -> f64 {
    let pairs = a.iter().zip(b).flat_map(|(a, b)| a.dlo.as_flattened().iter().zip(b.dlo.as_flattened()));
    pairs.map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt()
}
