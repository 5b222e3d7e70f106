//! Friction between the strands of a cable: a group of an effect and two companions.
//!
//! Its three numbers have no unit of force, so that their priors hold for cables of any size. The law itself is that of the
//! beam, which a model may also set by its parameters `sticking_stiffness_n_m2`, `slip_moment_n_m` and `slip_spread_ratio`.

use super::companion::Companion;
use super::effect::{About, Effect, Hook, log_uniform};
use crate::episode_model::{EpisodeModel, StrandSlip};

/// Name of the companion that sets the turn at which strands slip.
const SLIP_TURN: &str = "strand_slip_turn_rad";
/// Name of the companion that sets the spread of the slip.
const SLIP_SPREAD: &str = "strand_slip_spread";

/// Answer if the model has strands of its own: two laws of one cable would be one too many.
const OWN_STRANDS: &str =
    "a model without sticking_stiffness_n_m2 and slip_moment_n_m, which are the same law, got one with them";

/// Effect `strand_friction_rad`: friction between the strands of a cable.
pub(super) struct StrandFriction;

impl Effect for StrandFriction {
    fn about(&self) -> About {
        About {
            name: "strand_friction_rad",
            title: "friction between strands",
            description: "turn of the whole length that slipping strands hold against the elastic moment: larger damps large motions more and stiffens small ones",
            unit: "rad",
            hook: Hook::Material,
            // From a bend that hardly shows in a picture to a cable that stays wound up by more than a whole turn.
            prior: log_uniform(0.01, 10.0),
            range: [0.0, 100.0],
        }
    }

    fn apply(&self, magnitude: f64, episode: &mut EpisodeModel) -> Result<(), &'static str> {
        if magnitude == 0.0 {
            return Ok(());
        }
        let (beam, StrandSlip { turn_rad, spread }) = (&mut episode.beam, episode.strand_slip);
        if beam.sticking_stiffness_n_m2 > 0.0 {
            return Err(OWN_STRANDS);
        }
        beam.sticking_stiffness_n_m2 = magnitude / turn_rad * beam.bending_stiffness_n_m2;
        beam.slip_moment_n_m = magnitude * beam.bending_stiffness_n_m2 / beam.length_m;
        beam.slip_spread_ratio = spread;
        Ok(())
    }

    fn companions(&self) -> &'static [&'static str] {
        &[SLIP_TURN, SLIP_SPREAD]
    }
}

/// Makes the companion that sets the turn at which strands slip.
pub(super) fn slip_turn() -> Companion {
    let about = About {
        name: SLIP_TURN,
        title: "turn at which strands slip",
        description: "turn of the whole length at which the strands of a cable slip, on average: larger lets larger motions meet the stiff cable; nothing without strand_friction_rad",
        unit: "rad",
        hook: Hook::Material,
        // From a turn that no swing of a cable stays below to one that few swings reach.
        prior: log_uniform(0.01, 3.0),
        range: [1e-3, 100.0],
    };
    Companion::new(about, StrandSlip::default().turn_rad, |episode| &mut episode.strand_slip.turn_rad)
}

/// Makes the companion that sets the spread of the slip.
pub(super) fn slip_spread() -> Companion {
    let about = About {
        name: SLIP_SPREAD,
        title: "spread of the turns at which strands slip",
        description: "greatest over least curvature at which strands slip, one layer after the other; 1: all at once; nothing without strand_friction_rad",
        unit: "1",
        hook: Hook::Material,
        // From strands in one layer to those of a thick cable, in which pressure and distance from the axis vary.
        prior: log_uniform(1.0, 100.0),
        range: [1.0, 1e4],
    };
    Companion::new(about, StrandSlip::default().spread, |episode| &mut episode.strand_slip.spread)
}

#[cfg(test)]
mod tests {
    use super::super::fixtures;
    use super::{SLIP_SPREAD, SLIP_TURN, StrandFriction};
    use crate::BeamSimulator;
    use crate::beam::{Beam, Discretisation, GripState};
    use crate::parameters::tests::{cable, soft_bar};
    use crate::parameters::{ParameterError, check};
    use catenary_core::simulator::DifferentiableSimulator;
    use catenary_core::{Fidelity, Model, Simulator, Track};

    const FRICTION: &str = "strand_friction_rad";

    #[test]
    fn zero_is_the_base_to_the_bit() {
        fixtures::zero_is_the_base(&StrandFriction);
        let nothing = fixtures::episode(&[], fixtures::actions());
        let of = |effects: &[(&str, f64)]| fixtures::episode(effects, fixtures::actions());
        assert_eq!(of(&[(FRICTION, 0.0), (SLIP_TURN, 0.5), (SLIP_SPREAD, 30.0)]), nothing);
        assert_eq!(of(&[(SLIP_TURN, 0.5), (SLIP_SPREAD, 30.0)]), nothing, "companions do nothing alone");
        for companion in [(SLIP_TURN, 0.5), (SLIP_SPREAD, 30.0)] {
            assert_ne!(of(&[(FRICTION, 0.3), companion]), of(&[(FRICTION, 0.3)]), "{companion:?}");
        }
    }

