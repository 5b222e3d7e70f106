//! Tests of all templates together.

use super::super::fixtures::{actions, request, template_at_zero_is_the_base};
use super::super::{Hook, Registry};
use super::{FREQUENCY, PLACE, all};
use crate::BeamSimulator;
use crate::parameters::tests::soft_bar;
use catenary_core::simulator::{DifferentiableSimulator, TrackSensitivities};
use catenary_core::{SimulationRequest, Simulator, Track};

fn simulator() -> BeamSimulator {
    let mut model = soft_bar();
    model.effects.clear();
    // Friction on the table bends within micrometres, so that differences would need a finer tolerance there.
    model.parameters.remove("table_height_m");
    BeamSimulator::with_effects(&model, &Registry::with_templates(), 1).unwrap().with_tolerance(1e-12)
}

fn track(simulator: &BeamSimulator, effects: &[(&str, f64)]) -> Track {
    simulator.simulate(&request(effects, actions(), false)).unwrap().remove(0)
}

/// Fails unless the derivative of the track by `name` at `value` equals a central difference over `step`.
#[track_caller]
fn derivative_is_the_difference(others: &[(&str, f64)], name: &str, value: f64, step: f64) {
    let simulator = simulator();
    let at = |value: f64| track(&simulator, &[others, &[(name, value)]].concat());
    let asked = request(&[others, &[(name, value)]].concat(), actions(), false);
    let TrackSensitivities { derivatives, .. } = simulator.sensitivities(&asked, &[name]).unwrap().remove(0);
    // A positive magnitude is differenced to one side, to second order.
    let is_open = value - step >= Registry::with_templates().find(name).unwrap().about().range[0];
    let difference = |frame: usize, k: usize, axis: usize| {
        let of = |value: f64| at(value).frames[frame].dlo[k][axis];
        if is_open {
            (of(value + step) - of(value - step)) / (2.0 * step)
        } else {
            (-1.5 * of(value) + 2.0 * of(value + step) - 0.5 * of(value + 2.0 * step)) / step
        }
    };
    let last = derivatives[0].len() - 1;
    let all = [last / 2, last].into_iter().flat_map(|f| (0..4).flat_map(move |k| [(f, k, 0), (f, k, 1)]));
    let pairs: Vec<(f64, f64)> =
        all.map(|(f, k, axis)| (derivatives[0][f].dlo[k][axis], difference(f, k, axis))).collect();
    let largest = pairs.iter().map(|(_, d)| d.abs()).fold(0.0, f64::max);
    assert!(largest > 0.0, "{name} changes nothing");
    for (said, expected) in pairs {
        assert!((said - expected).abs() < 0.02 * largest, "{name} at {value}: {said} for {expected} of {largest}");
    }
}

#[test]
fn each_template_at_zero_is_the_base_to_the_bit() {
    for template in all() {
        if ![PLACE, FREQUENCY].contains(&template.about().name) {
            template_at_zero_is_the_base(template.as_ref());
        }
    }
}

#[test]
fn tracks_have_derivatives_by_each_template_at_zero() {
    for template in all() {
        let about = template.about();
        if about.name != PLACE && about.name != FREQUENCY {
            // So small that the swing of a soft bar responds in proportion.
            let step = 1e-5 * about.prior.bounds().1;
            // A wave of 1 Hz is zero in every frame.
            derivative_is_the_difference(&[(FREQUENCY, 0.7)], about.name, 0.0, step);
        }
    }
}

#[test]
fn tracks_have_derivatives_by_place_and_frequency() {
    derivative_is_the_difference(&[("template_point_mass_kg", 0.01)], PLACE, 0.6, 1e-3);
    derivative_is_the_difference(&[("template_local_curvature_rad", 0.3)], PLACE, 0.35, 1e-3);
    derivative_is_the_difference(&[("template_local_stiffness", -1.0)], PLACE, 0.35, 1e-3);
    derivative_is_the_difference(&[("template_harmonic_grip_sin_rad", 0.05)], FREQUENCY, 0.8, 1e-3);
}

#[test]
fn companions_do_nothing_alone_and_have_their_default_otherwise() {
    let simulator = simulator();
    let nothing = track(&simulator, &[]);
    for (companion, value, template) in
        [(PLACE, 0.2, "template_local_curvature_rad"), (FREQUENCY, 3.0, "template_harmonic_grip_sin_rad")]
    {
        assert_eq!(track(&simulator, &[(companion, value)]), nothing, "{companion}");
        let default = Registry::with_templates().find(companion).unwrap().if_absent();
        let alone = track(&simulator, &[(template, 0.1)]);
        assert_eq!(track(&simulator, &[(template, 0.1), (companion, default)]), alone, "{companion}");
        assert_ne!(track(&simulator, &[(template, 0.1), (companion, value)]), alone, "{companion}");
    }
    // An absent companion is differentiated at its default.
    let asked = |effects: &[(&str, f64)]| -> SimulationRequest { request(effects, actions(), false) };
    let bend = ("template_local_curvature_rad", 0.3);
    let by_place = |effects: &[(&str, f64)]| simulator.sensitivities(&asked(effects), &[PLACE]).unwrap().remove(0);
    assert_eq!(by_place(&[bend]).derivatives, by_place(&[bend, (PLACE, 0.5)]).derivatives);
}

#[test]
fn templates_act_in_every_part_of_the_simulator_and_are_no_candidates() {
    for hook in [Hook::Force, Hook::Material, Hook::Boundary, Hook::Actuation, Hook::Observation] {
        assert!(all().iter().any(|t| t.about().hook == hook), "{hook:?}");
    }
    for template in all() {
        let about = template.about();
        assert!(Registry::shipped().find(about.name).is_none() && about.name.starts_with("template_"));
        let (low, high) = about.prior.bounds();
        assert!(about.prior.check().is_ok() && low >= about.range[0] && high <= about.range[1], "{}", about.name);
        assert!(template.companions().iter().all(|name| [PLACE, FREQUENCY].contains(name)));
    }
}
