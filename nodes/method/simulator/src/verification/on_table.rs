//! Contact and friction compared with Coulomb's law.

use super::comparison::Comparison;
use super::error::VerificationError;
use super::specimen::{GRAVITY_M_S2, at_rest, bar, grip};
use crate::beam::{Beam, BeamParameters, Discretisation, GripState, Table};

const FRICTION: f64 = 0.5;
const HALF_HEIGHT_M: f64 = 0.0075;

fn on_table(p: BeamParameters) -> BeamParameters {
    BeamParameters { table: Some(Table { damping_time_s: 5e-3, ..Table::new(0.0, FRICTION) }), ..p }
}

/// Stopping distance of a stiff bar on the table, compared with v^2 / 2 mu g; at rest the table carries its weight.
pub(super) fn stopping_distance(d: &Discretisation) -> Result<Vec<Comparison>, VerificationError> {
    let p = BeamParameters { clamped: false, kelvin_voigt_time_s: 1e-3, ..on_table(bar(0.2, 1e6)) };
    let mut beam = Beam::new(p, *d, GripState { z_m: HALF_HEIGHT_M - 1e-4, ..grip(0.0) })?;
    beam.advance_to(0.5, |_| grip(0.0));
    let carried_n = beam.table_force().normal_n;
    let mut rows = vec![Comparison::new("weight on the table".into(), "N", carried_n, p.mass_kg() * GRAVITY_M_S2)];
    for speed_m_s in [0.2, 0.4] {
        beam.set_velocity([speed_m_s, 0.0]);
        let from_m = beam.tip()[0];
        beam.advance_to(0.5, |_| grip(0.0));
        let expected_m = speed_m_s * speed_m_s / (2.0 * FRICTION * GRAVITY_M_S2);
        rows.push(Comparison::new(format!("from {speed_m_s} m/s"), "m", beam.tip()[0] - from_m, expected_m));
    }
    Ok(rows)
}

/// Soft bar dragged by the grip at a steady speed: table friction and grip pull compared with mu times the normal
/// force, and the load on table and grip compared with the weight.
pub(super) fn drag_force(d: &Discretisation) -> Result<Vec<Comparison>, VerificationError> {
    let p = BeamParameters { kelvin_voigt_time_s: 0.02, ..on_table(bar(0.25, 2e4)) };
    // The free end trails behind: the grip pulls it in the direction in which it cannot buckle.
    let path = |time_s: f64| GripState { x_m: -0.05 * time_s, z_m: 0.03, ..grip(0.0) };
    let mut beam = at_rest(p, d, path(0.0))?;
    beam.advance_to(2.0, path);
    let (table, hand) = (beam.table_force(), beam.grip_reaction());
    let expected_n = FRICTION * table.normal_n;
    Ok(vec![
        Comparison::new("friction".into(), "N", table.friction_n, expected_n),
        Comparison::new("pull of the grip".into(), "N", -hand.force_x_n, expected_n),
        Comparison::new(
            "weight on table and grip".into(),
            "N",
            hand.force_z_n + table.normal_n,
            p.mass_kg() * GRAVITY_M_S2,
        ),
    ])
}
