//! Modes and errors of a robot state, whose layout versions 5 and 10 share.

use super::bytes::Writer;
use crate::fci::{ControllerMode, Generator, RobotMode, RobotState};

/// Writes modes and errors: 85 bytes.
pub fn put_modes(s: &RobotState, w: &mut Writer) {
    w.put(&[s.motion.map_or(0, |(generator, _)| generator_number(generator))]);
    // 3: "other", without a motion.
    w.put(&[s.motion.map_or(3, |(_, controller)| controller_number(controller))]);
    w.flags(&s.errors.flags());
    w.flags(&s.reflex_reason.flags());
    w.put(&[match s.robot_mode {
        RobotMode::Other => 0,
        RobotMode::Idle => 1,
        RobotMode::Move => 2,
        RobotMode::Guiding => 3,
        RobotMode::Reflex => 4,
        RobotMode::UserStopped => 5,
        RobotMode::AutomaticErrorRecovery => 6,
    }]);
}

/// Number of a generator in a state. A `Move` request has one less.
fn generator_number(generator: Generator) -> u8 {
    match generator {
        Generator::JointPosition => 1,
        Generator::JointVelocity => 2,
        Generator::CartesianPosition => 3,
        Generator::CartesianVelocity => 4,
        Generator::None => 5,
    }
}

fn controller_number(controller: ControllerMode) -> u8 {
    match controller {
        ControllerMode::JointImpedance => 0,
        ControllerMode::CartesianImpedance => 1,
        ControllerMode::External => 2,
    }
}
