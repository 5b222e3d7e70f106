//! Observer of an episode: camera frames of the observations, pictures for the film, and the age of the keypoints.

use super::film::{Film, Shot, Window, image_px};
use super::summary::Frame;
use anyhow::{Context, Result};
use catenary_core::camera::Pinhole;
use catenary_core::statistics::{QuantileMethod, quantile};
use catenary_core::{Camera, Model, Observation};
use catenary_msgs::msg::{Keypoints as KeypointsMsg, Observation as ObservationMsg};
use catenary_msgs::sensor_msgs::msg::Image;
use catenary_shell::{DEAD_NODE, Node, Queue, Subscription, Time, contract, stamp, wall_now};
use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Least time between two pictures of the film, s.
const SHOT_PERIOD_S: f64 = 0.015;
/// Largest number of pictures in a film; each takes 0.25 MB.
const MOST_SHOTS: usize = 1_000;
/// Capacity of the queue of observations.
const QUEUE: usize = 64;
/// Number of newest images from which that of an observation is chosen: half a second at 60 Hz, 28 MB.
const RECENT: usize = 30;
/// Period of looks for the image of an observation.
const LOOK: Duration = Duration::from_millis(10);

/// Image with the wall time of its arrival.
type Arrived = (Time, Instant, Arc<Image>);

/// Observer of one episode.
pub struct Observer {
    recent: Arc<Mutex<VecDeque<Arrived>>>,
    in_lock_step: bool,
    observations: Queue<ObservationMsg>,
    ages_ms: Arc<Mutex<Vec<f64>>>,
    shots: Arc<Mutex<Vec<Shot>>>,
    window: Window,
    _subscriptions: [Subscription; 2],
    camera: Pinhole,
    folder: PathBuf,
    policy: String,
    seen: Vec<(Observation, Frame)>,
    times_s: Vec<f64>,
    since: Time,
}

/// Everything observed during an episode.
pub struct Seen {
    /// Observations of the policy, in order.
    pub observations: Vec<Observation>,
    /// Camera frame of each observation.
    pub frames: Vec<Frame>,
    /// Median and 99 % quantile of the keypoints' age at arrival, ms.
    pub latency_ms: [f64; 2],
    /// Pictures of the whole episode.
    pub film: Film,
}

impl Observer {
    /// Starts to observe. Frames are written to `folder/frames/POLICY_STEP.png`.
    pub fn start(node: &Node, folder: &Path, policy: &str, model: &Model) -> Result<Self> {
        let Camera::Pinhole(camera) = model.camera.view else {
            anyhow::bail!("the demo's model needs a pinhole camera")
        };
        let window = Window::of(model, &camera)?;
        let since = node.now();
        let frames = folder.join("frames");
        std::fs::create_dir_all(&frames).with_context(|| frames.display().to_string())?;
        let ages_ms = Arc::new(Mutex::new(Vec::new()));
        let recent = Arc::new(Mutex::new(VecDeque::<Arrived>::new()));
        let (sink, images, in_lock_step) = (Arc::clone(&ages_ms), Arc::clone(&recent), node.is_in_lock_step());
        let topic = contract::KEYPOINTS;
        let keypoints = node.subscription::<KeypointsMsg>(topic.name, topic.qos, move |received| {
            let of_image = stamp::from_msg(&received.message.header.stamp);
            let age_ms = match in_lock_step {
                // Simulated time stands still meanwhile.
                true => {
                    let images = images.lock().unwrap_or_else(PoisonError::into_inner);
                    let Some((_, came, _)) = images.iter().find(|(of, _, _)| *of == of_image) else { return };
                    1e3 * came.elapsed().as_secs_f64()
                }
                false => 1e3 * wall_now().secs_since(of_image),
            };
            sink.lock().unwrap_or_else(PoisonError::into_inner).push(age_ms);
        })?;
        let shots = Arc::new(Mutex::new(Vec::<Shot>::new()));
        let (sink, kept) = (Arc::clone(&shots), Arc::clone(&recent));
        let pictures = node.subscription::<Image>(contract::IMAGE.name, contract::IMAGE.qos, move |received| {
            let at = stamp::from_msg(&received.message.header.stamp);
            {
                let mut kept = kept.lock().unwrap_or_else(PoisonError::into_inner);
                kept.truncate(RECENT - 1);
                kept.push_front((at, Instant::now(), Arc::clone(&received.message)));
            }
            let time_s = at.secs_since(since);
            let mut shots = sink.lock().unwrap_or_else(PoisonError::into_inner);
            let is_due = shots.last().is_none_or(|last| time_s >= last.time_s + SHOT_PERIOD_S);
            if is_due
                && shots.len() < MOST_SHOTS
                && let Some(rgb) = window.cut(&received.message)
            {
                shots.push(Shot { time_s, rgb });
            }
        })?;
        Ok(Self {
            recent,
            in_lock_step,
            observations: node.queue(contract::OBSERVATION.name, contract::OBSERVATION.qos, QUEUE)?,
            ages_ms,
            shots,
            window,
            _subscriptions: [keypoints, pictures],
            camera,
            folder: folder.to_path_buf(),
            policy: policy.to_owned(),
            seen: Vec::new(),
            times_s: Vec::new(),
            since,
        })
    }

