//! Camera that observes the plane of motion.
//!
//! World: frame panda_link0, m, x forward, y left, z up. Image: pixels, u right, v down, the centre of the first pixel
//! at (0.5, 0.5). Two pixel grids are in use: the image (640 x 480), and the square mask (256 x 256) cut from its
//! middle.

use crate::ModelError;
use nalgebra::{Matrix3, Point3, Vector3};
use serde::{Deserialize, Serialize};

/// Side of the label mask in pixels.
pub const MASK_SIZE_PX: u32 = 256;
/// Half the side of the label mask in pixels: in coordinates scaled to -1 .. 1 over the mask, one pixel is 1 / 128.
pub const HALF_MASK_PX: f64 = 0.5 * MASK_SIZE_PX as f64;

/// Camera together with the cut of the mask from its image.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Camera {
    /// Pinhole camera.
    Pinhole(Pinhole),
    /// Square of the x-z plane, for coordinates measured in the plane y = 0 itself (motion capture, or an import).
    Plane(Plane),
}

/// Pinhole camera with roll and one radial lens coefficient.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Pinhole {
    /// Width of the image in pixels.
    pub image_width_px: u32,
    /// Height of the image in pixels.
    pub image_height_px: u32,
    /// Focal length in pixels.
    pub focal_px: f64,
    /// Centre of projection in m.
    pub position_m: [f64; 3],
    /// Point in the middle of the image, in m.
    pub look_at_m: [f64; 3],
    /// Roll about the optical axis in rad, clockwise along the viewing direction; 0 for an upright camera.
    #[serde(default)]
    pub roll_rad: f64,
    /// First radial coefficient k1 of the lens: a point at r focal lengths from the axis appears at r (1 + k1 r^2).
    #[serde(default)]
    pub distortion_k1: f64,
}

/// Square of the plane y = 0 that serves as an image.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Plane {
    /// (x, z) in m of the middle of the square.
    pub centre_m: [f64; 2],
    /// Side of the square in m.
    pub side_m: f64,
    /// Rotation of the square in rad about its middle, clockwise in a drawing with x to the right and z up.
    #[serde(default)]
    pub roll_rad: f64,
    /// First radial coefficient: a point at r sides from the middle appears at r (1 + k1 r^2).
    #[serde(default)]
    pub distortion_k1: f64,
}

/// Applies the lens: moves `p` from radius r to radius r (1 + k1 r^2).
fn distorted(p: [f64; 2], k1: f64) -> [f64; 2] {
    let scale = 1.0 + k1 * (p[0] * p[0] + p[1] * p[1]);
    p.map(|v| v * scale)
}

/// Inverts [`distorted`] by Newton's method on the radius.
fn undistorted(p: [f64; 2], k1: f64) -> [f64; 2] {
    let seen = p[0].hypot(p[1]);
    if k1 == 0.0 || seen == 0.0 {
        return p;
    }
    let mut r = seen;
    for _ in 0..UNDISTORT_ITERATIONS {
        r -= (r * (1.0 + k1 * r * r) - seen) / (1.0 + 3.0 * k1 * r * r);
    }
    p.map(|v| v * r / seen)
}

/// Plausible ranges, chosen. A value outside is probably in another unit.
const POSITION_M: [f64; 2] = [-20.0, 20.0];
const SIDE_M: [f64; 2] = [0.01, 20.0];
const ROLL_RAD: [f64; 2] = [-std::f64::consts::TAU, std::f64::consts::TAU];
/// Focal length over the image's width: fish-eyes to long lenses. A focal length in mm, of usually 2 to 50, is less.
const FOCAL_RATIO: [f64; 2] = [0.2, 20.0];

/// Rejects a roll beyond one turn, and a lens that folds the image over within one focal length of its axis.
fn check_lens(kind: &str, roll_rad: f64, k1: f64) -> Result<(), ModelError> {
    ModelError::within(&format!("camera.view.{kind}.roll_rad"), ROLL_RAD, "rad", roll_rad)?;
    // The derivative 1 + 3 k1 r^2 of the distorted radius is zero at r = 1 for k1 = -1/3.
    if !(k1.is_finite() && k1 > -1.0 / 3.0) {
        return Err(ModelError::value(format!("camera.view.{kind}.distortion_k1"), "a number above -1/3", k1));
    }
    Ok(())
}

/// Iterations of [`undistorted`]. For lenses that pass [`check_lens`], the fourth already converges to rounding.
const UNDISTORT_ITERATIONS: usize = 8;

