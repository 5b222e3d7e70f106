//! Motion: damping, drag, forces and frames.

use super::*;
use crate::beam::Scheme;
use std::f64::consts::PI;

/// Releases a weightless horizontal cantilever from a small sag. Returns the tip's height after each step.
fn ringing(p: BeamParameters, discretisation: Discretisation, steps: usize) -> Vec<f64> {
    let loaded = BeamParameters { gravity_m_s2: [0.0, -0.05 * GRAVITY], ..p };
    let mut beam = hanging(loaded, discretisation, grip(0.0));
    beam.parameters.gravity_m_s2 = [0.0; 2];
    (0..steps)
        .map(|_| {
            beam.step(grip(0.0));
            beam.state.position[discretisation.elements][1]
        })
        .collect()
}

fn first_bending_rad_s(p: &BeamParameters) -> f64 {
    // First root of cos x cosh x = -1, squared: the Euler-Bernoulli cantilever.
    3.516_015 * (p.bending_stiffness_n_m2 / (p.mass_per_length_kg_m * p.length_m.powi(4))).sqrt()
}

#[test]
fn kelvin_voigt_damps_bending_by_half_the_time_times_frequency_squared() {
    let time_s = 3e-3;
    let p = BeamParameters { kelvin_voigt_time_s: time_s, ..bar(0.3, 1e6) };
    let omega = first_bending_rad_s(&p);
    // Three swings let the higher modes die out, which the damping takes first.
    let (settled, swings) = (3, 3);
    let per_swing = 400;
    let step_s = 2.0 * PI / omega / per_swing as f64;
    let signal = ringing(p, Discretisation { time_step_s: step_s, ..standard() }, (settled + swings + 2) * per_swing);
    let peak = |from: usize| signal[from..from + per_swing].iter().copied().fold(0.0, f64::max);
    let from = settled * per_swing + per_swing / 2;
    let decay = (peak(from) / peak(from + swings * per_swing)).ln();
    let expected = 0.5 * omega * omega * time_s * (swings * per_swing) as f64 * step_s;
    assert_close(decay, expected, 3e-2);
}

/// Returns the share of a swinging bar's energy that is lost within a second.
fn loss_per_second(scheme: Scheme) -> f64 {
    let p = bar(0.2, 5e4);
    let mut beam = hanging(p, Discretisation { scheme, ..standard() }, grip(DOWN));
    let at_rest = beam.energy().total_j();
    beam = hanging(
        BeamParameters { gravity_m_s2: [3.0, -GRAVITY], ..p },
        Discretisation { scheme, ..standard() },
        grip(DOWN),
    );
    beam.parameters.gravity_m_s2 = [0.0, -GRAVITY];
    let energy = |beam: &Beam| beam.energy().total_j() - at_rest;
    beam.advance_to(1.0, |_| grip(DOWN));
    let before = energy(&beam);
    beam.advance_to(2.0, |_| grip(DOWN));
    1.0 - energy(&beam) / before
}

#[test]
fn second_order_scheme_keeps_the_energy_that_the_first_order_scheme_loses() {
    let (bdf2, euler) = (loss_per_second(Scheme::Bdf2), loss_per_second(Scheme::ImplicitEuler));
    assert!((0.0..0.01).contains(&bdf2), "BDF2 loses {bdf2} in a second");
    assert!(euler > 0.1, "implicit Euler loses {euler}, BDF2 {bdf2}");
}

#[test]
fn energy_never_grows_without_input() {
    for friction in [0.0, 0.5] {
        let table = Some(Table::new(0.0, friction));
        let p = BeamParameters { table, ..bar(0.25, 1e4) };
        let at = GripState { z_m: 0.2, ..grip(0.0) };
        let mut beam = Beam::new(p, standard(), at).unwrap();
        let start = beam.energy().total_j();
        let scale = p.mass_kg() * GRAVITY * p.length_m;
        let mut lowest = start;
        for _ in 0..1000 {
            beam.step(at);
            let now = beam.energy().total_j();
            // Tolerance in time discretisation: half a percent of weight times length.
            assert!(now < lowest + 5e-3 * scale, "grew from {lowest} to {now} J; scale {scale} J");
            lowest = lowest.min(now);
        }
        assert!(lowest < start, "{lowest} J, from {start} J");
    }
}

