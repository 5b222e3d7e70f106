//! Conversions between the cell's types and wire types.

use crate::cell::HandWrench;
use catenary_core::RgbImage;
use catenary_core::camera::Pinhole;
use catenary_msgs::geometry_msgs::msg::{Transform, TransformStamped, Twist, Vector3, Wrench};
use catenary_msgs::sensor_msgs::msg::{CameraInfo, Image};
use catenary_msgs::std_msgs::msg::Header;
use nalgebra::{Rotation3, UnitQuaternion};

/// Converts a picture to an image message as realsense2_camera sends it.
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

/// Converts a camera's intrinsics, with one radial coefficient of the plumb_bob model.
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

/// Converts a velocity in the plane, (x, z) in m/s.
#[must_use]
pub fn twist(velocity_m_s: [f64; 2]) -> Twist {
    let [x, z] = velocity_m_s;
    Twist { linear: Vector3 { x, y: 0.0, z }, ..Twist::default() }
}

/// Converts the object's wrench on the hand.
#[must_use]
pub fn wrench(w: &HandWrench) -> Wrench {
    let [x, z] = w.force_n;
    Wrench { force: Vector3 { x, y: 0.0, z }, torque: Vector3 { x: 0.0, y: w.moment_y_n_m, z: 0.0 } }
}

/// Makes the transform from panda_link0 to the camera's optical frame.
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
