//! Error of the Newton tolerance and of the mesh, over the prior range.

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

/// Returns the nodes of a soft bar every quarter of a second, at the material places common to both meshes.
fn soft(index: u64, fidelity: Fidelity) -> Vec<[f64; 2]> {
    let p = BeamParameters {
        kelvin_voigt_time_s: 0.02,
        table: Some(Table::new(0.0, 0.45)),
        axial_law: AxialLaw::NeoHookean,
        ..bar(0.28, 2.5e3)
    };
    let path = episode::grip_path(index);
    let at = |time_s: f64| GripState::from_pose(path.at(time_s), 0.0);
    let mut beam = hanging(p, Discretisation::of(fidelity), at(0.0));
    let mut places = Vec::new();
    for quarter in 1..=(4.0 * episode::DURATION_S) as usize {
        beam.advance_to(0.25 * quarter as f64, at);
        let step = beam.nodes().len() / 20;
        places.extend(beam.nodes().iter().step_by(step).map(|n| [n[0], n[1]]));
    }
    places
}

#[test]
fn a_fine_mesh_brings_a_soft_bar_near_to_the_reference_in_the_time_steps_of_fast() {
    let mut sums = [0.0; 2];
    for index in 0..4 {
        let reference = soft(index, Fidelity::Reference);
        for (sum, fidelity) in sums.iter_mut().zip([Fidelity::Fast, Fidelity::FineMesh]) {
            let pairs = soft(index, fidelity).into_iter().zip(&reference);
            *sum += pairs.map(|(a, b)| (a[0] - b[0]).hypot(a[1] - b[1])).fold(0.0, f64::max);
        }
    }
    let [fast, fine] = sums;
    assert!(fine < 0.25 * fast && fine < 4e-3, "largest distances sum to {fast} m, and with the fine mesh to {fine} m");
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
