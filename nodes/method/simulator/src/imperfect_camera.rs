//! Imperfect camera: keypoints of a moving object with delay, exposure, rolling shutter, noise and dropped frames.

use crate::episode_model::CameraSettings;
use catenary_core::Camera;
use catenary_core::camera::MASK_SIZE_PX;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use std::collections::VecDeque;

/// Places of the four keypoints, (x, z) in m.
type Places = [[f64; 2]; 4];
/// Keypoints scaled to -1 .. 1 over the mask.
type Keypoints = [[f64; 2]; 4];

/// Number of moments of an exposure, its two ends included.
const EXPOSURE_SAMPLES: usize = 5;

/// Imperfect camera of one episode.
#[derive(Debug)]
pub struct ImperfectCamera {
    settings: CameraSettings,
    /// Projection, with the episode's jitter.
    pub camera: Camera,
    /// Places of the last [`CameraSettings::memory_s`], oldest first. Empty if the camera shows the present.
    past: VecDeque<(f64, Places)>,
    noise: Option<ChaCha8Rng>,
    drops: Option<ChaCha8Rng>,
    last: Option<Keypoints>,
}

impl ImperfectCamera {
    /// Makes a camera with the projection `camera`, jitter included. `noise` and `drops` are the random sources of
    /// keypoint noise and of dropped frames; without a source there is none.
    pub fn new(
        settings: &CameraSettings,
        camera: Camera,
        noise: Option<ChaCha8Rng>,
        drops: Option<ChaCha8Rng>,
    ) -> Self {
        Self { settings: settings.clone(), camera, past: VecDeque::new(), noise, drops, last: None }
    }

    /// Returns true if frames show the past, so that [`Self::remember`] must be called between frames.
    pub fn has_memory(&self) -> bool {
        self.settings.memory_s() > 0.0
    }

    /// Stores the places of the keypoints at `time_s`.
    pub fn remember(&mut self, time_s: f64, places_m: Places) {
        let oldest_s = time_s - self.settings.memory_s();
        while self.past.len() > 1 && self.past[1].0 <= oldest_s {
            self.past.pop_front();
        }
        if self.past.back().is_none_or(|(t, _)| *t < time_s) {
            self.past.push_back((time_s, places_m));
        }
    }

    /// Returns the keypoints of the frame stamped `time_s`. `places_m` are the true places at that time.
    pub fn capture(&mut self, time_s: f64, places_m: Places) -> Keypoints {
        let mut keypoints = if self.has_memory() {
            self.remember(time_s, places_m);
            std::array::from_fn(|k| self.gathered(time_s, k))
        } else {
            places_m.map(|p| self.project(p))
        };
        for term in &self.settings.terms {
            term.change(time_s, &mut keypoints);
        }
        // The mask is 2 wide in scaled coordinates.
        let sigma = 2.0 * self.settings.keypoint_noise_px / f64::from(MASK_SIZE_PX);
        if let Some(rng) = &mut self.noise {
            keypoints = keypoints.map(|p| p.map(|v| v + sigma * rng.sample::<f64, _>(StandardNormal)));
        }
        if let (Some(rng), Some(last)) = (&mut self.drops, self.last)
            && self.settings.dropped_share > 0.0
            && rng.random::<f64>() < self.settings.dropped_share
        {
            return last;
        }
        self.last = Some(keypoints);
        keypoints
    }

    fn project(&self, [x, z]: [f64; 2]) -> [f64; 2] {
        self.camera.scaled_from_world([x, 0.0, z]).unwrap_or([0.0; 2])
    }

    /// Returns keypoint `k`, averaged over the exposure of its row.
    fn gathered(&self, time_s: f64, k: usize) -> [f64; 2] {
        let end_s = time_s - self.settings.frame_delay_s;
        let at = |t: f64| self.project(self.place_at(t, k));
        // Row of the keypoint: 0 is the first, 1 the last. Motion within the read-out does not change the row.
        let row = (0.5 * (at(end_s)[1] + 1.0)).clamp(0.0, 1.0);
        let end_s = end_s - self.settings.rolling_shutter_s * (1.0 - row);
        if self.settings.exposure_s == 0.0 {
            return at(end_s);
        }
        let mut mean = [0.0; 2];
        for i in 0..EXPOSURE_SAMPLES {
            // Trapezoidal rule.
            let share = i as f64 / (EXPOSURE_SAMPLES - 1) as f64;
            let end = i == 0 || i == EXPOSURE_SAMPLES - 1;
            let weight = if end { 0.5 } else { 1.0 } / (EXPOSURE_SAMPLES - 1) as f64;
            let seen = at(end_s - share * self.settings.exposure_s);
            mean = [mean[0] + weight * seen[0], mean[1] + weight * seen[1]];
        }
        mean
    }

    /// Returns the place of keypoint `k` at `time_s`: linear between stored places, constant before and after them.
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

    /// Frame at 1 s of four points that move along x at 0.5 m/s, at heights 0.6, 0.2, -0.2, -0.6 m.
    fn moving(change: impl FnOnce(&mut CameraSettings)) -> Keypoints {
        let mut settings = CameraSettings::new(camera(), 0.0);
        change(&mut settings);
        let mut imperfect = ImperfectCamera::new(&settings, camera(), None, None);
        let places = |t: f64| [0.6, 0.2, -0.2, -0.6].map(|z| [0.5 * t, z]);
        (0..100).for_each(|i| imperfect.remember(0.01 * f64::from(i), places(0.01 * f64::from(i))));
        imperfect.capture(1.0, places(1.0))
    }

    #[test]
    fn a_camera_without_faults_shows_the_present() {
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
        let settings = CameraSettings { dropped_share: 0.3, ..CameraSettings::new(camera(), 0.0) };
        let mut imperfect = ImperfectCamera::new(&settings, camera(), Some(seed::rng(1, 0)), Some(seed::rng(1, 1)));
        let frames: Vec<Keypoints> =
            (0..2000).map(|i| imperfect.capture(f64::from(i), [[1e-4 * f64::from(i), 0.0]; 4])).collect();
        let repeated = frames.windows(2).filter(|w| w[0] == w[1]).count();
        // The standard deviation of the share is 0.01.
        assert!((repeated as f64 / 1999.0 - 0.3).abs() < 0.04, "{repeated}");
    }
}
