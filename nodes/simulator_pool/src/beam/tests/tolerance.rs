//! What the tolerance of Newton's method costs, over the prior range.

use super::*;
use catenary_core::model::AxialLaw;

fn simulate(index: u64, discretisation: Discretisation) -> Beam {
    let [length_m, youngs_modulus_pa, friction, kelvin_voigt_time_s] = episode::draw(index);
    let p = BeamParameters {
        axial_law: if index.is_multiple_of(2) { AxialLaw::NeoHookean } else { AxialLaw::Linear },
        kelvin_voigt_time_s,
        table: Some(Table::new(0.0, friction)),
        ..bar(length_m, youngs_modulus_pa)
    };
    let path = episode::grip_path(index);
    let at = |time_s: f64| GripState::from_pose(path.at(time_s), 0.0);
    let mut beam = hanging(p, discretisation, at(0.0));
    beam.advance_to(episode::DURATION_S, at);
    beam
}

#[test]
fn stopping_newton_early_costs_micrometres() {
    for index in 0..6 {
        let usual = simulate(index, standard());
        let strict = simulate(index, Discretisation { tolerance_m: 1e-12, ..standard() });
        let fewer = usual.counters().newton_iterations as f64 / strict.counters().newton_iterations as f64;
        let apart = usual.nodes().iter().zip(strict.nodes()).map(|(a, b)| (a[0] - b[0]).hypot(a[1] - b[1]));
        let largest = apart.fold(0.0, f64::max);
        assert!(largest < 1e-5 && fewer < 0.95, "episode {index}: {largest} m apart, {fewer} of the iterations");
    }
}
