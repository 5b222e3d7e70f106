//! Fast loop of the simulated cell: time, measurements and collisions.
#![allow(clippy::disallowed_methods, reason = "the loop paces itself by the wall clock")]

use super::arm::arm_pose;
use crate::cell::{Cell, collisions};
use crate::scene::{Contact, Scene};
use anyhow::Result;
use catenary_msgs::rosgraph_msgs::msg::Clock as ClockMsg;
use catenary_shell::{Publisher, Time, stamp};
use nalgebra::Vector6;
use panda_bridge::node::front::{Front, RECHECK_S};
use panda_bridge::node::topics::{ArmTopics, Measurement};
use panda_bridge::{Arm, Mode, kinematics};
use std::time::{Duration, Instant};

/// Period in s of the arm's measurements.
const MEASURE_PERIOD_S: f64 = 0.005;
/// Number of measurements between two messages on arm_state, and between two collision checks.
const SLOW_EVERY: u64 = 4;
/// Advances the cell by periods, and publishes the arm's measurements.
pub(super) struct Measuring {
    topics: ArmTopics,
    clock: Option<Publisher<ClockMsg>>,
    angles_rad: [f64; kinematics::JOINTS],
    scene: Scene,
    /// Number of the newest measurement; time of the cell in periods.
    count: u64,
    last_mode: Option<u8>,
}

impl Measuring {
    pub fn new(front: &Front<Cell>, clock: Option<Publisher<ClockMsg>>) -> Result<Self> {
        let scene = front.arm().plant().scene();
        let topics = ArmTopics::new(front.node())?;
        Ok(Self { topics, clock, angles_rad: kinematics::READY_RAD, scene, count: 0, last_mode: None })
    }

    /// Runs until shutdown. Time follows the wall clock times `factor`. If the machine is too slow, several steps are
    /// made at once and only the newest is published.
    pub fn run(mut self, front: &Front<Cell>, started: Instant, factor: f64) -> Result<()> {
        let node = front.node();
        let recheck = (RECHECK_S / MEASURE_PERIOD_S).round() as u64;
        let mut next_check = recheck;
        while !node.is_shutdown() {
            let wanted_s = started.elapsed().as_secs_f64() * factor;
            let next_s = ((wanted_s / MEASURE_PERIOD_S).floor() * MEASURE_PERIOD_S)
                .max((self.count + 1) as f64 * MEASURE_PERIOD_S);
            let early_s = (next_s - wanted_s) / factor;
            if early_s > 0.0 {
                std::thread::sleep(Duration::from_secs_f64(early_s));
            }
            self.advance(front, (next_s / MEASURE_PERIOD_S).round() as u64, false);
            if self.count >= next_check {
                next_check = self.count + recheck;
                front.recheck();
            }
        }
        node.wait_for_shutdown()
    }

    /// Number of the newest measurement, from 0 before the first.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// Time of a measurement, s.
    pub fn time_s(count: u64) -> f64 {
        count as f64 * MEASURE_PERIOD_S
    }

    /// Advances the cell to measurement `count`, and publishes it, with the state of the arm if it is due or `tells_state`.
    pub fn advance(&mut self, front: &Front<Cell>, count: u64, tells_state: bool) {
        let elapsed_s = Self::time_s(count - self.count);
        self.count = count;
        let next_s = Self::time_s(count);
        let time = front.stamp(next_s);
        let (state, snapshot) = {
            let mut arm = front.arm();
            arm.steer();
            arm.plant_mut().advance(next_s);
            arm.watch();
            self.publish(arm.plant(), time, elapsed_s);
            (front.state(&arm, 1.0, time), count.is_multiple_of(SLOW_EVERY).then(|| arm.plant().snapshot()))
        };
        if let Some(snapshot) = snapshot {
            self.scene.update(snapshot.grip, &snapshot.nodes);
            if let Some(contact) = collisions(&self.scene.contacts(0.0)).next() {
                collide(&mut front.arm(), contact);
            }
        }
        // A change of mode is published at once, without waiting for the slower period.
        if tells_state || count.is_multiple_of(SLOW_EVERY) || self.last_mode != Some(state.mode) {
            self.last_mode = Some(state.mode);
            self.topics.state(state);
        }
        self.tell_time(front);
    }

    /// Publishes the time of the newest measurement on `/clock`, if the cell publishes it.
    pub fn tell_time(&self, front: &Front<Cell>) {
        if let Some(clock) = &self.clock {
            clock.send(ClockMsg { clock: stamp::to_msg(front.stamp(Self::time_s(self.count))) });
        }
    }

    /// Publishes the cell, `elapsed_s` after the last time.
    fn publish(&mut self, cell: &Cell, time: Time, elapsed_s: f64) {
        let pose = arm_pose(&cell.grip());
        let before = self.angles_rad;
        // A pose without a solution keeps the last angles.
        if let Some(angles) = kinematics::inverse(&pose, &before) {
            self.angles_rad = angles;
        }
        let ([vx, vz], wrench) = (cell.velocity_m_s(), cell.wrench());
        let [fx, fz] = wrench.force_n;
        let measured = Measurement {
            pose,
            twist: Vector6::new(vx, 0.0, vz, 0.0, 0.0, 0.0),
            wrench: Vector6::new(fx, 0.0, fz, 0.0, wrench.moment_y_n_m, 0.0),
            joints_rad: self.angles_rad,
            velocities_rad_s: std::array::from_fn(|i| (self.angles_rad[i] - before[i]) / elapsed_s),
            torques_n_m: Vec::new(),
        };
        self.topics.measured(&measured, time);
    }
}

/// Stops the arm by a reflex after a collision of the hand.
fn collide(arm: &mut Arm<Cell>, contact: &Contact) {
    if arm.mode() != Mode::Reflex {
        let what = format!("{:?} touches {:?}", contact.first, contact.second);
        tracing::error!("reflex: {what}");
        arm.reflex(&what);
    }
}
