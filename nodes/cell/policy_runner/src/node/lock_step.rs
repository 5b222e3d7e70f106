//! Lock step: an episode acts on every frame with all data of its time, and simulated time waits for it.
#![allow(clippy::disallowed_methods, reason = "waits for dead nodes are limited in wall time")]

use crate::writers::{Source, Writers, lock};
use anyhow::{Result, ensure};
use catenary_msgs::builtin_interfaces::msg::Time as Stamp;
use catenary_msgs::geometry_msgs::msg::PoseStamped;
use catenary_msgs::msg::{AcceptedTarget, ArmState, Keypoints};
use catenary_msgs::rosgraph_msgs::msg::Clock as ClockMsg;
use catenary_shell::{DEAD_NODE, DONE_UNTIL, Latest, Node, Publisher, Queue, Time, stamp};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// Period of looks at data that come soon.
const LOOK: Duration = Duration::from_millis(1);
/// Period of looks at data that may take longer.
const NAP: Duration = Duration::from_millis(20);
/// Period at which the time until which everything is done is sent to the cell again: the cell may not be discovered yet.
const AGAIN: Duration = Duration::from_millis(500);

/// Data of an episode in lock step.
pub(super) struct LockStep {
    node: Node,
    done: Publisher<ClockMsg>,
    keypoints: Latest<Keypoints>,
    pose: Latest<PoseStamped>,
    arm: Latest<ArmState>,
    writers: Arc<Mutex<Writers>>,
}

/// Wait that was cancelled.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Cancelled;

impl LockStep {
    pub fn new(
        node: &Node,
        keypoints: &Latest<Keypoints>,
        pose: &Latest<PoseStamped>,
        arm: &Latest<ArmState>,
        writers: &Arc<Mutex<Writers>>,
    ) -> Result<Self> {
        ensure!(node.clock().is_simulated(), "parameter lock_step: expected use_sim_time to be true, too");
        let done = node.publisher(DONE_UNTIL.0, DONE_UNTIL.1)?;
        Ok(Self {
            node: node.clone(),
            done,
            keypoints: keypoints.clone(),
            pose: pose.clone(),
            arm: arm.clone(),
            writers: Arc::clone(writers),
        })
    }

    /// Waits until simulated time stands still, and then for the first frame of an episode. `cancelled` waits for at most the given wall time.
    ///
    /// # Errors
    /// As [`LockStep::next_frame`].
    pub fn begin(&self, cancelled: &impl Fn(Duration) -> bool) -> Result<Result<(), Cancelled>> {
        let began = Instant::now();
        // A clock that lags behind would begin the episode with a frame of the motion before it.
        while !self.node.clock().stands_still() {
            ensure!(
                began.elapsed() < DEAD_NODE,
                "simulated time does not stand still before the episode: does the simulated cell live, and is its lock_step true?"
            );
            if cancelled(NAP) {
                return Ok(Err(Cancelled));
            }
        }
        self.next_frame(cancelled)
    }

    /// Tells that everything until now is done, and waits for the next frame with all data of its time.
    ///
    /// # Errors
    /// No frame within [`DEAD_NODE`].
    pub fn next_frame(&self, cancelled: &impl Fn(Duration) -> bool) -> Result<Result<(), Cancelled>> {
        let (after, began) = (self.node.now(), Instant::now());
        let mut told: Option<Instant> = None;
        loop {
            if told.is_none_or(|told| told.elapsed() >= AGAIN) {
                told = Some(Instant::now());
                self.done.send(ClockMsg { clock: stamp::to_msg(after) });
            }
            let newest = self.keypoints.get();
            let frame =
                newest.as_ref().map(|k| stamp::from_msg(&k.message.header.stamp)).filter(|frame| *frame > after);
            // With a stranger the frame may never be whole. The caller ends the episode and names it.
            if frame.is_some_and(|frame| self.has_all_of(frame)) || self.has_stranger() {
                return Ok(Ok(()));
            }
            ensure!(
                began.elapsed() < DEAD_NODE,
                "no frame with all data after {after} s within {} s: do the simulated cell, the camera node and the keypoint tracker live, and is their lock_step true?",
                DEAD_NODE.as_secs()
            );
            // Keypoints come last, except for single messages that are repeated.
            let nap = if frame.is_some() { LOOK } else { Duration::ZERO };
            if cancelled(nap) {
                return Ok(Err(Cancelled));
            }
            if frame.is_none() {
                let _newer = self.keypoints.wait_newer(newest.map_or(0, |k| k.count), NAP);
            }
        }
    }

    /// Returns true if pose, state of the arm and clock have come to the time of a frame.
    fn has_all_of(&self, frame: Time) -> bool {
        let pose = self.pose.get().map(|p| stamp::from_msg(&p.message.header.stamp));
        let arm = self.arm.get().map(|a| stamp::from_msg(&a.message.header.stamp));
        [pose, arm, Some(self.node.now())].iter().all(|time| time.is_some_and(|time| time >= frame))
    }

    /// Returns true if a topic of the episode came from a second writer.
    fn has_stranger(&self) -> bool {
        lock(&self.writers).stranger().is_some()
    }

    /// Waits for the gate's answer to the target with this stamp; `None` if another writer than the arm's answered.
    ///
    /// # Errors
    /// No answer within [`DEAD_NODE`].
    pub fn answer(
        &self,
        answers: &Queue<AcceptedTarget>,
        sent: &Stamp,
        cancelled: &impl Fn(Duration) -> bool,
    ) -> Result<Result<Option<AcceptedTarget>, Cancelled>> {
        let began = Instant::now();
        loop {
            // Any other is the answer of a stranger, to another publisher, or to a step that was given up.
            if let Some(answer) = answers.next(NAP)
                && lock(&self.writers).hear(Source::AcceptedTarget, answer.publisher).is_ok()
                && answer.message.header.stamp == *sent
            {
                return Ok(Ok(Some((*answer.message).clone())));
            }
            if self.has_stranger() {
                return Ok(Ok(None));
            }
            if cancelled(Duration::ZERO) {
                return Ok(Err(Cancelled));
            }
            ensure!(
                began.elapsed() < DEAD_NODE,
                "the arm answered no target within {} s: does the simulated cell live?",
                DEAD_NODE.as_secs()
            );
        }
    }
}
