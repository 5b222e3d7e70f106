//! Random episodes over the prior range.

use super::*;
use catenary_core::model::AxialLaw;

fn simulate(index: u64, discretisation: Discretisation, damped: bool) -> Beam {
    let [length_m, youngs_modulus_pa, friction, kelvin_voigt_time_s] = episode::draw(index);
    let p = BeamParameters {
        axial_law: if index.is_multiple_of(2) { AxialLaw::NeoHookean } else { AxialLaw::Linear },
        kelvin_voigt_time_s: if damped { kelvin_voigt_time_s } else { 0.0 },
        table: Some(Table::new(0.0, friction)),
        ..bar(length_m, youngs_modulus_pa)
    };
    let path = episode::grip_path(index);
    let at = |time_s: f64| GripState::from_pose(path.at(time_s), 0.0);
    let mut beam = hanging(p, discretisation, at(0.0));
    for k in 1..=16 {
        beam.advance_to(0.5 * f64::from(k), at);
        assert!(beam.nodes().iter().flatten().all(|v| v.abs() < 10.0), "episode {index}: {:?}", beam.nodes());
    }
    beam
}

#[test]
fn random_episodes_stay_finite_and_converge() {
    for fidelity in [Fidelity::Fast, Fidelity::Standard] {
        for damped in [true, false] {
            let (mut steps, mut unconverged) = (0, 0);
            for index in 0..24 {
                let counters = simulate(index, Discretisation::of(fidelity), damped).counters();
                steps += counters.steps;
                unconverged += counters.unconverged_steps;
            }
            assert!(1000 * unconverged < steps, "{fidelity:?}, damped {damped}: {unconverged} of {steps} unconverged");
        }
    }
}

#[test]
fn stopping_newton_early_costs_micrometres() {
    for index in 0..6 {
        let usual = simulate(index, standard(), true);
        let strict = simulate(index, Discretisation { tolerance_m: 1e-12, ..standard() }, true);
        let fewer = usual.counters().newton_iterations as f64 / strict.counters().newton_iterations as f64;
        let apart = usual.nodes().iter().zip(strict.nodes()).map(|(a, b)| (a[0] - b[0]).hypot(a[1] - b[1]));
        let largest = apart.fold(0.0, f64::max);
        assert!(largest < 1e-5 && fewer < 0.8, "episode {index}: {largest} m apart, {fewer} of the iterations");
    }
}