/// Rotates `p` counter-clockwise by `angle_rad`.
fn turned([x, y]: [f64; 2], angle_rad: f64) -> [f64; 2] {
    let (sin, cos) = angle_rad.sin_cos();
    [cos * x - sin * y, sin * x + cos * y]
}

impl Camera {
    /// Rejects numbers that make no camera. The error names the field in a model file.
    ///
    /// # Errors
    /// [`ModelError::Value`].
    pub fn check(&self) -> Result<(), ModelError> {
        match self {
            Camera::Pinhole(p) => p.check(),
            Camera::Plane(p) => {
                ModelError::within("camera.view.plane.side_m", SIDE_M, "m", p.side_m)?;
                p.centre_m
                    .iter()
                    .try_for_each(|v| ModelError::within("camera.view.plane.centre_m", POSITION_M, "m", *v))?;
                check_lens("plane", p.roll_rad, p.distortion_k1)
            }
        }
    }

    /// Projects `point_m` (x, y, z) to mask pixel (u, v); none if the point lies behind the camera.
    pub fn mask_from_world(&self, point_m: [f64; 3]) -> Option<[f64; 2]> {
        let size = f64::from(MASK_SIZE_PX);
        match self {
            Camera::Pinhole(p) => p.image_from_world(point_m).map(|px| p.mask_from_image(px)),
            Camera::Plane(p) => {
                let [a, b] = p.lens([(point_m[0] - p.centre_m[0]) / p.side_m, (point_m[2] - p.centre_m[1]) / p.side_m]);
                Some([(a + 0.5) * size, (0.5 - b) * size])
            }
        }
    }

    /// Projects `point_m` (x, y, z) to coordinates scaled to -1 .. 1 over the mask; none if it lies behind the camera.
    pub fn scaled_from_world(&self, point_m: [f64; 3]) -> Option<[f64; 2]> {
        let size = f64::from(MASK_SIZE_PX);
        self.mask_from_world(point_m).map(|px| px.map(|v| 2.0 * v / size - 1.0))
    }

    /// Back-projects mask pixel (u, v) to (x, z) in m in the plane y = 0; none if the ray misses the plane.
    pub fn plane_from_mask(&self, px: [f64; 2]) -> Option<[f64; 2]> {
        let size = f64::from(MASK_SIZE_PX);
        match self {
            Camera::Pinhole(p) => p.plane_from_image(p.image_from_mask(px)),
            Camera::Plane(p) => {
                let [a, b] = p.through_lens([px[0] / size - 0.5, 0.5 - px[1] / size]);
                Some([p.centre_m[0] + a * p.side_m, p.centre_m[1] + b * p.side_m])
            }
        }
    }

    /// Back-projects coordinates scaled to -1 .. 1 over the mask to (x, z) in m in the plane y = 0; none if the ray
    /// misses the plane.
    pub fn plane_from_scaled(&self, scaled: [f64; 2]) -> Option<[f64; 2]> {
        let size = f64::from(MASK_SIZE_PX);
        self.plane_from_mask(scaled.map(|v| 0.5 * (v + 1.0) * size))
    }
}

/// Copies of a camera with another place, roll, focal length or lens.
impl Camera {
    /// Camera moved by `shift_m` (x, y, z) in m, without rotation.
    pub fn moved(self, shift_m: [f64; 3]) -> Self {
        match self {
            Camera::Pinhole(p) => Camera::Pinhole(Pinhole {
                position_m: std::array::from_fn(|i| p.position_m[i] + shift_m[i]),
                look_at_m: std::array::from_fn(|i| p.look_at_m[i] + shift_m[i]),
                ..p
            }),
            Camera::Plane(p) => {
                Camera::Plane(Plane { centre_m: [p.centre_m[0] + shift_m[0], p.centre_m[1] + shift_m[2]], ..p })
            }
        }
    }

    /// Camera rolled further by `angle_rad`, clockwise along its viewing direction.
    pub fn rolled(self, angle_rad: f64) -> Self {
        match self {
            Camera::Pinhole(p) => Camera::Pinhole(Pinhole { roll_rad: p.roll_rad + angle_rad, ..p }),
            Camera::Plane(p) => Camera::Plane(Plane { roll_rad: p.roll_rad + angle_rad, ..p }),
        }
    }

    /// Camera with a focal length `factor` times as long: everything in the image is `factor` times as large.
    pub fn enlarged(self, factor: f64) -> Self {
        match self {
            Camera::Pinhole(p) => Camera::Pinhole(Pinhole { focal_px: p.focal_px * factor, ..p }),
            Camera::Plane(p) => Camera::Plane(Plane { side_m: p.side_m / factor, ..p }),
        }
    }

