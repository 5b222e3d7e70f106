//! Simulated arm as a plant of the bridge's front.

use crate::cell::Cell;
use catenary_core::{GripPose, Model};
use panda_bridge::{ArmPose, ArmSettings, GateSettings, Order, Plant};

/// Distance in m from the start pose at which a move counts as arrived. The arm model has no standing error of its own.
const START_TOLERANCE_M: f64 = 0.01;

/// Returns the bridge's settings for the model's start pose and workspace.
pub fn settings(model: &Model) -> ArmSettings {
    let workspace = model.task.map(|t| t.workspace).unwrap_or_default();
    ArmSettings {
        gate: GateSettings { workspace, ..GateSettings::default() },
        start: Some(arm_pose(&model.arm.start)),
        real: false,
        start_tolerance_m: START_TOLERANCE_M,
    }
}

/// Converts a pose in the plane to a pose of the arm.
pub fn arm_pose(grip: &GripPose) -> ArmPose {
    ArmPose { position_m: [grip.x_m, 0.0, grip.z_m], quaternion_xyzw: grip.quaternion_xyzw() }
}

impl Plant for Cell {
    fn time_s(&self) -> f64 {
        Cell::time_s(self)
    }

    fn measured(&self) -> Option<ArmPose> {
        Some(arm_pose(&self.grip()))
    }

    fn obey(&mut self, order: &Order) {
        match order {
            Order::Target(pose) | Order::Hold(pose) => self.set_target([pose.position_m[0], pose.position_m[2]]),
            // The end of a stream stops the arm at its present place instead of letting it run on to the last target.
            Order::End => {
                let here = self.grip();
                self.set_target([here.x_m, here.z_m]);
            }
        }
    }
}
