//! What a camera with its faults sees of a moving object.

use crate::world::View;
use catenary_core::Camera;
use catenary_core::camera::MASK_SIZE_PX;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use std::collections::VecDeque;

/// Places in m, (x, z), of the four keypoints.
type Places = [[f64; 2]; 4];
/// Keypoints scaled to -1 .. 1 over the mask.
type Keypoints = [[f64; 2]; 4];

/// Looks at an exposure's beginning, end and between.
const EXPOSURE_LOOKS: usize = 5;

/// The camera of one episode.
#[derive(Debug)]
pub struct Eye {
    view: View,
    /// The camera, jitter of the episode included.
    pub camera: Camera,
    /// Places of the last [`View::memory_s`], oldest first, where the view needs them.
    past: VecDeque<(f64, Places)>,
    noise: Option<ChaCha8Rng>,
    drops: Option<ChaCha8Rng>,
    last: Option<Keypoints>,
}

impl Eye {
    /// An eye behind `camera`, which has its jitter. Without `noise` there is neither noise nor a dropped frame.
    pub fn new(view: &View, camera: Camera, noise: Option<ChaCha8Rng>, drops: Option<ChaCha8Rng>) -> Self {
        Self { view: view.clone(), camera, past: VecDeque::new(), noise, drops, last: None }
    }

    /// Whether frames show the past, so that [`Self::remember`] must be told of it.
    pub fn has_memory(&self) -> bool {
        self.view.memory_s() > 0.0
    }

    /// Takes note of where the keypoints are at `time_s`.
    pub fn remember(&mut self, time_s: f64, places_m: Places) {
        let oldest_s = time_s - self.view.memory_s();
        while self.past.len() > 1 && self.past[1].0 <= oldest_s {
            self.past.pop_front();
        }
        if self.past.back().is_none_or(|(t, _)| *t < time_s) {
            self.past.push_back((time_s, places_m));
        }
    }

    /// The frame with the stamp `time_s`, at which the keypoints are at `places_m`.
    pub fn look(&mut self, time_s: f64, places_m: Places) -> Keypoints {
        let mut keypoints = if self.has_memory() {
            self.remember(time_s, places_m);
            std::array::from_fn(|k| self.gathered(time_s, k))
        } else {
            places_m.map(|p| self.project(p))
        };
        for term in &self.view.terms {
            term.change(time_s, &mut keypoints);
        }
        let sigma = 2.0 * self.view.keypoint_noise_px / f64::from(MASK_SIZE_PX);
        if let Some(rng) = &mut self.noise {
            keypoints = keypoints.map(|p| p.map(|v| v + sigma * rng.sample::<f64, _>(StandardNormal)));
        }
        if let (Some(rng), Some(last)) = (&mut self.drops, self.last)
            && self.view.dropped_share > 0.0
            && rng.random::<f64>() < self.view.dropped_share
        {
            return last;
        }
        self.last = Some(keypoints);
        keypoints
    }

    fn project(&self, [x, z]: [f64; 2]) -> [f64; 2] {
        self.camera.scaled_from_world([x, 0.0, z]).unwrap_or([0.0; 2])
    }

    /// Keypoint `k` as the light of its row's exposure shows it.
    fn gathered(&self, time_s: f64, k: usize) -> [f64; 2] {
        let end_s = time_s - self.view.frame_delay_s;
        let at = |t: f64| self.project(self.place_at(t, k));
        // 0 at the first row, 1 at the last.
        let row = (0.5 * (at(end_s)[1] + 1.0)).clamp(0.0, 1.0);
        let end_s = end_s - self.view.rolling_shutter_s * (1.0 - row);
        if self.view.exposure_s == 0.0 {
            return at(end_s);
        }
        let mut mean = [0.0; 2];
        for i in 0..EXPOSURE_LOOKS {
            // The trapezoidal rule.
            let share = i as f64 / (EXPOSURE_LOOKS - 1) as f64;
            let end = i == 0 || i == EXPOSURE_LOOKS - 1;
            let weight = if end { 0.5 } else { 1.0 } / (EXPOSURE_LOOKS - 1) as f64;
            let seen = at(end_s - share * self.view.exposure_s);
            mean = [mean[0] + weight * seen[0], mean[1] + weight * seen[1]];
        }
        mean
    }

    /// Place of keypoint `k` at `time_s`, linear between what was remembered and held beyond it.
    fn place_at(&self, time_s: f64, k: usize) -> [f64; 2] {
        let later = self.past.partition_point(|(t, _)| *t < time_s).min(self.past.len() - 1);
        let (t1, new) = &self.past[later];
        if later == 0 || *t1 <= time_s {
            return new[k];
        }
        let (t0, old) = &self.past[later - 1];
        let share = (time_s - t0) / (t1 - t0);
        [0, 1].map(|i| old[k][i] + share * (new[k][i] - old[k][i]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use catenary_core::camera::Plane;
    use catenary_core::seed;

    fn camera() -> Camera {
        Camera::Plane(Plane { centre_m: [0.0, 0.0], side_m: 2.0, ..Plane::default() })
    }

    /// An eye on four points that move along x at 0.5 m/s, at heights 0.6, 0.2, -0.2, -0.6 m; its frame at 1 s.
    fn moving(change: impl FnOnce(&mut View)) -> Keypoints {
        let mut view = View::new(camera(), 0.0);
        change(&mut view);
        let mut eye = Eye::new(&view, camera(), None, None);
        let places = |t: f64| [0.6, 0.2, -0.2, -0.6].map(|z| [0.5 * t, z]);
        (0..100).for_each(|i| eye.remember(0.01 * f64::from(i), places(0.01 * f64::from(i))));
        eye.look(1.0, places(1.0))
    }

    #[test]
    fn a_view_without_faults_shows_what_is_there() {
        let expected = [0.6, 0.2, -0.2, -0.6].map(|z| camera().scaled_from_world([0.5, 0.0, z]).unwrap());
        assert_eq!(moving(|_| ()), expected);
    }

    #[test]
    fn a_delay_shows_the_past() {
        assert!((moving(|v| v.frame_delay_s = 0.234)[2][0] - 0.383).abs() < 1e-12);
    }

    #[test]
    fn an_exposure_shows_the_mean_of_its_time() {
        assert!((moving(|v| v.exposure_s = 0.1)[1][0] - 0.475).abs() < 1e-12);
    }

    #[test]
    fn a_rolling_shutter_shows_the_upper_rows_earlier() {
        let seen = moving(|v| v.rolling_shutter_s = 0.1);
        // The row at z = 0.6 m lies a fifth of the height below the first.
        assert!((seen[0][0] - 0.46).abs() < 1e-12 && (seen[3][0] - 0.49).abs() < 1e-12, "{seen:?}");
    }

    #[test]
    fn dropped_frames_repeat_the_one_before_as_often_as_they_should() {
        let view = View { dropped_share: 0.3, ..View::new(camera(), 0.0) };
        let mut eye = Eye::new(&view, camera(), Some(seed::rng(1, 0)), Some(seed::rng(1, 1)));
        let frames: Vec<Keypoints> =
            (0..2000).map(|i| eye.look(f64::from(i), [[1e-4 * f64::from(i), 0.0]; 4])).collect();
        let repeated = frames.windows(2).filter(|w| w[0] == w[1]).count();
        // The standard deviation of the share is 0.01.
        assert!((repeated as f64 / 1999.0 - 0.3).abs() < 0.04, "{repeated}");
    }
}
