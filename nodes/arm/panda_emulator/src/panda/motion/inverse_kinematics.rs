//! Inverse kinematics with a given position of joint 3, which is the elbow's angle in the FCI.

use crate::panda::chain::{Chain, Frame, JointMatrix, Joints};

/// Error of translation (m) and rotation (rad) at which the iteration ends. A jerk is 1e9 times an error.
const PRECISION: f64 = 1e-13;
/// Maximum number of iterations. Convergence is quadratic, and a step within the limits needs two.
const MAX_ITERATIONS: usize = 6;

/// Returns joint angles near `start` that bring the end effector to `pose` and joint 3 to `elbow_rad`. Returns `None` at a
/// singularity or far away.
pub fn solve(pose: &Frame, tool: &Frame, start: &Joints, elbow_rad: f64) -> Option<Joints> {
    let mut q = *start;
    for _ in 0..MAX_ITERATIONS {
        let chain = Chain::at(&q);
        let hand = chain.flange.then(tool);
        let step = hand.step_to(pose);
        let mut error = Joints::zeros();
        error.fixed_rows_mut::<6>(0).copy_from(&step);
        error[6] = elbow_rad - q[2];
        if error.iter().all(|v| v.abs() < PRECISION) {
            return Some(q);
        }
        let mut matrix = JointMatrix::zeros();
        matrix.fixed_view_mut::<6, 7>(0, 0).copy_from(&chain.jacobian(&hand.origin));
        matrix[(6, 2)] = 1.0;
        q += matrix.lu().solve(&error)?;
    }
    // Rounding near the edge of the workspace may keep the error above the precision.
    let rest = Chain::at(&q).flange.then(tool).step_to(pose);
    // The greatest of several numbers may pass over NaN.
    rest.iter().all(|v| v.abs() < 1e-9).then_some(q)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::panda::settings::READY_RAD;

    #[test]
    fn solution_reaches_pose_and_elbow() {
        let tool = Frame { origin: [0.0, 0.0, 0.1034].into(), ..Frame::identity() };
        let start = Joints::from(READY_RAD);
        let pose = Chain::at(&start).flange.then(&tool).moved(&[0.05, -0.03, 0.02, 0.1, -0.2, 0.05].into(), 1.0);
        let q = solve(&pose, &tool, &start, 0.1).unwrap();
        let reached = Chain::at(&q).flange.then(&tool);
        assert!(reached.step_to(&pose).amax() < 1e-12 && (q[2] - 0.1).abs() < 1e-12, "{q}");
        let far = Frame { origin: [2.0, 0.0, 0.3].into(), ..pose };
        assert_eq!(solve(&far, &tool, &start, 0.0), None);
    }
}
