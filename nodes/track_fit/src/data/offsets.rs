//! Offsets between measured and simulated keypoints in the plane of motion.

use super::episode::MeasuredEpisode;
use catenary_core::{Camera, Frame, KeypointOrder, Track};

impl MeasuredEpisode {
    /// Offsets between the measured and a simulated track, see [`offsets_mm`].
    pub fn offsets_mm(&self, simulated: &Track, camera: &Camera) -> Vec<Offset> {
        offsets_mm(&self.measured, simulated, self.order, camera)
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
