//! Promises of the simulator, kept.

use super::theory::promise;
use super::*;
use crate::effects::Registry;
use crate::parameters::CATALOGUE;
use crate::parameters::tests::{cable, soft_bar};
use crate::workers;
use catenary_core::{Fidelity, Model, Parameter, ParameterSpace, Prior};

fn assert_kept(fidelity: Fidelity) {
    let rows = table(fidelity, workers::available()).unwrap();
    let missed: Vec<&Row> = rows.iter().filter(|r| r.passes == Some(false)).collect();
    assert!(missed.is_empty(), "{} keeps not {missed:#?}", fidelity.name());
    assert!(rows.len() > 30);
}

#[test]
fn standard_is_within_one_percent_of_theory() {
    assert_kept(Fidelity::Standard);
}

#[test]
fn reference_is_within_a_fifth_of_a_percent_of_theory() {
    assert_kept(Fidelity::Reference);
}

#[test]
fn fast_promises_nothing() {
    let row = Row::new("case", Comparison::new("what".into(), "m", 2.0, 1.0), promise(Fidelity::Fast, false));
    assert_eq!((row.ratio, row.tolerance, row.passes), (2.0, None, None));
}

#[test]
fn nan_keeps_no_promise() {
    let row = Row::new("case", Comparison::new("what".into(), "m", f64::NAN, 1.0), promise(Fidelity::Standard, false));
    assert_eq!(row.passes, Some(false));
}

#[test]
fn errors_fall_in_second_order_in_space_and_time() {
    for order in orders(workers::available()).unwrap() {
        assert!(order.passes, "{order:#?}");
    }
}

fn stress(fidelity: Fidelity, episodes: usize, workers: usize) -> StressReport {
    let (model, registry) = (soft_bar(), Registry::shipped());
    let extremes = default_extremes(registry, &model);
    Stress { model: &model, registry, extremes: &extremes, fidelity, episodes, seed: 1, workers }.run(|| ()).unwrap()
}

#[test]
fn random_episodes_at_the_edges_stay_finite_and_converge() {
    for fidelity in [Fidelity::Fast, Fidelity::Standard] {
        let report = stress(fidelity, 60, workers::available());
        assert!(report.passes, "{report:#?}");
    }
}

#[test]
fn random_episodes_do_not_depend_on_the_number_of_workers() {
    assert_eq!(stress(Fidelity::Fast, 6, 1), stress(Fidelity::Fast, 6, 3));
}

#[test]
fn every_parameter_beside_length_and_stiffness_is_pushed_to_its_ends() {
    let pushed: Vec<String> = default_extremes(Registry::shipped(), &soft_bar()).into_iter().map(|e| e.name).collect();
    let priors = ["length_m", "youngs_modulus_pa", "bending_stiffness_n_m2", "axial_stiffness_n"];
    for parameter in CATALOGUE.iter().filter(|p| !priors.contains(&p.name)) {
        assert!(pushed.iter().any(|name| name == parameter.name), "{} is not pushed", parameter.name);
    }
}

#[test]
fn sensitivities_are_the_derivatives_of_tracks_over_the_table() {
    let model = soft_bar();
    let cpu_time = || std::time::Duration::ZERO;
    let report = DerivativeTrial { model: &model, fidelity: Fidelity::Fast, episodes: 1, cpu_time }.run(|| ()).unwrap();
    // Two effects are random, one changes the mesh, and companions do nothing alone: they have no derivative of this kind.
    let left_out = ["dropped_frames", "keypoint_noise_px", "overhang_m"];
    let is_compared = |name: &str| !left_out.contains(&name) && !Registry::shipped().is_companion(name);
    let expected =
        Registry::shipped().effects().filter(|e| e.concerns(&model) && is_compared(e.about().name)).count() + 2;
    assert_eq!(report.rows.len(), expected, "{report:#?}");
    assert!(report.passes, "{report:#?}");
}

#[test]
fn sensitivities_are_the_derivatives_of_a_cable_whose_strands_rub() {
    of_a_cable_whose_strands_rub(&cable(), ["slip_moment_n_m", "slip_spread_ratio"]);
}

#[test]
fn sensitivities_are_the_derivatives_of_a_cable_whose_tip_carries_a_load() {
    let mut model = cable();
    let load = [("tip_load_kg", 0.2), ("tip_load_offset_m", 0.05), ("tip_load_gyration_radius_m", 0.03)];
    let mut parameters = model.theta.parameters().to_vec();
    for (name, value) in load {
        let prior = Prior::Uniform { low: 0.5 * value, high: 1.5 * value };
        parameters.push(Parameter { name: name.into(), prior });
    }
    model.theta = ParameterSpace::new(parameters).unwrap();
    of_a_cable_whose_strands_rub(&model, load.map(|(name, _)| name));
}

#[test]
fn sensitivities_are_the_derivatives_by_each_number_of_the_friction_between_strands() {
    let mut model = cable();
    let group = ["strand_friction_rad", "strand_slip_turn_rad", "strand_slip_spread"];
    let own = ["sticking_stiffness_n_m2", "slip_moment_n_m", "slip_spread_ratio"];
    let mut parameters = model.theta.parameters().to_vec();
    parameters.retain(|p| !own.contains(&p.name.as_str()));
    for name in group {
        let mut prior = Registry::shipped().find(name).unwrap().about().prior;
        if name != "strand_slip_spread" {
            // The spread does nothing if no strand slips: the friction and its turn must be small for this motion.
            prior = Prior::LogUniform { low: 0.01, high: 0.1 };
        }
        parameters.push(Parameter { name: name.into(), prior });
    }
    model.theta = ParameterSpace::new(parameters).unwrap();
    of_a_cable_whose_strands_rub(&model, group);
}

fn of_a_cable_whose_strands_rub<const N: usize>(model: &Model, names: [&str; N]) {
    let cpu_time = || std::time::Duration::ZERO;
    let trial = DerivativeTrial { model, fidelity: Fidelity::Fast, episodes: 1, cpu_time };
    let report = trial.run(|| ()).unwrap();
    // A soft grip changes the mesh, so that its derivative is the mean slope up to a likely compliance. Stiff strands bend that
    // slope.
    let passes = report.rows.iter().filter(|row| row.name != "grip_compliance_rad_n_m").all(|row| row.passes);
    let has = |name: &str| report.rows.iter().any(|row| row.name == name);
    assert!(passes && names.into_iter().all(has), "{report:#?}");
}
