//! Between wire types and the simulator's.

use catenary_core::camera::Pinhole;
use catenary_core::simulator::{Drive, StartShape};
use catenary_core::{EnvError, GripPose, GripTrajectory, Observation, Policy, RgbImage, SimulationRequest, Transition};
use catenary_msgs::geometry_msgs::msg::{Transform, TransformStamped, Twist, Vector3, Wrench};
use catenary_msgs::sensor_msgs::msg::{CameraInfo, Image};
use catenary_msgs::srv::{SimulateRequest, StepEnvsResponse};
use catenary_msgs::std_msgs::msg::Header;
use catenary_shell::convert::{self, ConvertError};
use nalgebra::{Rotation3, UnitQuaternion};

fn refuse(field: &'static str, expected: &str, got: impl ToString) -> ConvertError {
    ConvertError { field, expected: expected.to_owned(), got: got.to_string() }
}

/// The batch that a request asks for, of a model with `dimension` inferred parameters.
///
/// # Errors
/// [`ConvertError`] naming the field that does not fit.
pub fn simulation_request(r: &SimulateRequest, dimension: usize) -> Result<SimulationRequest, ConvertError> {
    if dimension == 0 || !r.theta.len().is_multiple_of(dimension) {
        return Err(refuse("theta", &format!("rows of {dimension} values"), format!("{} values", r.theta.len())));
    }
    let thetas: Vec<Vec<f64>> = r.theta.chunks_exact(dimension).map(<[f64]>::to_vec).collect();
    let (n, e) = (thetas.len(), r.effect_names.len());
    if r.effects.len() != n * e {
        return Err(refuse("effects", &format!("{n} rows of {e} values"), format!("{} values", r.effects.len())));
    }
    let column = |k: usize| (0..n).map(|i| r.effects[i * e + k]).collect();
    Ok(SimulationRequest {
        effects: r.effect_names.iter().enumerate().map(|(k, name)| (name.clone(), column(k))).collect(),
        drive: drive(r)?,
        start: start_shape(&r.start_shape, &r.start_velocity)?,
        frame_times_s: r.frame_times.clone(),
        target_m: r.target_given.then_some(r.target),
        fidelity: convert::fidelity_from_msg(r.fidelity)?,
        seed: r.seed,
        first_episode: r.first_episode,
        noise: r.noise,
        thetas,
    })
}

fn drive(r: &SimulateRequest) -> Result<Drive, ConvertError> {
    use catenary_core::model::DriveKind;
    Ok(match convert::drive_from_msg(r.drive)? {
        DriveKind::Grip => {
            let g = &r.grip;
            let n = g.time.len();
            if [g.x.len(), g.z.len(), g.pitch.len()] != [n; 3] {
                return Err(refuse(
                    "grip",
                    &format!("{n} values of x, z and pitch"),
                    format!("{}, {}, {}", g.x.len(), g.z.len(), g.pitch.len()),
                ));
            }
            let poses = (0..n).map(|i| GripPose { x_m: g.x[i], z_m: g.z[i], pitch_rad: g.pitch[i] }).collect();
            Drive::Grip(GripTrajectory::new(g.time.clone(), poses).map_err(|e| refuse("grip", "a path", e))?)
        }
        DriveKind::Actions => {
            if !r.actions.len().is_multiple_of(2) {
                return Err(refuse("actions", "pairs (dx, dz)", r.actions.len()));
            }
            Drive::Actions(r.actions.chunks_exact(2).map(|a| [a[0], a[1]]).collect())
        }
        DriveKind::Policy => {
            let policy = Policy::from_bytes(&r.policy).map_err(|e| refuse("policy", "a policy file", e))?;
            Drive::Policy(Box::new(policy))
        }
    })
}

fn start_shape(points: &[f64], velocities: &[f64]) -> Result<StartShape, ConvertError> {
    let four = |field, v: &[f64]| -> Result<[[f64; 2]; 4], ConvertError> {
        if v.len() != 8 {
            return Err(refuse(field, "four pairs (x, z), or nothing", format!("{} values", v.len())));
        }
        Ok(std::array::from_fn(|k| [v[2 * k], v[2 * k + 1]]))
    };
    if points.is_empty() {
        return Ok(StartShape::HangingAtRest);
    }
    let velocities_m_s = if velocities.is_empty() { [[0.0; 2]; 4] } else { four("start_velocity", velocities)? };
    Ok(StartShape::Measured { points_m: four("start_shape", points)?, velocities_m_s })
}