    /// Processes the observations that arrived since the last call; waits up to `timeout` for the first.
    pub fn look(&mut self, timeout: Duration) -> Result<()> {
        let mut next = self.observations.next(timeout);
        while let Some(received) = next {
            self.keep(&received.message)?;
            next = self.observations.try_next();
        }
        Ok(())
    }

    /// Stops, and returns everything observed.
    pub fn finish(mut self) -> Result<Seen> {
        self.look(Duration::from_millis(500))?;
        let mut ages = std::mem::take(&mut *self.ages_ms.lock().unwrap_or_else(PoisonError::into_inner));
        ages.sort_by(f64::total_cmp);
        let latency_ms = [0.5, 0.99].map(|q| quantile(&ages, q, QuantileMethod::Nearest));
        let (observations, frames): (Vec<Observation>, Vec<Frame>) = self.seen.into_iter().unzip();
        let shots = std::mem::take(&mut *self.shots.lock().unwrap_or_else(PoisonError::into_inner));
        let observed = self.times_s.into_iter().zip(observations.iter().copied()).collect();
        Ok(Seen { frames, latency_ms, film: Film { window: self.window, shots, observations: observed }, observations })
    }

    /// Image with this stamp, or the newest one before it.
    fn image(&self, at: Time) -> Option<Arc<Image>> {
        let began = Instant::now();
        loop {
            {
                let recent = self.recent.lock().unwrap_or_else(PoisonError::into_inner);
                let found = recent.iter().find(|(stamp, _, _)| *stamp <= at);
                let is_exact = found.is_some_and(|(stamp, _, _)| *stamp == at);
                // In real time images may be lost, and the first observations may precede the first image.
                if is_exact || !self.in_lock_step || began.elapsed() >= DEAD_NODE {
                    return found.map(|(_, _, image)| Arc::clone(image));
                }
            }
            std::thread::sleep(LOOK);
        }
    }

    fn keep(&mut self, message: &ObservationMsg) -> Result<()> {
        // A writer with transient-local durability may deliver samples of an earlier episode.
        if stamp::from_msg(&message.header.stamp) < self.since {
            return Ok(());
        }
        let observation = Observation(message.values);
        let seen_at = stamp::from_msg(&message.keypoints_stamp);
        let Some(image) = self.image(seen_at) else { return Ok(()) };
        let file = format!("frames/{}_{:02}.png", self.policy, message.step);
        let path = self.folder.join(&file);
        image::save_buffer(&path, &image.data, image.width, image.height, image::ExtendedColorType::Rgb8)
            .with_context(|| path.display().to_string())?;
        let marks = observation.dlo().into_iter().chain([observation.target()]);
        let marks_px = marks.map(|p| image_px(&self.camera, p)).collect();
        self.times_s.push(stamp::from_msg(&message.keypoints_stamp).secs_since(self.since));
        self.seen.push((observation, Frame { file, marks_px, step: message.step }));
        Ok(())
    }
}
