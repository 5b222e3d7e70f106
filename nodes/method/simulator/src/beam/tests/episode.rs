//! Random test episodes: 16 moves of the grip within 8 s, down to the table, on which the bar drags.

use catenary_core::{GripPose, GripTrajectory, seed};
use rand::RngExt;

/// Duration in s.
pub const DURATION_S: f64 = 8.0;
const MOVES: usize = 16;
/// Time constant of the arm in s, and its largest speed in m/s.
// Values of the shipped soft bar's arm.
const LAG_S: f64 = 0.16;
const MAX_SPEED_M_S: f64 = 0.5;
const SAMPLE_S: f64 = 1e-3;

/// Returns the path of the grip in episode `index`. Targets lie up to 6 cm apart in x and z, more often down than up,
/// within the workspace. Each is approached with a first-order lag.
pub fn grip_path(index: u64) -> GripTrajectory {
    let mut rng = seed::rng(11, index);
    let (mut x_m, mut z_m): (f64, f64) = (0.40, 0.42);
    let (mut target_x_m, mut target_z_m): (f64, f64) = (x_m, z_m);
    let samples = (DURATION_S / SAMPLE_S) as usize;
    let (mut times_s, mut poses) = (Vec::new(), Vec::new());
    for k in 0..=samples {
        if k % (samples / MOVES) == 0 && k < samples {
            target_x_m = (target_x_m + rng.random_range(-0.06..0.06)).clamp(0.275, 0.6);
            target_z_m = (target_z_m + rng.random_range(-0.06..0.045)).clamp(0.1, 0.5);
        }
        times_s.push(k as f64 * SAMPLE_S);
        poses.push(GripPose { x_m, z_m, pitch_rad: 0.0 });
        let (gap_x, gap_z) = (target_x_m - x_m, target_z_m - z_m);
        let speed = (gap_x.hypot(gap_z) / LAG_S).max(1e-12);
        let share = SAMPLE_S / LAG_S * (MAX_SPEED_M_S / speed).min(1.0);
        x_m += share * gap_x;
        z_m += share * gap_z;
    }
    GripTrajectory::new(times_s, poses).expect("times increase and poses are finite")
}

/// Returns length in m, Young's modulus in Pa, friction and retardation time in s of episode `index`, over the ranges
/// of the shipped soft bar. Modulus and time are uniform in the logarithm.
pub fn draw(index: u64) -> [f64; 4] {
    let mut rng = seed::rng(12, index);
    [
        rng.random_range(0.195..0.305),
        1e3 * 50_f64.powf(rng.random_range(0.0..1.0)),
        rng.random_range(0.3..0.6),
        0.01 * 5_f64.powf(rng.random_range(0.0..1.0)),
    ]
}
