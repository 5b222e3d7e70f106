//! Change of the state at the start. An error would stretch the object, or start another motion than the one asked for.

use super::*;
use crate::beam::StartChange;

fn straight() -> Beam {
    let p = BeamParameters { gravity_m_s2: [0.0; 2], ..bar(0.25, 2e4) };
    Beam::new(p, standard(), grip(0.0)).unwrap()
}

fn changed(offset_m: f64, velocity_m_s: f64) -> Beam {
    let mut beam = straight();
    beam.change_start(&StartChange { offset_m, velocity_m_s });
    beam
}

#[test]
fn no_change_keeps_every_bit() {
    assert_eq!(changed(0.0, 0.0).nodes(), straight().nodes());
}

#[test]
fn displacement_and_velocity_grow_with_the_square_of_the_place() {
    let beam = changed(1e-3, 1e-3);
    assert_close(beam.deformed_length_m(), 0.25, 1e-9);
    for (share, expected) in [(0.5, 0.25e-3), (1.0, 1e-3)] {
        let [_, z] = beam.centre_line_at_deformed_fraction([share])[0];
        assert_close(z, expected, 1e-2);
    }
    assert_close(beam.state.velocity[beam.state.velocity.len() - 1][1], 1e-3, 1e-2);
}

/// The velocities are the rate of the displacements: a later displacement is reached by the velocity.
#[test]
fn velocities_are_the_rate_of_the_displacements() {
    let step_s = 1e-6;
    let (now, later) = (changed(0.08, 0.5), changed(0.08 + 0.5 * step_s, 0.0));
    for ((a, b), v) in now.nodes().iter().zip(later.nodes()).zip(&now.state.velocity) {
        for i in 0..3 {
            assert!(((b[i] - a[i]) / step_s - v[i]).abs() < 1e-4, "{a:?} {b:?} {v:?}");
        }
    }
}
