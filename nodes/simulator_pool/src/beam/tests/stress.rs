//! Random episodes over the prior range.

use super::*;
use crate::beam::Counters;
use catenary_core::model::AxialLaw;

fn simulate(index: u64, fidelity: Fidelity, damped: bool) -> Counters {
    let [length_m, youngs_modulus_pa, friction, kelvin_voigt_time_s] = episode::draw(index);
    let p = BeamParameters {
        axial_law: if index % 2 == 0 { AxialLaw::NeoHookean } else { AxialLaw::Linear },
        kelvin_voigt_time_s: if damped { kelvin_voigt_time_s } else { 0.0 },
        table: Some(Table::new(0.0, friction)),
        ..bar(length_m, youngs_modulus_pa)
    };
    let path = episode::grip_path(index);
    let at = |time_s: f64| GripState::from_pose(path.at(time_s), 0.0);
    let mut beam = hanging(p, Discretisation::of(fidelity), at(0.0));
    for k in 1..=16 {
        beam.advance_to(0.5 * f64::from(k), at);
        assert!(
            beam.nodes().iter().flatten().all(|v| v.is_finite() && v.abs() < 10.0),
            "episode {index}: {:?}",
            beam.nodes()
        );
    }
    beam.counters()
}

#[test]
fn random_episodes_stay_finite_and_converge() {
    for (fidelity, damped) in
        [(Fidelity::Fast, true), (Fidelity::Fast, false), (Fidelity::Standard, true), (Fidelity::Standard, false)]
    {
        let (mut steps, mut unconverged) = (0, 0);
        for index in 0..24 {
            let counters = simulate(index, fidelity, damped);
            steps += counters.steps;
            unconverged += counters.unconverged_steps;
        }
        assert!(
            1000 * unconverged < steps,
            "{fidelity:?}, damped {damped}: {unconverged} of {steps} steps unconverged"
        );
    }
}
