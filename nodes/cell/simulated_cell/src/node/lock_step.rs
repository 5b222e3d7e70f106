//! Lock step: simulated time that waits for the graph, so that the load of the machine changes no bit.
//!
//! Time stands still unless the arm moves to its start or a policy runner waits for the next frame. Each frame waits for its keypoints. In an
//! episode, the next frame also waits until the policy runner has done all that the last one asked for.
#![allow(clippy::disallowed_methods, reason = "waits for dead nodes are limited in wall time")]

use super::camera::Frames;
use super::measuring::Measuring;
use crate::cell::Cell;
use anyhow::{Result, ensure};
use catenary_msgs::msg::Keypoints;
use catenary_msgs::rosgraph_msgs::msg::Clock as ClockMsg;
use catenary_shell::{DEAD_NODE, DONE_UNTIL, Latest, Node, Time, contract, stamp};
use panda_bridge::node::front::{Front, RECHECK_S};
use std::time::{Duration, Instant};

/// Period of looks at the arm while time stands still.
const LOOK: Duration = Duration::from_millis(5);
/// Period of `/clock` while time stands still, for nodes that come late.
const CLOCK_PERIOD: Duration = Duration::from_millis(100);
/// Period at which the first frame is published until it has keypoints: camera and tracker may not have found one another yet.
const FIRST_PERIOD: Duration = Duration::from_secs(1);

/// Cell whose time waits for the graph.
pub(super) struct LockStep<'a> {
    front: &'a Front<Cell>,
    measuring: Measuring,
    frames: Frames,
    keypoints: Latest<Keypoints>,
    done: Latest<ClockMsg>,
    /// Largest simulated time per wall time.
    factor: f64,
    /// Stamp of the newest frame.
    frame: Option<Time>,
}

impl<'a> LockStep<'a> {
    pub fn new(front: &'a Front<Cell>, measuring: Measuring, frames: Frames, factor: f64) -> Result<Self> {
        let node = front.node();
        let keypoints = node.latest(contract::KEYPOINTS.name, contract::KEYPOINTS.qos)?;
        let done = node.latest(DONE_UNTIL.0, DONE_UNTIL.1)?;
        Ok(Self { front, measuring, frames, keypoints, done, factor, frame: None })
    }

    /// Runs until shutdown.
    ///
    /// # Errors
    /// No keypoints for a frame within [`DEAD_NODE`].
    pub fn run(mut self) -> Result<()> {
        let node = self.front.node();
        let (mut checked, mut due) = (Instant::now(), Instant::now());
        while !node.is_shutdown() {
            if checked.elapsed().as_secs_f64() >= RECHECK_S {
                checked = Instant::now();
                self.front.recheck();
            }
            if !self.is_asked_for() {
                self.stand_still();
                continue;
            }
            let count = self.measuring.count() + 1;
            // Time that stood still is not made up for.
            due = due.max(Instant::now()) + Duration::from_secs_f64(Measuring::time_s(1) / self.factor);
            let is_due = self.frames.is_due(Measuring::time_s(count));
            self.measuring.advance(self.front, count, is_due);
            if let Some(stamp) = self.frames.take(self.front) {
                self.wait_for_keypoints(node, stamp)?;
                self.frame = Some(stamp);
            }
            std::thread::sleep(due.saturating_duration_since(Instant::now()));
        }
        node.wait_for_shutdown()
    }

    /// Returns true if somebody waits for time to go on.
    fn is_asked_for(&self) -> bool {
        // The first frame: nodes that come late find data to begin with.
        let Some(frame) = self.frame else { return true };
        self.front.arm().is_moving_on()
            || self.done.get().is_some_and(|done| stamp::from_msg(&done.message.clock) >= frame)
    }

    /// Waits for a short wall time, or until the policy runner tells something.
    fn stand_still(&self) {
        let until = Instant::now() + CLOCK_PERIOD;
        let mut heard = self.done.get().map_or(0, |done| done.count);
        while !self.is_asked_for() && !self.front.node().is_shutdown() {
            if Instant::now() >= until {
                self.measuring.tell_time(self.front);
                return;
            }
            heard = self.done.wait_newer(heard, LOOK).map_or(heard, |done| done.count);
        }
    }

    fn wait_for_keypoints(&self, node: &Node, frame: Time) -> Result<()> {
        let began = Instant::now();
        let mut sent = began;
        loop {
            let newest = self.keypoints.get();
            if newest.as_ref().is_some_and(|k| stamp::from_msg(&k.message.header.stamp) >= frame) || node.is_shutdown()
            {
                return Ok(());
            }
            ensure!(
                began.elapsed() < DEAD_NODE,
                "no keypoints for the frame of {frame} s within {} s: do the camera node and the keypoint tracker live, and is their lock_step true?",
                DEAD_NODE.as_secs()
            );
            if self.frame.is_none() && sent.elapsed() >= FIRST_PERIOD {
                sent = Instant::now();
                self.frames.send();
            }
            let _newer = self.keypoints.wait_newer(newest.map_or(0, |k| k.count), FIRST_PERIOD);
        }
    }
}
