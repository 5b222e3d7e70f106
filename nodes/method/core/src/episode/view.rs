//! Keypoints outside of the camera's view: which ones, on which side, and the view that would hold them.

use crate::Camera;
use crate::camera::Pinhole;

/// Margin of a proposed view on each side, as a share of its side.
const MARGIN: f64 = 0.05;

/// Keypoint that leaves the view on one side.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OutOfView {
    /// Index of the keypoint in its frame, 0 to 3.
    pub keypoint: usize,
    /// Side of the image: left, right, top or bottom.
    pub side: &'static str,
    /// Number of frames in which it is there.
    pub frames: usize,
    /// Index of the first of them.
    pub first: usize,
}

/// Finds the keypoints outside of the image, from coordinates (x, y) scaled to -1 .. 1 over it, x to the right and y down.
pub fn out_of_view(frames: &[[[f64; 2]; 4]]) -> Vec<OutOfView> {
    // Side, axis of the image, and sign of the coordinate beyond it.
    let sides = [("left", 0, -1.0), ("right", 0, 1.0), ("top", 1, -1.0), ("bottom", 1, 1.0)];
    let places = (0..4).flat_map(|keypoint| sides.map(move |side| (keypoint, side)));
    let one = |(keypoint, (side, axis, sign)): (usize, (&'static str, usize, f64))| {
        let is_out = |f: &[[f64; 2]; 4]| sign * f[keypoint][axis] > 1.0;
        let mut out = frames.iter().enumerate().filter(|(_, f)| is_out(f)).map(|(i, _)| i);
        let first = out.next()?;
        Some(OutOfView { keypoint, side, frames: 1 + out.count(), first })
    };
    places.filter_map(one).collect()
}

/// Fields of the model's camera that would show all points (x, z) in m of the plane, as text.
pub fn view_of(camera: &Camera, points_m: &[[f64; 2]]) -> String {
    let ends = |axis: usize| {
        points_m
            .iter()
            .map(|p| p[axis])
            .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], v| [low.min(v), high.max(v)])
    };
    let (x, z) = (ends(0), ends(1));
    let centre = [x, z].map(|[low, high]| 0.5 * (low + high));
    let extent_m = (x[1] - x[0]).max(z[1] - z[0]);
    // A rolled square that holds an upright one is larger.
    let larger = |roll_rad: f64| roll_rad.sin().abs() + roll_rad.cos().abs();
    match camera {
        Camera::Plane(p) => format!(
            "camera.view.plane with centre_m [{:.3}, {:.3}] and side_m {:.2} holds them",
            centre[0],
            centre[1],
            extent_m * larger(p.roll_rad) * (1.0 + 2.0 * MARGIN)
        ),
        Camera::Pinhole(p) => {
            let side_m = extent_m * larger(p.roll_rad) * (1.0 + 2.0 * MARGIN);
            format!(
                "camera.view.pinhole with look_at_m [{:.3}, 0, {:.3}] from {:.2} m away holds them",
                centre[0],
                centre[1],
                distance_m(p, side_m)
            )
        }
    }
}

/// Distance in m from which the mask, a square cut from the image, shows a square of `side_m`.
fn distance_m(camera: &Pinhole, side_m: f64) -> f64 {
    side_m * camera.focal_px / f64::from(camera.image_width_px.min(camera.image_height_px))
}

/// Warning about keypoints outside of the view in a stream that `name` names; `places` gives time or line of a frame as
/// text. None if all are inside.
pub fn view_warning(
    name: &str,
    camera: &Camera,
    frames: &[[[f64; 2]; 4]],
    points_m: &[[[f64; 2]; 4]],
    place: impl Fn(usize) -> String,
) -> Option<String> {
    let one = |out: &OutOfView| {
        let [x, z] = points_m[out.first][out.keypoint];
        format!(
            "keypoint {} beyond the {} edge in {} of {} frames, the first {} at ({x:.3}, {z:.3}) m",
            out.keypoint + 1,
            out.side,
            out.frames,
            frames.len(),
            place(out.first)
        )
    };
    let out = out_of_view(frames);
    let listed: Vec<String> = out.iter().map(one).collect();
    (!out.is_empty()).then(|| {
        format!(
            "{name}: keypoints outside of the view of the model's camera: {}; a {}",
            listed.join("; "),
            view_of(camera, points_m.as_flattened())
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Plane;

    #[test]
    fn keypoints_are_named_with_side_and_count_and_the_proposed_view_holds_them() {
        let camera = |centre_m, side_m| Camera::Plane(Plane { centre_m, side_m, roll_rad: 0.0, distortion_k1: 0.0 });
        let narrow = camera([0.0, 0.5], 0.6);
        // The free end swings to x = 0.4 m and lies at z = 0.1 m in the last frame.
        let points_m: Vec<[[f64; 2]; 4]> = [0.0, 0.2, 0.35, 0.4]
            .map(|x| [[0.0, 0.7], [0.0, 0.6], [0.0, 0.5], [x, if x < 0.4 { 0.4 } else { 0.1 }]])
            .to_vec();
        let scaled = |camera: &Camera| -> Vec<[[f64; 2]; 4]> {
            points_m.iter().map(|f| f.map(|[x, z]| camera.scaled_from_world([x, 0.0, z]).unwrap())).collect()
        };
        let words = view_warning("track", &narrow, &scaled(&narrow), &points_m, |i| format!("in line {i}")).unwrap();
        for part in [
            "keypoint 4 beyond the right edge in 2 of 4 frames, the first in line 2 at (0.350, 0.400) m",
            "keypoint 4 beyond the bottom edge in 1 of 4 frames, the first in line 3",
            "centre_m [0.200, 0.400] and side_m 0.66",
        ] {
            assert!(words.contains(part), "{part}: {words}");
        }
        let proposed = camera([0.2, 0.4], 0.66);
        assert_eq!(view_warning("track", &proposed, &scaled(&proposed), &points_m, |i| i.to_string()), None);
    }

    #[test]
    fn a_pinhole_camera_is_placed_so_that_it_sees_all_points() {
        let near = Pinhole {
            image_width_px: 640,
            image_height_px: 480,
            focal_px: 600.0,
            position_m: [0.4, -0.5, 0.3],
            look_at_m: [0.4, 0.0, 0.3],
            ..Pinhole::default()
        };
        let points_m = [[[0.4, 0.6], [0.3, 0.4], [0.2, 0.3], [0.0, 0.1]]];
        let words = view_of(&Camera::Pinhole(near), points_m.as_flattened());
        assert!(words.contains("look_at_m [0.200, 0, 0.350] from 0.69 m away"), "{words}");
        let there = Camera::Pinhole(Pinhole { position_m: [0.2, -0.69, 0.35], look_at_m: [0.2, 0.0, 0.35], ..near });
        let scaled = points_m.map(|f| f.map(|[x, z]| there.scaled_from_world([x, 0.0, z]).unwrap()));
        assert_eq!(out_of_view(&scaled), []);
    }
}
