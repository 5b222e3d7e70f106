//! Friction of the joints.

use crate::panda::chain::{JointMatrix, Joints};

/// Sigmoid friction: (maximum N m, slope s/rad, offset rad/s) of each joint. Supplement of Gaz et al., RA-L 4(4), 2019.
const SIGMOID: [(f64, f64, f64); 7] = [
    (0.54615, 5.1181, 0.039533),
    (0.87224, 9.0657, 0.025882),
    (0.64068, 10.136, -0.04607),
    (1.2794, 5.5903, 0.036194),
    (0.83904, 8.3469, 0.026226),
    (0.30301, 17.133, -0.021047),
    (0.56489, 10.336, 0.0035526),
];
/// Speed at which stiction has fallen to 1/e, rad/s (Stribeck speed). Chosen: below the speeds at which the sigmoid acts.
const STRIBECK_RAD_S: f64 = 0.02;
/// Sweeps of the projected Gauss-Seidel iteration. Chosen: eight leave 1e-6 rad/s.
const SWEEPS: usize = 8;

/// Friction of the joints.
#[derive(Debug, Clone, Copy)]
pub struct Friction {
    ratio: f64,
    stiction: Joints,
    /// Value of each sigmoid at rest, which is subtracted.
    at_rest: Joints,
}

impl Friction {
    /// Friction with a scale of the sigmoids, and with stiction, N m.
    pub fn new(ratio: f64, stiction_n_m: [f64; 7]) -> Self {
        let at_rest = Joints::from_fn(|i, _| {
            let (most, slope, offset) = SIGMOID[i];
            most / (1.0 + (-slope * offset).exp())
        });
        Self { ratio, stiction: Joints::from(stiction_n_m), at_rest }
    }

    /// Torque against the motion at speeds `dq` (rad/s), N m. Zero at rest.
    pub fn viscous(&self, dq: &Joints) -> Joints {
        if self.ratio == 0.0 {
            return Joints::zeros();
        }
        Joints::from_fn(|i, _| {
            let (most, slope, offset) = SIGMOID[i];
            self.ratio * (most / (1.0 + (-slope * (dq[i] + offset)).exp()) - self.at_rest[i])
        })
    }

    /// Speeds after stiction has opposed the motion for a substep. `free`: speeds without stiction, rad/s. `inverse`: inverse
    /// inertia.
    ///
    /// Impulses within the stiction bring each joint to rest as far as they can: projected Gauss-Seidel, as for dry contacts.
    pub fn stick(&self, dq: &Joints, free: Joints, inverse: &JointMatrix, step_s: f64) -> Joints {
        let bound = Joints::from_fn(|i, _| {
            let ratio = dq[i] / STRIBECK_RAD_S;
            self.stiction[i] * (-ratio * ratio).exp() * step_s
        });
        if bound.amax() == 0.0 {
            return free;
        }
        let (mut speed, mut impulse) = (free, Joints::zeros());
        for _ in 0..SWEEPS {
            for i in 0..7 {
                // Not `clamp`, which panics where a simulation has diverged: the plant checks its numbers after the step.
                let wanted = (impulse[i] - speed[i] / inverse[(i, i)]).min(bound[i]).max(-bound[i]);
                speed += inverse.column(i) * (wanted - impulse[i]);
                impulse[i] = wanted;
            }
        }
        // All joints stick: the iteration leaves a creep that real stiction does not have.
        let sticks = (0..7).all(|i| impulse[i].abs() < bound[i]);
        if sticks { Joints::zeros() } else { speed }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn friction_vanishes_at_rest_and_opposes_motion_at_both_signs() {
        let friction = Friction::new(1.0, [0.0; 7]);
        assert!(friction.viscous(&Joints::zeros()).amax() < 1e-15);
        for speed in [-1.0, -0.1, 0.1, 1.0] {
            let torque = friction.viscous(&Joints::repeat(speed));
            assert!(torque.iter().all(|t| t * speed > 0.0), "{speed} rad/s: {torque}");
        }
    }
}