#[test]
fn drag_gives_the_terminal_speeds_of_its_laws() {
    let free = BeamParameters { clamped: false, ..bar(0.2, 1e5) };
    let load = free.mass_per_length_kg_m * GRAVITY;
    let fall = |p: BeamParameters, tangent_rad: f64| {
        let mut beam = Beam::new(p, standard(), grip(tangent_rad)).unwrap();
        beam.advance_to(3.0, |_| grip(0.0));
        -beam.momentum_kg_m_s()[1] / p.mass_kg()
    };
    assert_close(fall(BeamParameters { linear_drag_n_s_m2: 2.0, ..free }, 0.5), load / 2.0, 1e-3);
    let quadratic = BeamParameters { quadratic_drag_n_s2_m3: 0.8, ..free };
    assert_close(fall(quadratic, 0.0), (load / 0.8).sqrt(), 1e-3);
    assert_close(fall(quadratic, DOWN), GRAVITY * 3.0, 1e-3);
}

#[test]
fn forces_on_the_whole_beam_change_its_momentum() {
    let p = BeamParameters {
        kelvin_voigt_time_s: 0.02,
        tip_mass_kg: 0.01,
        overhang_m: 0.02,
        table: Some(Table::new(0.0, 0.4)),
        ..bar(0.25, 1e4)
    };
    let path = |time_s: f64| GripState { x_m: 0.05 * (9.0 * time_s).sin(), z_m: 0.2 - 0.05 * time_s, ..grip(0.0) };
    let mut beam = hanging(p, Discretisation { tolerance_m: 1e-11, ..standard() }, path(0.0));
    for k in 1..=200 {
        beam.advance_to(f64::from(k) * 0.01, path);
        let (reaction, table) = (beam.grip_reaction(), beam.table_force());
        let forces =
            [reaction.force_x_n + table.friction_n, reaction.force_z_n + table.normal_n - p.mass_kg() * GRAVITY];
        for axis in 0..2 {
            let rate: f64 =
                beam.mesh.inertia.iter().zip(&beam.state.acceleration).map(|(m, a)| m[axis] * a[axis]).sum();
            assert!((forces[axis] - rate).abs() < 2e-6, "step {k}, axis {axis}: {} and {rate} N", forces[axis]);
        }
    }
}

#[test]
fn motion_does_not_depend_on_the_frame() {
    let p = BeamParameters {
        kelvin_voigt_time_s: 0.01,
        axial_law: catenary_core::model::AxialLaw::NeoHookean,
        ..bar(0.2, 5e3)
    };
    let turn: f64 = 0.8;
    let (sin, cos) = turn.sin_cos();
    let turned = BeamParameters { gravity_m_s2: [sin * GRAVITY, -cos * GRAVITY], ..p };
    let mut upright = hanging(p, standard(), grip(0.0));
    let mut tilted = hanging(turned, standard(), grip(turn));
    let x_at = |time_s: f64| 0.04 * (8.0 * time_s).sin();
    upright.advance_to(1.0, |time_s| GripState { x_m: x_at(time_s), ..grip(0.0) });
    tilted.advance_to(1.0, |time_s| GripState { x_m: cos * x_at(time_s), z_m: sin * x_at(time_s), tangent_rad: turn });
    let [x, z] = upright.tip();
    let expected = [cos * x - sin * z, sin * x + cos * z];
    let tip = tilted.tip();
    assert!((tip[0] - expected[0]).hypot(tip[1] - expected[1]) < 1e-6, "{tip:?}, not {expected:?}");
}

#[test]
fn whole_turns_of_the_grip_angle_change_nothing() {
    let at = |tangent_rad: f64| {
        let mut beam = hanging(bar(0.2, 1e4), standard(), grip(0.0));
        beam.advance_to(0.3, |time_s| GripState { x_m: 0.1 * time_s, ..grip(tangent_rad) });
        beam.tip()
    };
    let (plain, wound) = (at(0.0), at(2.0 * PI));
    assert!((plain[0] - wound[0]).abs() < 1e-9 && (plain[1] - wound[1]).abs() < 1e-9, "{plain:?}, not {wound:?}");
}
