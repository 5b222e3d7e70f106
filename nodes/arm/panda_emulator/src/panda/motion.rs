//! Motion of a client: generators, lost commands, how a motion ends.

use super::chain::Joints;
use super::configuration::Configuration;
use super::settings::MAX_DELAY_CYCLES;
use crate::fci::{Errors, Generator, MoveRequest};
use generator::MotionGenerator;
use joint::JointPath;
use losses::Losses;

pub mod cartesian;
pub mod generator;
pub mod inverse_kinematics;
pub mod joint;
pub mod losses;

/// Running motion of a client.
#[derive(Debug, Clone)]
pub struct Motion {
    /// Identifier of the client's request.
    pub id: u32,
    /// Request.
    pub request: MoveRequest,
    /// Generator of the desired motion.
    pub generator: MotionGenerator,
    /// Last accepted torque command after the filter, N m.
    pub torque: Joints,
    /// Last accepted torque command, N m.
    pub commanded_torque: Joints,
    /// Change of the torque command in the last cycle, N m.
    pub torque_change: Joints,
    /// Commands received and lost.
    pub losses: Losses,
    /// Torques under way to the motors, the newest first, N m.
    pub delayed: [Joints; MAX_DELAY_CYCLES + 1],
    /// Number of cycles since the start.
    pub cycles: u32,
    /// Filtered joint-space path.
    filtered: JointPath,
}

impl Motion {
    /// Motion that has just started.
    pub fn new(id: u32, request: MoveRequest, generator: MotionGenerator) -> Self {
        let filtered = *generator.joints();
        Self {
            id,
            request,
            generator,
            torque: Joints::zeros(),
            commanded_torque: Joints::zeros(),
            torque_change: Joints::zeros(),
            losses: Losses::default(),
            delayed: [Joints::zeros(); MAX_DELAY_CYCLES + 1],
            cycles: 0,
            filtered,
        }
    }

    /// Accepts a torque command. `gain`: gain of the filter, 1 = off.
    pub fn accept_torque(&mut self, command: Joints, gain: f64) {
        self.torque_change = command - self.commanded_torque;
        self.commanded_torque = command;
        self.torque += (command - self.torque) * gain;
    }

    /// Passes the newest point of the joint-space path through the client's filter and returns the result.
    ///
    /// The filters of Cartesian commands act on the joint-space path behind them.
    pub fn filtered(&mut self, configuration: &Configuration) -> JointPath {
        let path = self.generator.joints();
        let filter = match self.request.generator {
            Generator::JointPosition | Generator::None => 0,
            Generator::JointVelocity => 1,
            Generator::CartesianPosition => 2,
            Generator::CartesianVelocity => 3,
        };
        let gain = configuration.gain(filter);
        if gain >= 1.0 {
            self.filtered = *path;
        } else {
            let filtered = &mut self.filtered;
            filtered.q += (path.q - filtered.q) * gain;
            filtered.dq += (path.dq - filtered.dq) * gain;
            filtered.ddq += (path.ddq - filtered.ddq) * gain;
        }
        self.filtered
    }

    /// Sends the newest torque on its way and returns the one that arrives at the motors.
    pub fn torque_at_motors(&mut self, delay_cycles: usize) -> Joints {
        self.delayed.rotate_right(1);
        self.delayed[0] = self.torque;
        self.delayed[delay_cycles.min(MAX_DELAY_CYCLES)]
    }
}

/// End of a motion.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ending {
    /// The client finished it.
    Success,
    /// `StopMove`.
    Preempted,
    /// Reflex with its errors.
    Reflex(Errors),
    /// User stop.
    UserStop,
    /// Command that is not finite.
    InputError,
    /// The brakes closed.
    Aborted,
}