    /// Camera with `k1` added to the radial coefficient of its lens.
    pub fn distorted(self, k1: f64) -> Self {
        match self {
            Camera::Pinhole(p) => Camera::Pinhole(Pinhole { distortion_k1: p.distortion_k1 + k1, ..p }),
            Camera::Plane(p) => Camera::Plane(Plane { distortion_k1: p.distortion_k1 + k1, ..p }),
        }
    }
}

impl Plane {
    /// Applies roll and lens to the point (a, b), in sides from the middle, x right and z up.
    fn lens(&self, p: [f64; 2]) -> [f64; 2] {
        // Without roll and lens the coordinates keep every bit: an imported track comes out as it went in.
        let p = if self.roll_rad == 0.0 { p } else { turned(p, self.roll_rad) };
        if self.distortion_k1 == 0.0 { p } else { distorted(p, self.distortion_k1) }
    }

    /// Inverse of [`Self::lens`].
    fn through_lens(&self, p: [f64; 2]) -> [f64; 2] {
        let p = undistorted(p, self.distortion_k1);
        if self.roll_rad == 0.0 { p } else { turned(p, -self.roll_rad) }
    }
}

impl Pinhole {
    fn check(&self) -> Result<(), ModelError> {
        let refuse = |field: &str, expected: &str, got: String| {
            Err(ModelError::value(format!("camera.view.pinhole.{field}"), expected, got))
        };
        for (field, side) in [("image_width_px", self.image_width_px), ("image_height_px", self.image_height_px)] {
            if side == 0 {
                return refuse(field, "at least 1", side.to_string());
            }
        }
        let range_px = FOCAL_RATIO.map(|ratio| ratio * f64::from(self.image_width_px));
        ModelError::within("camera.view.pinhole.focal_px", range_px, "px", self.focal_px)?;
        check_lens("pinhole", self.roll_rad, self.distortion_k1)?;
        for (field, point) in [("position_m", self.position_m), ("look_at_m", self.look_at_m)] {
            point
                .iter()
                .try_for_each(|v| ModelError::within(&format!("camera.view.pinhole.{field}"), POSITION_M, "m", *v))?;
        }
        let forward = self.forward();
        // A camera that looks straight up or down has no right direction: its cross product with z is zero.
        if !(forward.norm() > 0.0 && forward.cross(&Vector3::z()).norm() > 1e-9 * forward.norm()) {
            let expected = "a point away from position_m and not straight above or below it";
            return refuse("look_at_m", expected, format!("{:?}", self.look_at_m));
        }
        Ok(())
    }

    fn forward(&self) -> Vector3<f64> {
        Point3::from(self.look_at_m) - Point3::from(self.position_m)
    }

    /// Rotation from the world to the ROS optical frame. Its rows are the camera's right, down and forward directions.
    pub fn optical_from_world(&self) -> Matrix3<f64> {
        let forward = self.forward().normalize();
        let right = forward.cross(&Vector3::z()).normalize();
        let down = forward.cross(&right);
        let (right, down) = if self.roll_rad == 0.0 {
            (right, down)
        } else {
            let (sin, cos) = self.roll_rad.sin_cos();
            (cos * right + sin * down, cos * down - sin * right)
        };
        Matrix3::from_rows(&[right.transpose(), down.transpose(), forward.transpose()])
    }

    /// Projects `point_m` (x, y, z) to image pixel (u, v); none if the point lies behind the camera.
    pub fn image_from_world(&self, point_m: [f64; 3]) -> Option<[f64; 2]> {
        let p = self.optical_from_world() * (Point3::from(point_m) - Point3::from(self.position_m));
        // A point in the plane of the lens would be divided by zero.
        (p.z > 1e-6).then(|| self.image_from_optical(p.into()))
    }

    /// Projects a point in m of the optical frame (x right, y down, z forward) to image pixel (u, v). The point must
    /// lie in front of the camera.
    pub fn image_from_optical(&self, [x, y, z]: [f64; 3]) -> [f64; 2] {
        let bent = if self.distortion_k1 == 0.0 {
            [self.focal_px * x / z, self.focal_px * y / z]
        } else {
            distorted([x / z, y / z], self.distortion_k1).map(|v| self.focal_px * v)
        };
        [0.5 * f64::from(self.image_width_px) + bent[0], 0.5 * f64::from(self.image_height_px) + bent[1]]
    }

