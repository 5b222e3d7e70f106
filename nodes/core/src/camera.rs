//! The camera that looks at the plane of motion.
//!
//! World: frame panda_link0, m, x forward, y left, z up. Image: pixels, u right, v down, the centre of the first pixel at
//! (0.5, 0.5). Two pixel grids are in use: the image (640 x 480) and the square mask (256 x 256) that is cut from its middle.

use crate::ModelError;
use nalgebra::{Matrix3, Point3, Vector3};
use serde::{Deserialize, Serialize};

/// Side of the label mask in pixels.
pub const MASK_SIZE_PX: u32 = 256;

/// A camera and how the mask is cut from its image.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Camera {
    /// A pinhole camera.
    Pinhole(Pinhole),
    /// Coordinates measured in the plane y = 0 itself (motion capture, or an import): a square of the x-z plane.
    Plane(Plane),
}

/// A pinhole camera without distortion, upright.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
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
    /// The point that the middle of the image shows, in m.
    pub look_at_m: [f64; 3],
}

/// A square of the plane y = 0, as an image of its own.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Plane {
    /// (x, z) in m of the middle of the square.
    pub centre_m: [f64; 2],
    /// Side of the square in m.
    pub side_m: f64,
}

impl Camera {
    /// Rejects numbers that make no camera; names the field in a model file.
    ///
    /// # Errors
    /// [`ModelError::Value`].
    pub fn check(&self) -> Result<(), ModelError> {
        match self {
            Camera::Pinhole(p) => p.check(),
            Camera::Plane(p) if !(p.side_m > 0.0 && p.side_m.is_finite()) => {
                Err(ModelError::value("camera.view.plane.side_m", "a positive length", p.side_m))
            }
            Camera::Plane(p) if !p.centre_m.iter().all(|v| v.is_finite()) => {
                Err(ModelError::value("camera.view.plane.centre_m", "finite numbers", format!("{:?}", p.centre_m)))
            }
            Camera::Plane(_) => Ok(()),
        }
    }

    /// Mask pixel (u, v) that shows `point_m` (x, y, z); none where the point lies behind the camera.
    pub fn mask_from_world(&self, point_m: [f64; 3]) -> Option<[f64; 2]> {
        let size = f64::from(MASK_SIZE_PX);
        match self {
            Camera::Pinhole(p) => p.image_from_world(point_m).map(|px| p.mask_from_image(px)),
            Camera::Plane(p) => Some([
                ((point_m[0] - p.centre_m[0]) / p.side_m + 0.5) * size,
                (0.5 - (point_m[2] - p.centre_m[1]) / p.side_m) * size,
            ]),
        }
    }

    /// The same, scaled to -1 .. 1 over the mask.
    pub fn scaled_from_world(&self, point_m: [f64; 3]) -> Option<[f64; 2]> {
        let size = f64::from(MASK_SIZE_PX);
        self.mask_from_world(point_m).map(|px| px.map(|v| 2.0 * v / size - 1.0))
    }

    /// (x, z) in m of the point of the plane y = 0 that mask pixel (u, v) shows; none where the ray misses the plane.
    pub fn plane_from_mask(&self, px: [f64; 2]) -> Option<[f64; 2]> {
        let size = f64::from(MASK_SIZE_PX);
        match self {
            Camera::Pinhole(p) => p.plane_from_image(p.image_from_mask(px)),
            Camera::Plane(p) => {
                Some([p.centre_m[0] + (px[0] / size - 0.5) * p.side_m, p.centre_m[1] + (0.5 - px[1] / size) * p.side_m])
            }
        }
    }

    /// The same for coordinates scaled to -1 .. 1 over the mask.
    pub fn plane_from_scaled(&self, scaled: [f64; 2]) -> Option<[f64; 2]> {
        let size = f64::from(MASK_SIZE_PX);
        self.plane_from_mask(scaled.map(|v| 0.5 * (v + 1.0) * size))
    }
}

impl Pinhole {
    fn check(&self) -> Result<(), ModelError> {
        let refuse = |field: &str, expected: &str, got: String| {
            Err(ModelError::value(format!("camera.view.pinhole.{field}"), expected, got))
        };
        if !(self.focal_px > 0.0 && self.focal_px.is_finite()) {
            return refuse("focal_px", "a positive number", self.focal_px.to_string());
        }
        for (field, side) in [("image_width_px", self.image_width_px), ("image_height_px", self.image_height_px)] {
            if side == 0 {
                return refuse(field, "at least 1", side.to_string());
            }
        }
        for (field, point) in [("position_m", self.position_m), ("look_at_m", self.look_at_m)] {
            if !point.iter().all(|v| v.is_finite()) {
                return refuse(field, "finite numbers", format!("{point:?}"));
            }
        }
        let forward = self.forward();
        if !(forward.norm() > 0.0 && forward.cross(&Vector3::z()).norm() > 1e-9 * forward.norm()) {
            let expected = "a point away from position_m and not straight above or below it";
            return refuse("look_at_m", expected, format!("{:?}", self.look_at_m));
        }
        Ok(())
    }

    fn forward(&self) -> Vector3<f64> {
        Point3::from(self.look_at_m) - Point3::from(self.position_m)
    }

    /// Rotation whose rows are the camera's right, down and forward directions in the world: the ROS optical frame.
    pub fn optical_from_world(&self) -> Matrix3<f64> {
        let forward = self.forward().normalize();
        let right = forward.cross(&Vector3::z()).normalize();
        let down = forward.cross(&right);
        Matrix3::from_rows(&[right.transpose(), down.transpose(), forward.transpose()])
    }

    /// Image pixel (u, v) that shows `point_m`; none where the point lies behind the camera.
    pub fn image_from_world(&self, point_m: [f64; 3]) -> Option<[f64; 2]> {
        let p = self.optical_from_world() * (Point3::from(point_m) - Point3::from(self.position_m));
        (p.z > 1e-6).then(|| {
            [
                0.5 * f64::from(self.image_width_px) + self.focal_px * p.x / p.z,
                0.5 * f64::from(self.image_height_px) + self.focal_px * p.y / p.z,
            ]
        })
    }

    /// Direction in the world (unit length) of the ray through image pixel (u, v).
    pub fn ray_from_image(&self, px: [f64; 2]) -> Vector3<f64> {
        let in_optical = Vector3::new(
            (px[0] - 0.5 * f64::from(self.image_width_px)) / self.focal_px,
            (px[1] - 0.5 * f64::from(self.image_height_px)) / self.focal_px,
            1.0,
        );
        (self.optical_from_world().transpose() * in_optical).normalize()
    }

    /// Side in image pixels of the square that the mask is cut from, and its left and upper edge.
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
        })
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
            let plane = Camera::Plane(Plane { centre_m: [0.1, 0.5], side_m: 1.2 });
            for c in [side(), plane] {
                let back = c.plane_from_mask(c.mask_from_world([x, 0.0, z]).unwrap()).unwrap();
                prop_assert!((back[0] - x).abs() < 1e-9 && (back[1] - z).abs() < 1e-9);
            }
        }
    }
}
