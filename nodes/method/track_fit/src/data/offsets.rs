//! Offsets between measured and simulated keypoints in the plane of motion.

use super::episode::MeasuredEpisode;
use catenary_core::{Camera, Frame, KeypointOrder, Track};

impl MeasuredEpisode {
    /// Offsets between the measured and a simulated track, see [`offsets_mm`].
    pub fn offsets_mm(&self, simulated: &Track, camera: &Camera) -> Vec<Offset> {
        offsets_mm(&self.measured, simulated, self.order, camera)
    }
}

impl MeasuredEpisode {
    /// Root mean square distance of keypoints by noise alone, in the plane of motion, mm. None if every line of sight misses the
    /// plane.
    pub fn noise_mm(&self, camera: &Camera) -> Option<f64> {
        let (mut sum, mut count) = (0.0, 0.0);
        for point in self.measured.frames.iter().flat_map(|frame| frame.dlo) {
            let moved = [[self.keypoint_sd, 0.0], [0.0, self.keypoint_sd]].map(|by| {
                let [there, here] = [[point[0] + by[0], point[1] + by[1]], point].map(|p| camera.plane_from_scaled(p));
                there.zip(here).map(|(a, b)| (a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2))
            });
            if let [Some(x), Some(y)] = moved {
                sum += x + y;
                count += 1.0;
            }
        }
        (count > 0.0).then(|| 1e3 * (sum / count).sqrt())
    }
}

/// Keypoint offsets of a frame in the plane of motion, mm: x and z of each keypoint. None if a line of sight misses the
/// plane.
pub type Offset = Option<[f64; 8]>;

/// Keypoints of `measured` less those of `simulated` in the plane of motion, a row a measured frame.
pub fn offsets_mm(measured: &Track, simulated: &Track, order: KeypointOrder, camera: &Camera) -> Vec<Offset> {
    let Some(last) = simulated.frames.len().checked_sub(1) else { return vec![None; measured.frames.len()] };
    let offset = |(i, seen): (usize, &Frame)| {
        let predicted = &simulated.frames[i.min(last)];
        let order = order.closest(&seen.dlo, &predicted.dlo);
        let mut offset = [0.0; 8];
        for k in 0..4 {
            let a = camera.plane_from_scaled(seen.dlo[order[k]])?;
            let b = camera.plane_from_scaled(predicted.dlo[k])?;
            (0..2).for_each(|axis| offset[2 * k + axis] = 1e3 * (a[axis] - b[axis]));
        }
        Some(offset)
    };
    measured.frames.iter().enumerate().map(offset).collect()
}

/// Root mean square distance of keypoints, mm, of these offsets.
pub fn rmse_mm<'a>(offsets: impl Iterator<Item = &'a Offset>) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for offset in offsets.flatten() {
        sum += offset.iter().map(|v| v * v).sum::<f64>();
        count += 4.0;
    }
    (sum / count).sqrt()
}
