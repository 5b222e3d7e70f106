//! Static shapes.

use super::*;
use crate::beam::MeasuredPoint;
use catenary_core::model::AxialLaw;

fn elements(count: usize) -> Discretisation {
    Discretisation { elements: count, ..standard() }
}

#[test]
fn tip_mass_and_weight_add_up_in_a_hanging_bar() {
    let p = BeamParameters { tip_mass_kg: 0.02, ..bar(0.2, 2e4) };
    let beam = hanging(p, standard(), grip(DOWN));
    let expected = DENSITY * GRAVITY * 0.04 / (2.0 * 2e4) + 0.02 * GRAVITY * 0.2 / p.axial_stiffness_n;
    assert_close(beam.deformed_length_m() - 0.2, expected, 1e-9);
    assert_close(beam.grip_reaction().force_z_n, p.mass_kg() * GRAVITY, 1e-9);
}

#[test]
fn weightless_bar_takes_its_rest_curvature() {
    let curvature = 9.0;
    let p = BeamParameters { rest_curvature_per_m: curvature, gravity_m_s2: [0.0; 2], ..bar(0.2, 1e4) };
    let beam = hanging(p, elements(40), grip(0.3));
    let turn: f64 = curvature * 0.2;
    let (along, across) = (turn.sin() / curvature, (1.0 - turn.cos()) / curvature);
    let (sin, cos) = 0.3_f64.sin_cos();
    let expected = [cos * along - sin * across, sin * along + cos * across];
    let tip = beam.tip();
    assert!((tip[0] - expected[0]).hypot(tip[1] - expected[1]) < 1e-4, "{tip:?}, not {expected:?}");
}

#[test]
fn grip_reaction_carries_weight_and_moment() {
    for overhang_m in [0.0, 0.03] {
        let p = BeamParameters { overhang_m, ..bar(0.2, 1e9) };
        let beam = hanging(p, standard(), grip(0.0));
        let reaction = beam.grip_reaction();
        let load = p.mass_per_length_kg_m * GRAVITY;
        assert!(reaction.force_x_n.abs() < 1e-7, "{reaction:?}");
        assert_close(reaction.force_z_n, load * 0.2, 1e-6);
        assert_close(reaction.moment_n_m, 0.5 * load * ((0.2 - overhang_m).powi(2) - overhang_m.powi(2)), 1e-4);
    }
}

#[test]
fn soft_bar_clamped_upright_falls_over() {
    let beam = hanging(bar(0.3, 1e4), standard(), grip(-DOWN));
    assert!(beam.tip()[1] < 0.0, "{:?}", beam.tip());
}

/// A free beam has no shape at rest.
#[test]
fn shapes_that_are_not_at_rest_are_counted_until_the_reset() {
    let p = BeamParameters { clamped: false, ..bar(0.2, 1e4) };
    let mut beam = Beam::new(p, standard(), grip(0.0)).unwrap();
    assert!(!beam.hang_at_rest(grip(0.0)).converged);
    assert_eq!(beam.counters().unconverged_equilibria, 1);
    assert!(!beam.set_shape(grip(0.0), [0.0; 3], &[]).converged);
    assert_eq!(beam.counters().unconverged_equilibria, 2);
    beam.reset(bar(0.2, 1e4), grip(0.0)).unwrap();
    assert!(beam.hang_at_rest(grip(0.0)).converged);
    assert_eq!(beam.counters(), crate::beam::Counters::default());
}

#[test]
fn bar_that_reaches_the_table_rests_on_it_over_the_prior_range() {
    for youngs_modulus_pa in [1e3, 1e4, 5e4] {
        for length_m in [0.195, 0.305] {
            // From free hanging to lying almost flat.
            for height_m in [0.4, 0.2, 0.1, 0.05, 0.02] {
                let p = BeamParameters { table: Some(Table::new(0.0, 0.5)), ..bar(length_m, youngs_modulus_pa) };
                let beam = hanging(p, standard(), GripState { z_m: height_m, ..grip(0.0) });
                let lowest =
                    beam.nodes().iter().map(|q| q[1] - 0.0075 * q[2].cos().abs()).fold(f64::INFINITY, f64::min);
                assert!(lowest > -1.5e-3, "{youngs_modulus_pa} Pa, {length_m} m at {height_m} m: {lowest} m");
            }
        }
    }
}

/// The slip distance of friction grows with the step, and the descent to rest has long steps. It must not decide when
/// Newton's method stops.
#[test]
fn soft_tip_that_lies_on_the_table_comes_to_rest() {
    let fast = Discretisation::of(Fidelity::Fast);
    for axial_law in [AxialLaw::Linear, AxialLaw::NeoHookean] {
        let table = Some(Table::new(0.0, 0.5));
        let p = BeamParameters { axial_law, stiffness_gradient: -0.8, table, ..bar(0.305, 1528.8) };
        hanging(p, fast, GripState { x_m: 0.4, z_m: 0.42, tangent_rad: 0.0 });
    }
}

#[test]
fn measured_shape_in_motion_is_recovered_from_four_points() {
    let p = BeamParameters { kelvin_voigt_time_s: 0.02, ..bar(0.25, 2e4) };
    let path = |time_s: f64| GripState { x_m: 0.05 * (6.0 * time_s).sin(), ..grip(0.0) };
    let mut truth = hanging(p, standard(), path(0.0));
    // The measured cable's keypoints.
    let fractions = [0.25, 0.5, 0.75, 1.0];
    truth.advance_to(0.79, path);
    let before = truth.centre_line_at_deformed_fraction(fractions);
    truth.advance_to(0.80, path);
    let now = truth.centre_line_at_deformed_fraction(fractions);
    truth.advance_to(0.81, path);
    let after = truth.centre_line_at_deformed_fraction(fractions);
    let points: Vec<MeasuredPoint> = (0..4)
        .map(|i| MeasuredPoint {
            fraction: fractions[i],
            position_m: now[i],
            velocity_m_s: [0, 1].map(|axis| (after[i][axis] - before[i][axis]) / 0.02),
        })
        .collect();
    let grip_velocity = [0.3 * (6.0_f64 * 0.8).cos(), 0.0, 0.0];
    let mut fitted = Beam::new(p, standard(), grip(0.0)).unwrap();
    let equilibrium = fitted.set_shape(path(0.8), grip_velocity, &points);
    assert!(equilibrium.converged, "{equilibrium:?}");
    let apart = |a: &Beam, b: &Beam| {
        let between = [0.125, 0.375, 0.625, 0.875, 1.0];
        let (a, b) = (a.centre_line_at_deformed_fraction(between), b.centre_line_at_deformed_fraction(between));
        a.iter().zip(&b).map(|(a, b)| (a[0] - b[0]).hypot(a[1] - b[1])).fold(0.0, f64::max)
    };
    let mut truth_again = hanging(p, standard(), path(0.0));
    truth_again.advance_to(0.8, path);
    let at_start = apart(&truth_again, &fitted);
    truth_again.advance_to(1.0, path);
    fitted.advance_to(0.2, |time_s| path(0.8 + time_s));
    let later = apart(&truth_again, &fitted);
    println!("fit: {at_start} m at the start, {later} m after 0.2 s");
    assert!(at_start < 2e-3 && later < 4e-3, "{at_start} m at the start, {later} m after 0.2 s");
}