/// Observations, row by row.
#[must_use]
pub fn observations(observations: &[Observation]) -> Vec<f64> {
    observations.iter().flat_map(|o| o.0).collect()
}

/// Pairs (dx, dz) of a flat list.
///
/// # Errors
/// [`EnvError::Input`] for an odd number of values.
pub fn actions(flat: &[f64]) -> Result<Vec<[f64; 2]>, EnvError> {
    if !flat.len().is_multiple_of(2) {
        return Err(EnvError::Input(format!("actions: expected pairs (dx, dz), got {} values", flat.len())));
    }
    Ok(flat.chunks_exact(2).map(|a| [a[0], a[1]]).collect())
}

/// What a step of all environments gave.
#[must_use]
pub fn transitions(transitions: &[Transition]) -> StepEnvsResponse {
    StepEnvsResponse {
        success: true,
        message: String::new(),
        observations: transitions.iter().flat_map(|t| t.observation.0).collect(),
        rewards: transitions.iter().map(|t| t.reward).collect(),
        terminated: transitions.iter().map(|t| t.terminated).collect(),
        truncated: transitions.iter().map(|t| t.truncated).collect(),
        final_observations: transitions.iter().flat_map(|t| t.final_observation.0).collect(),
    }
}

/// A picture as realsense2_camera sends it.
#[must_use]
pub fn image(picture: &RgbImage, header: Header) -> Image {
    Image {
        header,
        height: picture.height,
        width: picture.width,
        encoding: "rgb8".to_owned(),
        is_bigendian: 0,
        step: 3 * picture.width,
        data: picture.data.clone(),
    }
}

/// Intrinsics of the camera.
#[must_use]
pub fn camera_info(camera: &Pinhole, header: Header) -> CameraInfo {
    let (f, cx, cy) =
        (camera.focal_px, 0.5 * f64::from(camera.image_width_px), 0.5 * f64::from(camera.image_height_px));
    CameraInfo {
        header,
        height: camera.image_height_px,
        width: camera.image_width_px,
        distortion_model: "plumb_bob".to_owned(),
        d: vec![camera.distortion_k1, 0.0, 0.0, 0.0, 0.0],
        k: [f, 0.0, cx, 0.0, f, cy, 0.0, 0.0, 1.0],
        r: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        p: [f, 0.0, cx, 0.0, 0.0, f, cy, 0.0, 0.0, 0.0, 1.0, 0.0],
        ..CameraInfo::default()
    }
}

/// A velocity in the plane.
#[must_use]
pub fn twist(velocity_m_s: [f64; 2]) -> Twist {
    let [x, z] = velocity_m_s;
    Twist { linear: Vector3 { x, y: 0.0, z }, ..Twist::default() }
}

/// The object's pull on the hand.
#[must_use]
pub fn wrench(w: &crate::cell::HandWrench) -> Wrench {
    let [x, z] = w.force_n;
    Wrench { force: Vector3 { x, y: 0.0, z }, torque: Vector3 { x: 0.0, y: w.moment_y_n_m, z: 0.0 } }
}

/// From panda_link0 to panda_hand_tcp.
#[must_use]
pub fn hand_transform(grip: &GripPose, header: Header) -> TransformStamped {
    let pose = convert::grip_pose_to_msg(grip);
    let p = pose.position;
    TransformStamped {
        header,
        child_frame_id: "panda_hand_tcp".to_owned(),
        transform: Transform { translation: Vector3 { x: p.x, y: p.y, z: p.z }, rotation: pose.orientation },
    }
}

/// From panda_link0 to the camera's optical frame.
#[must_use]
pub fn camera_transform(camera: &Pinhole, header: Header, child_frame_id: &str) -> TransformStamped {
    let rotation = Rotation3::from_matrix_unchecked(camera.optical_from_world().transpose());
    let q = UnitQuaternion::from_rotation_matrix(&rotation);
    let [x, y, z] = camera.position_m;
    let rotation = catenary_msgs::geometry_msgs::msg::Quaternion { x: q.i, y: q.j, z: q.k, w: q.w };
    TransformStamped {
        header,
        child_frame_id: child_frame_id.to_owned(),
        transform: Transform { translation: Vector3 { x, y, z }, rotation },
    }
}
