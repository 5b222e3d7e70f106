//! What the demo itself sees of an episode: camera frames at the observations, and the age of the keypoints.

use super::summary::Frame;
use anyhow::{Context, Result};
use catenary_core::camera::Pinhole;
use catenary_core::{Camera, Observation};
use catenary_msgs::msg::{Keypoints as KeypointsMsg, Observation as ObservationMsg};
use catenary_msgs::sensor_msgs::msg::Image;
use catenary_shell::{Latest, Node, Queue, Subscription, Time, contract, wall_now};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// Observations that may wait to be looked at.
const QUEUE: usize = 64;

/// Watches one episode.
pub struct Observer {
    images: Latest<Image>,
    observations: Queue<ObservationMsg>,
    ages_ms: Arc<Mutex<Vec<f64>>>,
    _keypoints: Subscription,
    camera: Pinhole,
    folder: PathBuf,
    policy: String,
    seen: Vec<(Observation, Frame)>,
    since: Time,
}

impl Observer {
    /// Starts to watch. Frames are written to `folder/frames/POLICY_STEP.png`.
    pub fn start(node: &Node, folder: &Path, policy: &str, camera: &Camera) -> Result<Self> {
        let Camera::Pinhole(camera) = *camera else { anyhow::bail!("the demo's model needs a pinhole camera") };
        let frames = folder.join("frames");
        std::fs::create_dir_all(&frames).with_context(|| frames.display().to_string())?;
        let ages_ms = Arc::new(Mutex::new(Vec::new()));
        let sink = Arc::clone(&ages_ms);
        let topic = contract::KEYPOINTS;
        let keypoints = node.subscription::<KeypointsMsg>(topic.name, topic.qos, move |received| {
            let stamp = catenary_shell::stamp::from_msg(&received.message.header.stamp);
            let age_ms = 1e3 * wall_now().secs_since(stamp);
            sink.lock().unwrap_or_else(PoisonError::into_inner).push(age_ms);
        })?;
        Ok(Self {
            images: node.latest(contract::IMAGE.name, contract::IMAGE.qos)?,
            observations: node.queue(contract::OBSERVATION.name, contract::OBSERVATION.qos, QUEUE)?,
            ages_ms,
            _keypoints: keypoints,
            camera,
            folder: folder.to_path_buf(),
            policy: policy.to_owned(),
            seen: Vec::new(),
            since: node.now(),
        })
    }

    /// Looks at what has come since the last call; waits up to `timeout` for the first observation.
    pub fn look(&mut self, timeout: Duration) -> Result<()> {
        let mut next = self.observations.next(timeout);
        while let Some(received) = next {
            self.keep(&received.message)?;
            next = self.observations.try_next();
        }
        Ok(())
    }

    /// What was seen: observations, their frames, and median and 99 % quantile of the keypoints' age in ms.
    pub fn finish(mut self) -> Result<(Vec<Observation>, Vec<Frame>, [f64; 2])> {
        self.look(Duration::from_millis(500))?;
        let mut ages = std::mem::take(&mut *self.ages_ms.lock().unwrap_or_else(PoisonError::into_inner));
        ages.sort_by(f64::total_cmp);
        let quantile =
            |q: f64| ages.get(((ages.len().max(1) - 1) as f64 * q).round() as usize).copied().unwrap_or(f64::NAN);
        let latency = [quantile(0.5), quantile(0.99)];
        let (observations, frames) = self.seen.into_iter().unzip();
        Ok((observations, frames, latency))
    }

    fn keep(&mut self, message: &ObservationMsg) -> Result<()> {
        // A writer may hand on what it still has of an earlier episode.
        if catenary_shell::stamp::from_msg(&message.header.stamp) < self.since {
            return Ok(());
        }
        let observation = Observation(message.values);
        let Some(received) = self.images.get() else { return Ok(()) };
        let image = received.message;
        let file = format!("frames/{}_{:02}.png", self.policy, message.step);
        let path = self.folder.join(&file);
        image::save_buffer(&path, &image.data, image.width, image.height, image::ExtendedColorType::Rgb8)
            .with_context(|| path.display().to_string())?;
        let (side, corner) = self.camera.crop();
        let place = |p: [f64; 2]| std::array::from_fn(|i| corner[i] + 0.5 * (p[i] + 1.0) * side);
        let marks_px = observation.dlo().into_iter().chain([observation.target()]).map(place).collect();
        self.seen.push((observation, Frame { file, marks_px, step: message.step }));
        Ok(())
    }
}
