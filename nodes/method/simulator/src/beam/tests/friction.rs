//! Contact and friction with the table.

use super::*;

const FRICTION: f64 = 0.5;

fn on_table(p: BeamParameters) -> BeamParameters {
    BeamParameters { table: Some(Table { damping_time_s: 5e-3, ..Table::new(0.0, FRICTION) }), ..p }
}

/// Makes a stiff free bar that lies on the table at rest.
fn lying_bar() -> Beam {
    let p = BeamParameters { clamped: false, kelvin_voigt_time_s: 1e-3, ..on_table(bar(0.2, 1e6)) };
    let mut beam = Beam::new(p, standard(), GripState { z_m: 0.0074, ..grip(0.0) }).unwrap();
    beam.advance_to(0.5, |_| grip(0.0));
    beam
}

#[test]
fn table_carries_the_weight_of_a_lying_bar() {
    let beam = lying_bar();
    let weight_n = beam.parameters().mass_kg() * GRAVITY;
    assert_close(beam.table_force().normal_n, weight_n, 1e-3);
    let sunk_m = 0.0075 - beam.tip()[1];
    assert!((0.0..5e-4).contains(&sunk_m), "{sunk_m}");
}

#[test]
fn bar_on_a_slope_under_the_friction_angle_stays() {
    let mut beam = lying_bar();
    beam.parameters.gravity_m_s2 = [0.25 * GRAVITY, -GRAVITY];
    let from = beam.tip()[0];
    beam.advance_to(1.5, |_| grip(0.0));
    // The slope of 0.25 is half the friction coefficient: the smoothed law creeps at 1.15 mm/s there.
    let crept_m = beam.tip()[0] - from;
    assert!(crept_m.abs() < 1.5e-3 * 1.0, "{crept_m} m in 1 s");
}

#[test]
fn damped_contact_loses_more_energy_in_a_bounce() {
    let rebound_m_s = |damping_time_s: f64| {
        let mut p = BeamParameters { clamped: false, ..on_table(bar(0.2, 1e6)) };
        p.table = p.table.map(|table| Table { damping_time_s, ..table });
        let drop = GripState { z_m: 0.02, ..grip(0.0) };
        let fine = Discretisation { time_step_s: 2e-4, ..standard() };
        let mut beam = Beam::new(p, fine, drop).unwrap();
        let mut fastest = 0.0_f64;
        for k in 1..=60 {
            beam.advance_to(f64::from(k) * 2e-3, |_| drop);
            fastest = fastest.max(beam.momentum_kg_m_s()[1] / p.mass_kg());
        }
        fastest
    };
    let (elastic, damped) = (rebound_m_s(0.0), rebound_m_s(5e-3));
    // Fall from 20 mm to touch at half the height, 7.5 mm.
    let impact = (2.0 * GRAVITY * 0.0125_f64).sqrt();
    assert!(elastic > 0.7 * impact && elastic < 1.02 * impact, "{elastic} m/s after {impact} m/s");
    assert!(damped < 0.7 * elastic, "{damped} and {elastic} m/s");
}
