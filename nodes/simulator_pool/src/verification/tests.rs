//! The promises.

use super::*;
use crate::parameters::CATALOGUE;
use crate::parameters::tests::soft_bar;

fn assert_kept(fidelity: Fidelity) {
    let rows = table(fidelity, workers::available()).unwrap();
    for r in &rows {
        println!("{:24} {:32} {:12.6} {:12.6} {:9.6} {}", r.case, r.what, r.computed, r.reference, r.ratio, r.unit);
    }
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
fn what_is_not_a_number_keeps_no_promise() {
    let row = Row::new("case", Comparison::new("what".into(), "m", f64::NAN, 1.0), promise(Fidelity::Standard, false));
    assert_eq!(row.passes, Some(false));
}

#[test]
fn errors_fall_in_second_order_in_space_and_time() {
    for order in orders(workers::available()).unwrap() {
        let errors: Vec<String> = order.errors.iter().map(|e| format!("{}: {:.2e}", e.division, e.error_m)).collect();
        println!("{} ({}): {}; order {:.3}", order.case, order.divided, errors.join(", "), order.measured);
        assert!(order.passes, "{order:#?}");
    }
}

#[test]
fn random_episodes_at_the_edges_stay_finite_and_converge() {
    let (model, extremes) = (soft_bar(), default_extremes());
    for fidelity in [Fidelity::Fast, Fidelity::Standard] {
        let stress = Stress {
            model: &model,
            extremes: &extremes,
            fidelity,
            episodes: 60,
            seed: 1,
            workers: workers::available(),
        };
        let report = stress.run(|| ()).unwrap();
        println!("{report:#?}");
        assert!(report.passes, "{report:#?}");
    }
}

#[test]
fn every_parameter_beside_length_and_stiffness_is_pushed_to_its_ends() {
    let pushed: Vec<String> = default_extremes().into_iter().map(|e| e.name).collect();
    let priors = ["length_m", "youngs_modulus_pa", "bending_stiffness_n_m2", "axial_stiffness_n"];
    for parameter in CATALOGUE.iter().filter(|p| !priors.contains(&p.name)) {
        assert!(pushed.iter().any(|name| name == parameter.name), "{} is not pushed", parameter.name);
    }
}
