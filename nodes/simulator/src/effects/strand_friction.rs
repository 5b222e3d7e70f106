//! Friction between the strands of a cable.

use super::effect::{About, Effect, Hook, log_uniform};
use crate::episode_model::EpisodeModel;

/// Effect `strand_friction`: friction between the strands of a cable.
pub(super) struct StrandFriction;

impl Effect for StrandFriction {
    fn about(&self) -> About {
        About {
            name: "strand_friction",
            title: "friction between strands",
            description: "moment, per EI / length, that strands add after a turn of 1 rad of the whole length: larger stiffens and damps small motions more",
            unit: "1",
            hook: Hook::Material,
            // Two measured cables have 0.2 to 0.8.
            prior: log_uniform(0.01, 3.0),
            range: [0.0, 100.0],
        }
    }

    fn apply(&self, magnitude: f64, episode: &mut EpisodeModel) -> Result<(), &'static str> {
        episode.beam.strand_friction += magnitude;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::fixtures;
    use super::StrandFriction;
    use crate::beam::{Beam, Discretisation, GripState};
    use catenary_core::Fidelity;

    #[test]
    fn zero_is_the_base_to_the_bit() {
        fixtures::zero_is_the_base(&StrandFriction);
    }

    /// Small motions of a bar whose strands all stick are faster by the root of the added stiffness.
    #[test]
    fn small_motions_are_stiffer_by_the_strands_that_stick() {
        let magnitude = 0.2;
        let period_s = |magnitude: f64| {
            let p = fixtures::beam(&StrandFriction, magnitude, 2e7, |b| b.gravity_m_s2 = [0.0; 2]);
            let mut beam = Beam::new(p, Discretisation::of(Fidelity::Reference), GripState::default()).unwrap();
            // A kick so small that no layer slips: the turn stays below 0.06 rad.
            beam.set_velocity([0.0, 1e-3]);
            let mut crossings = Vec::new();
            let mut last = 0.0;
            for i in 1..4000 {
                let t = 5e-4 * f64::from(i);
                beam.advance_to(t, |_| GripState::default());
                let z = beam.tip()[1];
                if last < 0.0 && z >= 0.0 {
                    crossings.push(t - 5e-4 * z / (z - last));
                }
                last = z;
            }
            (crossings[crossings.len() - 1] - crossings[0]) / (crossings.len() - 1) as f64
        };
        // Sum of the layers' stiffness over EI: c t^(1/4) / t at the first turn.
        let added = magnitude * 0.06f64.powf(-0.75);
        fixtures::close(period_s(0.0) / period_s(magnitude), (1.0 + added).sqrt(), 1e-2);
    }
}