    /// Unit direction in the world of the ray through image pixel (u, v).
    pub fn ray_from_image(&self, px: [f64; 2]) -> Vector3<f64> {
        let seen = [
            (px[0] - 0.5 * f64::from(self.image_width_px)) / self.focal_px,
            (px[1] - 0.5 * f64::from(self.image_height_px)) / self.focal_px,
        ];
        let [x, y] = undistorted(seen, self.distortion_k1);
        let in_optical = Vector3::new(x, y, 1.0);
        (self.optical_from_world().transpose() * in_optical).normalize()
    }

    /// Square from which the mask is cut: its side in image pixels, and its left and upper edge.
    pub fn crop(&self) -> (f64, [f64; 2]) {
        let (w, h) = (f64::from(self.image_width_px), f64::from(self.image_height_px));
        let side = w.min(h);
        (side, [0.5 * (w - side), 0.5 * (h - side)])
    }

    fn mask_from_image(&self, px: [f64; 2]) -> [f64; 2] {
        let (side, corner) = self.crop();
        std::array::from_fn(|i| (px[i] - corner[i]) * f64::from(MASK_SIZE_PX) / side)
    }

    fn image_from_mask(&self, px: [f64; 2]) -> [f64; 2] {
        let (side, corner) = self.crop();
        std::array::from_fn(|i| px[i] * side / f64::from(MASK_SIZE_PX) + corner[i])
    }

    fn plane_from_image(&self, px: [f64; 2]) -> Option<[f64; 2]> {
        let ray = self.ray_from_image(px);
        let distance = -self.position_m[1] / ray.y;
        (distance.is_finite() && distance > 0.0)
            .then(|| [self.position_m[0] + distance * ray.x, self.position_m[2] + distance * ray.z])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn side() -> Camera {
        Camera::Pinhole(Pinhole {
            image_width_px: 640,
            image_height_px: 480,
            focal_px: 615.0,
            position_m: [0.44, -1.15, 0.3],
            look_at_m: [0.44, 0.0, 0.27],
            ..Pinhole::default()
        })
    }

    fn square() -> Camera {
        Camera::Plane(Plane { centre_m: [0.1, 0.5], side_m: 1.2, ..Plane::default() })
    }

    #[test]
    fn moved_rolled_enlarged_and_distorted_cameras_see_what_they_should() {
        for c in [side(), square()] {
            let see = |c: &Camera, x: f64, z: f64| c.scaled_from_world([x, 0.0, z]).unwrap();
            let middle = c.plane_from_scaled([0.0, 0.0]).unwrap();
            let [u, _] = see(&c, middle[0] + 0.1, middle[1]);
            let moved = see(&c.moved([0.1, 0.0, 0.0]), middle[0] + 0.1, middle[1]);
            assert!(moved[0].abs() < 1e-9 && moved[1].abs() < 1e-9, "{moved:?}");
            // After a quarter turn clockwise, a point to the right of the middle appears above it.
            let rolled = see(&c.rolled(std::f64::consts::FRAC_PI_2), middle[0] + 0.1, middle[1]);
            assert!(rolled[0].abs() < 1e-9 && (rolled[1] + u).abs() < 1e-9, "{rolled:?} for {u}");
            assert!((see(&c.enlarged(1.5), middle[0] + 0.1, middle[1])[0] - 1.5 * u).abs() < 1e-9);
            let barrel = see(&c.distorted(-0.2), middle[0] + 0.1, middle[1])[0];
            assert!(barrel < u && barrel > 0.97 * u, "{barrel} for {u}");
        }
    }

    #[test]
    fn right_is_plus_x_and_up_is_plus_z() {
        let c = side();
        let middle = c.mask_from_world([0.44, 0.0, 0.27]).unwrap();
        assert!((middle[0] - 128.0).abs() < 1e-9 && (middle[1] - 128.0).abs() < 1e-9);
        assert!(c.mask_from_world([0.5, 0.0, 0.27]).unwrap()[0] > 128.0);
        assert!(c.mask_from_world([0.44, 0.0, 0.4]).unwrap()[1] < 128.0);
        assert_eq!(c.mask_from_world([0.44, -3.0, 0.27]), None);
    }

    proptest! {
        #[test]
        fn back_projection_inverts_projection(x in 0.1f64..0.8, z in 0.0f64..0.6) {
            for c in [side(), square(), side().rolled(0.2).distorted(-0.2), square().rolled(-0.4).distorted(0.3)] {
                let back = c.plane_from_mask(c.mask_from_world([x, 0.0, z]).unwrap()).unwrap();
                prop_assert!((back[0] - x).abs() < 1e-9 && (back[1] - z).abs() < 1e-9);
            }
        }
    }
}
