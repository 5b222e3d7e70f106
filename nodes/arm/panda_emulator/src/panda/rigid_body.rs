//! Rigid-body model of the arm with what its flange carries.

use super::chain::{JointMatrix, Joints};
use crate::fci::Load;
use franka::model::{NativeBackend, RobotModelBackend};
use nalgebra::{Matrix3, Vector3};

/// Gravity in O, m/s^2: the control box reports exactly this.
pub const GRAVITY_M_S2: [f64; 3] = [0.0, 0.0, -9.81];

/// Load without mass.
pub const NO_LOAD: Load = Load { mass_kg: 0.0, centre_m: [0.0; 3], inertia: [0.0; 9] };

/// Rounding that a symmetric inertia and its triangle inequality may have, kg m^2. Chosen: clients compute with 32 bits, too.
const INERTIA_ROUNDING: f64 = 1e-7;

/// Greatest principal inertia, kg m^2, of an inertia that a rigid body can have: finite, symmetric, with principal inertias of 0 or
/// more of which none exceeds the sum of the two others. `None` for an inertia that no body has.
pub fn greatest_principal_inertia(inertia: &[f64; 9]) -> Option<f64> {
    let tensor = Matrix3::from_column_slice(inertia);
    // Larger numbers overflow when they are squared, and no arm carries such a body.
    let numbers_are_sane = inertia.iter().all(|v| v.abs() < 1e100);
    if !numbers_are_sane || (tensor - tensor.transpose()).amax() > INERTIA_ROUNDING {
        return None;
    }
    let principal = tensor.symmetric_eigenvalues();
    let rounding = INERTIA_ROUNDING + principal.amax() * f64::EPSILON.sqrt();
    let possible = principal.min() >= -rounding && 2.0 * principal.max() <= principal.sum() + rounding;
    possible.then(|| principal.max())
}

/// Terms of the equation of motion at one state.
#[derive(Debug, Clone, Copy)]
pub struct Terms {
    /// Mass matrix, kg m^2.
    pub mass: JointMatrix,
    /// Coriolis and centrifugal torques, N m.
    pub coriolis: Joints,
    /// Gravity torques, N m.
    pub gravity: Joints,
}

/// Arm and the load on its flange.
#[derive(Debug, Clone)]
pub struct RigidBody {
    arm: NativeBackend,
    load: Load,
}

impl RigidBody {
    /// Creates the model of a URDF, without load.
    ///
    /// # Errors
    /// The message of the parser, if the URDF describes no arm with seven joints.
    pub fn from_urdf(urdf: &str) -> Result<Self, String> {
        let arm = NativeBackend::from_urdf(urdf).map_err(|e| e.to_string())?;
        Ok(Self { arm, load: NO_LOAD })
    }

    /// Sets the load: all the bodies on the flange, given in the flange's frame.
    pub fn carry(&mut self, loads: &[Load]) {
        self.load = combined(loads);
    }

    /// Terms of the equation of motion at angles `q` (rad) and speeds `dq` (rad/s).
    pub fn terms(&self, q: &Joints, dq: &Joints) -> Terms {
        let (q, dq) = ((*q).into(), (*dq).into());
        let Load { mass_kg, centre_m, inertia } = &self.load;
        let mass = self.arm.mass(&q, inertia, *mass_kg, centre_m);
        let coriolis = self.arm.coriolis(&q, &dq, inertia, *mass_kg, centre_m, &GRAVITY_M_S2);
        let gravity = self.arm.gravity(&q, &GRAVITY_M_S2, *mass_kg, centre_m);
        Terms {
            mass: JointMatrix::from_column_slice(&mass),
            coriolis: Joints::from(coriolis),
            gravity: Joints::from(gravity),
        }
    }
}

