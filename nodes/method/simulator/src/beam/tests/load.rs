//! Load at the tip.

use super::*;
use crate::beam::TipLoad;
use std::f64::consts::TAU;

/// Makes a stiff, nearly massless rod: only the load counts.
fn rod(tip_load: TipLoad) -> BeamParameters {
    let light = BeamParameters::from_youngs_modulus(0.2, SQUARE, 0.1, 1e9, 0.45);
    BeamParameters { tip_load, ..light }
}

/// Hanging rod whose grip turns freely up to a weak torsion spring: a compound pendulum. Its period gives the inertia.
#[test]
fn a_rod_with_a_load_swings_as_a_compound_pendulum() {
    for [offset_m, gyration_radius_m] in [[0.0, 0.0], [0.05, 0.0], [0.05, 0.06], [-0.03, 0.04]] {
        let load = TipLoad { mass_kg: 0.2, offset_m, gyration_radius_m };
        let p = BeamParameters { grip_compliance_rad_n_m: 1e5, ..rod(load) };
        let mut beam = hanging(p, standard(), grip(DOWN));
        let lever_m = 0.2 + offset_m;
        let nodes: Vec<[f64; 3]> = beam.nodes().iter().map(|q| [q[0] - 1e-3 * q[1], q[1], q[2] + 1e-3]).collect();
        beam.start_from(&nodes, &vec![[0.0; 3]; nodes.len()]).unwrap();
        let (mut crossings, mut last) = (Vec::new(), 0.2e-3);
        while crossings.len() < 5 {
            beam.step(grip(DOWN));
            let x = beam.state.position[20][0];
            if last > 0.0 && x <= 0.0 {
                crossings.push(beam.time_s() + standard().time_step_s * x / (last - x));
            }
            last = x;
        }
        let inertia = load.mass_kg * (lever_m * lever_m + gyration_radius_m * gyration_radius_m);
        let expected_s = TAU * (inertia / (load.mass_kg * GRAVITY * lever_m)).sqrt();
        assert_close((crossings[4] - crossings[0]) / 4.0, expected_s, 2e-3);
    }
}

/// Horizontal rod: the grip carries the load's weight at the lever of its centre.
#[test]
fn the_grip_carries_the_moment_of_the_loads_centre() {
    let p = BeamParameters {
        tip_load: TipLoad { mass_kg: 0.2, offset_m: 0.05, gyration_radius_m: 0.02 },
        ..bar(0.2, 1e11)
    };
    let reaction = hanging(p, standard(), grip(0.0)).grip_reaction();
    let bar_kg = p.mass_per_length_kg_m * 0.2;
    assert_close(reaction.force_z_n, (bar_kg + 0.2) * GRAVITY, 1e-6);
    assert_close(reaction.moment_n_m, (0.1 * bar_kg + 0.2 * 0.25) * GRAVITY, 1e-4);
}

#[test]
fn a_load_at_the_tip_without_inertia_is_a_tip_mass() {
    let swung = |p: BeamParameters| {
        let mut beam = hanging(p, standard(), grip(0.0));
        beam.advance_to(1.0, |t| GripState { x_m: 0.05 * (7.0 * t).sin(), ..grip(0.0) });
        beam.tip()
    };
    let load = TipLoad { mass_kg: 0.02, ..TipLoad::default() };
    let (as_load, as_mass) = (
        swung(BeamParameters { tip_load: load, ..bar(0.2, 1e5) }),
        swung(BeamParameters { tip_mass_kg: 0.02, ..bar(0.2, 1e5) }),
    );
    assert!((0..2).all(|i| (as_load[i] - as_mass[i]).abs() < 1e-7), "{as_load:?}, not {as_mass:?}");
    let beyond = swung(BeamParameters { tip_load: TipLoad { offset_m: 0.05, ..load }, ..bar(0.2, 1e5) });
    assert!((beyond[1] - as_mass[1]).abs() > 1e-3);
}

/// Free bar with a load, thrown with a spin: momentum, angular momentum and energy stay.
#[test]
fn a_free_bar_with_a_load_keeps_its_momenta() {
    let tip_load = TipLoad { mass_kg: 0.05, offset_m: 0.06, gyration_radius_m: 0.03 };
    let p = BeamParameters { clamped: false, gravity_m_s2: [0.0; 2], tip_load, ..bar(0.2, 1e6) };
    let fine = Discretisation { time_step_s: 2.5e-4, tolerance_m: 1e-12, ..standard() };
    let mut beam = Beam::new(p, fine, grip(0.0)).unwrap();
    let nodes = beam.nodes().to_vec();
    let spinning: Vec<[f64; 3]> = nodes.iter().map(|q| [0.3, 0.1 + 4.0 * q[0], 4.0]).collect();
    beam.start_from(&nodes, &spinning).unwrap();
    let (momentum, angular, energy) =
        (beam.momentum_kg_m_s(), beam.angular_momentum_kg_m2_s(), beam.energy().total_j());
    beam.advance_to(1.0, |_| grip(0.0));
    (0..2).for_each(|i| assert_close(beam.momentum_kg_m_s()[i], momentum[i], 1e-6));
    assert_close(beam.angular_momentum_kg_m2_s(), angular, 1e-3);
    assert_close(beam.energy().total_j(), energy, 2e-3);
}
