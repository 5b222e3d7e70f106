//! Recording of an episode, and the keypoints that the model gives at one theta.

use super::palette::Role;
use super::plots::replay::{Fit, Keypoints, Plane, replay};
use bayes_sim::sequential::Observed;
use catenary_core::episode::MeasuredTrack;
use catenary_core::posterior::Marginal;
use catenary_core::{Fidelity, Model, Policy, SimulationRequest, Simulator, Track};
use catenary_simulator::BeamSimulator;

/// Largest number of recordings of a page.
const SHOWN: usize = 3;

/// Keypoints of a recording and of the model.
#[derive(Debug, Clone)]
pub struct RecordedFit {
    title: String,
    times_s: Vec<f64>,
    measured: Keypoints,
    fitted: Keypoints,
}

impl RecordedFit {
    /// Simulates the first recordings at the medians of the posterior. A recording that cannot be simulated there is left out.
    pub fn at_medians(
        model: &Model,
        recordings: &[MeasuredTrack],
        policy: Option<&Policy>,
        marginals: &[Marginal],
    ) -> Vec<Self> {
        let theta: Vec<f64> = marginals.iter().map(|m| m.median).collect();
        let Ok(simulator) = BeamSimulator::new(model, 1) else { return Vec::new() };
        let one = |measured: &MeasuredTrack| {
            let observed = Observed::new(model, measured, policy, Fidelity::Standard).ok()?;
            let request = SimulationRequest { thetas: vec![theta.clone()], noise: false, ..observed.template };
            let track = simulator.simulate(&request).ok()?.pop()?;
            let title = match recordings.len() {
                1 => "Keypoints, measured and of the model".to_owned(),
                _ => format!("Keypoints, measured and of the model: {}", measured.name),
            };
            Some(Self {
                title,
                times_s: measured.track.frames.iter().map(|f| f.time_s).collect(),
                measured: keypoints(&measured.track),
                fitted: in_order(&keypoints(&measured.track), keypoints(&track)),
            })
        };
        recordings.iter().take(SHOWN).filter_map(one).collect()
    }

    /// Figure with a slider.
    pub fn figure(&self) -> String {
        let plane = Plane { x: "across the picture (-1 to 1)", y: "up the picture", is_down: true };
        let fit = Fit { name: "model".into(), role: Role::Posterior, points: self.fitted.clone() };
        replay(&self.title, &self.times_s, &self.measured, &[fit], &plane)
    }
}

fn keypoints(track: &Track) -> Keypoints {
    track.frames.iter().map(|f| f.dlo).collect()
}

/// Keypoints of the model, from the end from which those of the recording begin in the same frame.
fn in_order(measured: &Keypoints, fitted: Keypoints) -> Keypoints {
    let one = |(k, mut points): (usize, [[f64; 2]; 4])| {
        if let Some(seen) = measured.get(k) {
            points = bayes_sim::diagnostics::nearest_order(seen, &points);
        }
        points
    };
    fitted.into_iter().enumerate().map(one).collect()
}