/// One body with the mass, centre and inertia of several.
fn combined(loads: &[Load]) -> Load {
    let mass_kg: f64 = loads.iter().map(|l| l.mass_kg).sum();
    if mass_kg <= 0.0 {
        return NO_LOAD;
    }
    let moment: Vector3<f64> = loads.iter().map(|l| Vector3::from(l.centre_m) * l.mass_kg).sum();
    let centre = moment / mass_kg;
    let inertia: Matrix3<f64> = loads
        .iter()
        .map(|l| {
            // Parallel axis theorem.
            let k = (Vector3::from(l.centre_m) - centre).cross_matrix();
            Matrix3::from_column_slice(&l.inertia) - k * k * l.mass_kg
        })
        .sum();
    let mut columns = [0.0; 9];
    columns.copy_from_slice(inertia.as_slice());
    Load { mass_kg, centre_m: centre.into(), inertia: columns }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::panda::plant::PANDA_URDF;
    use franka::model::FER_URDF;

    fn pose(k: u32) -> Joints {
        let low = Joints::from([-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973]);
        let high = Joints::from([2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973]);
        // Golden-ratio steps cover the box evenly without a random source.
        Joints::from_fn(|i, _| {
            let share = (f64::from(k) * 0.618_034 * (1.0 + 0.37 * i as f64)).fract();
            low[i] + share * (high[i] - low[i])
        })
    }

    #[test]
    fn inertias_of_the_plant_stay_near_the_model_of_the_robot() {
        let plant = RigidBody::from_urdf(PANDA_URDF).unwrap();
        let control = RigidBody::from_urdf(FER_URDF).unwrap();
        let (mut gravity, mut mass, mut least) = (0.0_f64, 0.0_f64, f64::INFINITY);
        for k in 0..2000 {
            let (a, b) = (plant.terms(&pose(k), &Joints::zeros()), control.terms(&pose(k), &Joints::zeros()));
            gravity = gravity.max((a.gravity - b.gravity).amax());
            mass = mass.max((a.mass - b.mass).amax());
            least = least.min(a.mass.symmetric_eigenvalues().min());
        }
        assert!(gravity < 0.21, "gravity differs by {gravity} N m");
        assert!(mass < 0.056, "mass matrix differs by {mass} kg m^2");
        assert!(least > 3e-3, "smallest eigenvalue of the mass matrix {least}");
    }

    #[test]
    fn mass_matrix_of_a_research_3_is_positive_so_that_it_can_be_simulated() {
        let body = RigidBody::from_urdf(franka::model::FR3_URDF).unwrap();
        let least = (0..2000).map(|k| body.terms(&pose(k), &Joints::zeros()).mass.symmetric_eigenvalues().min());
        let least = least.fold(f64::INFINITY, f64::min);
        assert!(least > 1e-4, "smallest eigenvalue {least}");
    }

    #[test]
    fn arm_weighs_16_kg_and_every_inertia_is_physical() {
        let numbers = |line: &str| -> Vec<f64> { line.split('"').filter_map(|w| w.parse().ok()).collect() };
        let total: f64 = PANDA_URDF.lines().filter(|l| l.contains("<mass")).map(|l| numbers(l)[0]).sum();
        assert!((total - 16.06).abs() < 0.01, "{total} kg");
        for line in PANDA_URDF.lines().filter(|l| l.contains("<inertia ")) {
            let [xx, xy, xz, yy, yz, zz] = numbers(line)[..] else { panic!("six numbers in {line}") };
            let axes = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz).symmetric_eigenvalues();
            assert!(axes.min() > 0.0 && axes.sum() > 2.0 * axes.max(), "{line}: principal inertias {axes:?}");
        }
    }

    #[test]
    fn loads_combine_by_the_parallel_axis_theorem() {
        let ball = |x: f64| Load { mass_kg: 1.0, centre_m: [x, 0.0, 0.0], inertia: [0.0; 9] };
        let both = combined(&[ball(-0.1), ball(0.3)]);
        assert!((both.mass_kg - 2.0).abs() < 1e-15 && (both.centre_m[0] - 0.1).abs() < 1e-15);
        assert!((both.inertia[4] - 0.08).abs() < 1e-12 && both.inertia[0].abs() < 1e-15, "{both:?}");
    }
}