    /// Small motions of a bar whose strands all stick are faster by the root of the added stiffness.
    #[test]
    fn small_motions_are_stiffer_by_the_strands_that_stick() {
        let (friction, turn) = (0.2, 0.1);
        let period_s = |friction: f64| {
            let mut episode = fixtures::template(&StrandFriction, 0.0, [0.5, 1.0], 2e7);
            (episode.beam.gravity_m_s2, episode.strand_slip.turn_rad) = ([0.0; 2], turn);
            super::Effect::apply(&StrandFriction, friction, &mut episode).unwrap();
            let mut beam =
                Beam::new(episode.beam, Discretisation::of(Fidelity::Reference), GripState::default()).unwrap();
            // A kick so small that no strand slips.
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
        fixtures::close(period_s(0.0) / period_s(friction), (1.0 + friction / turn).sqrt(), 1e-2);
    }

    /// The group and the model's own parameters are one law.
    #[test]
    fn the_group_is_the_law_of_the_parameters() {
        let mut own = soft_bar();
        own.effects.clear();
        let simulated = |model: &Model, effects: &[(&str, f64)]| -> Track {
            let request = fixtures::request(effects, fixtures::actions(), false);
            BeamSimulator::new(model, 1).unwrap().simulate(&request).unwrap().remove(0)
        };
        let group = simulated(&own, &[(FRICTION, 0.25), (SLIP_TURN, 0.5), (SLIP_SPREAD, 30.0)]);
        let stiffness_n_m2 = fixtures::episode_model(&StrandFriction, 0.0).beam.bending_stiffness_n_m2;
        // Powers of two scale without rounding: friction over turn is 1/2, and length is 1/4 m.
        let length_m = fixtures::THETA[0];
        own.parameters.insert("sticking_stiffness_n_m2".into(), 0.5 * stiffness_n_m2);
        own.parameters.insert("slip_moment_n_m".into(), 0.25 * stiffness_n_m2 / length_m);
        own.parameters.insert("slip_spread_ratio".into(), 30.0);
        assert_eq!(simulated(&own, &[]), group);
    }

    #[test]
    fn a_model_with_strands_of_its_own_refuses_the_group() {
        let mut model = cable();
        model.parameters.insert(FRICTION.into(), 0.3);
        let error = check(&model).unwrap_err();
        assert!(matches!(error, ParameterError::Effect { name: FRICTION, .. }), "{error}");
        assert!(error.to_string().contains("sticking_stiffness_n_m2 and slip_moment_n_m"), "{error}");
        model.parameters.insert(FRICTION.into(), 0.0);
        assert_eq!(check(&model), Ok(()), "none is none");
    }

    #[test]
    fn the_former_effect_of_one_number_is_refused_with_what_replaced_it() {
        let mut model = soft_bar();
        model.parameters.insert("strand_friction".into(), 0.3);
        let error = check(&model).unwrap_err().to_string();
        assert!(error.contains("`strand_friction`"), "{error}");
        for name in [FRICTION, SLIP_TURN, SLIP_SPREAD] {
            assert!(error.contains(name), "{error}");
        }
    }

    /// Derivatives by all three numbers, beside central differences of tracks.
    #[test]
    fn tracks_have_derivatives_by_each_number_of_the_group() {
        let mut model = soft_bar();
        model.effects.clear();
        // Friction on the table bends within micrometres, so that differences would need a finer tolerance there.
        model.parameters.remove("table_height_m");
        let simulator = BeamSimulator::new(&model, 1).unwrap().with_tolerance(1e-12);
        let group = [(FRICTION, 0.3), (SLIP_TURN, 0.2), (SLIP_SPREAD, 10.0)];
        let request = |values: &[(&str, f64)]| fixtures::request(values, fixtures::actions(), false);
        let names = group.map(|(name, _)| name);
        let found = simulator.sensitivities(&request(&group), &names).unwrap().remove(0);
        for (i, (name, value)) in group.into_iter().enumerate() {
            let step = 1e-6 * value;
            let at = |value: f64| {
                let mut moved = group;
                moved[i].1 = value;
                simulator.simulate(&request(&moved)).unwrap().remove(0)
            };
            let (less, more) = (at(value - step), at(value + step));
            let difference = |frame: usize, k: usize, axis: usize| {
                (more.frames[frame].dlo[k][axis] - less.frames[frame].dlo[k][axis]) / (2.0 * step)
            };
            let places = (0..less.frames.len()).flat_map(|f| (0..4).flat_map(move |k| [(f, k, 0), (f, k, 1)]));
            let pairs: Vec<(f64, f64)> =
                places.map(|(f, k, axis)| (found.derivatives[i][f].dlo[k][axis], difference(f, k, axis))).collect();
            let largest = pairs.iter().map(|(_, d)| d.abs()).fold(0.0, f64::max);
            assert!(largest > 0.0, "{name} changes nothing");
            for (said, expected) in pairs {
                assert!((said - expected).abs() < 0.02 * largest, "{name}: {said} for {expected} of {largest}");
            }
        }
    }
}
