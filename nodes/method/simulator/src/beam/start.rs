//! Change of the state at the start: the beam is bent, and swings.

use super::body::Beam;

/// Change of the state at the start: displacement and velocity across the centre line.
///
/// Both are a uniform change of curvature: at the share s of the length from the grip they are s^2 of those of the tip, for
/// small angles. No element is stretched.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct StartChange {
    /// Displacement of the tip in m.
    pub offset_m: f64,
    /// Velocity of the tip in m/s.
    pub velocity_m_s: f64,
}

impl Beam {
    /// Bends the present shape, and adds velocities, by `change`. The result is the state at time 0. Positive values turn the
    /// tip counter-clockwise.
    pub fn change_start(&mut self, change: &StartChange) {
        // Nothing to change: not even the last bits.
        if *change == StartChange::default() {
            return;
        }
        let origin = self.mesh.origin;
        // Lengths as stretched by the load.
        let length_m = self.deformed_length_m();
        // The displacement of a uniform curvature c is c (s L)^2 / 2.
        let per_length = |value: f64| 2.0 * value / (length_m * length_m);
        let (mut turn, mut rate) = (0.0, 0.0);
        let mut from = self.state.position[origin];
        let mut at = from;
        let mut velocity = self.state.velocity[origin];
        let mut from_velocity = velocity;
        for k in origin..self.mesh.elements.len() {
            let (to, to_velocity) = (self.state.position[k + 1], self.state.velocity[k + 1]);
            let chord_m = (to[0] - from[0]).hypot(to[1] - from[1]);
            let [bent, spun] = [change.offset_m, change.velocity_m_s].map(|v| chord_m * per_length(v));
            // The chord turns by the mean of its ends' turns.
            let (sin, cos) = (turn + 0.5 * bent).sin_cos();
            let turned = |[x, z]: [f64; 2]| [cos * x - sin * z, sin * x + cos * z];
            let chord = turned([to[0] - from[0], to[1] - from[1]]);
            let grown = turned([to_velocity[0] - from_velocity[0], to_velocity[1] - from_velocity[1]]);
            let spin = rate + 0.5 * spun;
            at = [at[0] + chord[0], at[1] + chord[1], to[2] + turn + bent];
            velocity = [
                velocity[0] + grown[0] - spin * chord[1],
                velocity[1] + grown[1] + spin * chord[0],
                to_velocity[2] + rate + spun,
            ];
            (from, from_velocity) = (to, to_velocity);
            (self.state.position[k + 1], self.state.velocity[k + 1]) = (at, velocity);
            (turn, rate) = (turn + bent, rate + spun);
        }
        self.start_here();
    }
}
