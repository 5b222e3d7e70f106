//! Contract of the nodes: one table of topics, services and actions for nodes, recorder and documentation.
//!
//! Names are relative to the node's namespace, which is `/` by default: `panda/enable` is `/panda/enable`. They can be remapped.
//! Units are SI, quaternions are x y z w, frames follow REP-103, and a stamp is the time of measurement.

use crate::dds::qos::Qos;

/// Topic of the contract.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Topic {
    /// Default name, relative to the namespace unless it starts with a slash.
    pub name: &'static str,
    /// `package/msg/Type`.
    pub type_name: &'static str,
    /// Profile that publishers offer and subscribers request.
    pub qos: Qos,
    /// Publication rate.
    pub rate: &'static str,
    /// Content of the messages.
    pub description: &'static str,
}

/// Service or action of the contract.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Endpoint {
    /// Default name, relative to the namespace.
    pub name: &'static str,
    /// `package/srv/Type` or `package/action/Type`.
    pub type_name: &'static str,
    /// Effect of a request or goal.
    pub description: &'static str,
}

macro_rules! topics {
    ($($constant:ident: $name:literal, $type_name:literal, $qos:expr, $rate:literal, $description:literal;)*) => {
        $(
            #[doc = $description]
            pub const $constant: Topic = Topic {
                name: $name,
                type_name: $type_name,
                qos: $qos,
                rate: $rate,
                description: $description,
            };
        )*
        /// Every topic of the contract.
        pub const TOPICS: &[Topic] = &[$($constant),*];
    };
}

macro_rules! endpoints {
    ($(#[$doc:meta])* $table:ident;
     $($constant:ident: $name:literal, $type_name:literal, $description:literal;)*) => {
        $(
            #[doc = $description]
            pub const $constant: Endpoint =
                Endpoint { name: $name, type_name: $type_name, description: $description };
        )*
        $(#[$doc])*
        pub const $table: &[Endpoint] = &[$($constant),*];
    };
}

// States at a rate: a newer message replaces a lost one.
const BE1: Qos = Qos::BestEffort { depth: 1 };
// Camera: a slow subscriber may be a few frames behind.
const BE5: Qos = Qos::BestEffort { depth: 5 };
// Commands: none may be lost, and only the newest matters.
const R1: Qos = Qos::Reliable { depth: 1 };
// Events of each step: a recorder needs all of them.
const R10: Qos = Qos::Reliable { depth: 10 };
// States that change seldom: a late subscriber needs the last one.
const TL1: Qos = Qos::ReliableTransientLocal { depth: 1 };
// Episode events: a late subscriber learns whether an episode runs, from the last 16 starts and ends.
const TL16: Qos = Qos::ReliableTransientLocal { depth: 16 };

topics! {
    IMAGE: "camera/camera/color/image_raw", "sensor_msgs/msg/Image", BE5, "60 Hz",
        "Colour image of the scene, rgb8, 640x480, as realsense2_camera publishes it.";
    CAMERA_INFO: "camera/camera/color/camera_info", "sensor_msgs/msg/CameraInfo", BE5, "60 Hz",
        "Intrinsics of the colour camera.";
    MASK: "dlo/mask", "sensor_msgs/msg/Image", BE1, "at most 60 Hz",
        "Label mask, mono8, 256x256: 0 background, 1 DLO, 2 target; stamp of the image.";
    KEYPOINTS: "dlo/keypoints", "catenary_msgs/msg/Keypoints", BE1, "at most 60 Hz",
        "Four keypoints of the DLO and the centre of the target in a mask.";
    JOINT_STATES: "panda/joint_states", "sensor_msgs/msg/JointState", BE1, "200 Hz",
        "Positions, velocities and torques of panda_joint1 to panda_joint7.";
    CURRENT_POSE: "panda/current_pose", "geometry_msgs/msg/PoseStamped", BE1, "200 Hz",
        "Measured pose of panda_hand_tcp in panda_link0.";
    CURRENT_TWIST: "panda/current_twist", "geometry_msgs/msg/TwistStamped", BE1, "200 Hz",
        "Measured velocity of panda_hand_tcp in panda_link0.";
    EXTERNAL_WRENCH: "panda/external_wrench", "geometry_msgs/msg/WrenchStamped", BE1, "200 Hz",
        "Estimated external wrench on panda_hand_tcp in panda_link0.";
    ARM_STATE: "panda/arm_state", "catenary_msgs/msg/ArmState", TL1, "50 Hz and on change",
        "Mode of the arm, and its faults.";
    ARM_LAW: "panda/arm_law", "std_msgs/msg/String", TL1, "at the start and on change",
        "Law by which the arm follows a target, as a model file has it under arm.law.";
    TARGET_POSE: "panda/target_pose", "geometry_msgs/msg/PoseStamped", R1, "policy rate, or up to 50 Hz",
        "Commanded pose of panda_hand_tcp in panda_link0.";
    ACCEPTED_TARGET: "panda/accepted_target", "catenary_msgs/msg/AcceptedTarget", R10, "per command",
        "Outcome of one command on panda/target_pose.";
    ACTION: "policy/action", "catenary_msgs/msg/EefDelta", R10, "per step",
        "Displacement that the policy chose.";
    OBSERVATION: "policy/observation", "catenary_msgs/msg/Observation", R10, "per step",
        "Observation of the policy.";
    EPISODE_EVENT: "episode/event", "catenary_msgs/msg/EpisodeEvent", TL16, "per start and end",
        "Start or end of an episode.";
    POSTERIOR: "bayes_sim/posterior", "catenary_msgs/msg/Mixture", TL1, "per inference",
        "Newest posterior over the model's parameters.";
    TF: "/tf", "tf2_msgs/msg/TFMessage", Qos::TF, "200 Hz",
        "Transforms that change.";
    TF_STATIC: "/tf_static", "tf2_msgs/msg/TFMessage", Qos::TF_STATIC, "once",
        "Transforms that stay.";
    DIAGNOSTICS: "/diagnostics", "diagnostic_msgs/msg/DiagnosticArray", R10, "1 Hz",
        "Rates, drops and resident memory of every node.";
    ROSOUT: "/rosout", "rcl_interfaces/msg/Log", Qos::ReliableTransientLocal { depth: 1000 }, "per log line",
        "Logs of every node.";
    CLOCK: "/clock", "rosgraph_msgs/msg/Clock", Qos::CLOCK, "200 Hz or faster",
        "Simulated time, for nodes with use_sim_time.";
}

endpoints! {
    /// Every service of the contract.
    SERVICES;
    ENABLE: "panda/enable", "std_srvs/srv/SetBool", "Lets the arm follow targets, or stops it.";
    HOLD: "panda/hold", "std_srvs/srv/Trigger", "Holds the measured pose.";
    ERROR_RECOVERY: "panda/error_recovery", "std_srvs/srv/Trigger", "Clears a reflex or a user stop.";
    SET_COMPLIANCE: "panda/set_compliance", "catenary_msgs/srv/SetCompliance",
        "Sets stiffness, damping and error clip.";
    SIMULATE: "simulator_pool/simulate", "catenary_msgs/srv/Simulate",
        "Simulates a batch of episodes of one model.";
    OPEN_ENVS: "simulator_pool/open_envs", "catenary_msgs/srv/OpenEnvs", "Opens a vectorised environment.";
    STEP_ENVS: "simulator_pool/step_envs", "catenary_msgs/srv/StepEnvs", "Steps all environments of a handle once.";
    CLOSE_ENVS: "simulator_pool/close_envs", "catenary_msgs/srv/CloseEnvs", "Closes the environments of a handle.";
}

endpoints! {
    /// Every action of the contract.
    ACTIONS;
    MOVE_TO_START: "panda/move_to_start", "catenary_msgs/action/MoveToStart",
        "Moves the arm to the start pose and waits for rest.";
    RUN_EPISODE: "policy_runner/run_episode", "catenary_msgs/action/RunEpisode",
        "Runs one episode of a policy.";
    INFER: "bayes_sim/infer", "catenary_msgs/action/Infer",
        "Infers the posterior over the model's parameters.";
    TRAIN: "ppo_trainer/train", "catenary_msgs/action/Train",
        "Trains a policy in the simulator.";
    FIND_EFFECTS: "effect_finder/find", "catenary_msgs/action/FindEffects",
        "Locates, names and repairs effects that the model lacks.";
}

/// Default names of the topics that an arm publishes. A replay of an arm publishes them too.
pub const ARM_TOPICS: [&str; 2] = [CURRENT_POSE.name, ARM_STATE.name];

/// Default names of the services and the action that command an arm.
pub const ARM: [&str; 5] = [ENABLE.name, HOLD.name, ERROR_RECOVERY.name, SET_COMPLIANCE.name, MOVE_TO_START.name];

/// Returns the topic with this default name, with or without a leading slash.
#[must_use]
pub fn topic(name: &str) -> Option<&'static Topic> {
    let bare = name.trim_start_matches('/');
    TOPICS.iter().find(|topic| topic.name.trim_start_matches('/') == bare)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parameters::names;
    use std::collections::BTreeSet;

    #[test]
    fn every_name_is_valid_and_unique() {
        let endpoints = SERVICES.iter().chain(ACTIONS).map(|endpoint| endpoint.name);
        let names: Vec<_> = TOPICS.iter().map(|topic| topic.name).chain(endpoints).collect();
        let unique: BTreeSet<_> = names.iter().collect();
        assert_eq!(unique.len(), names.len());
        for name in names {
            names::expand(name, "/", "node").unwrap();
        }
    }

    #[test]
    fn every_type_name_has_its_kind() {
        for topic in TOPICS {
            assert_eq!(topic.type_name.split('/').nth(1), Some("msg"), "{}", topic.name);
        }
        for (table, kind) in [(SERVICES, "srv"), (ACTIONS, "action")] {
            for endpoint in table {
                assert_eq!(endpoint.type_name.split('/').nth(1), Some(kind), "{}", endpoint.name);
            }
        }
    }

    #[test]
    fn images_masks_and_states_at_a_rate_are_best_effort() {
        for name in ["camera/camera/color/image_raw", "/dlo/mask", "panda/current_pose"] {
            assert!(!topic(name).unwrap().qos.is_reliable(), "{name}");
        }
        assert_eq!(topic("/panda/arm_state").unwrap().qos, TL1);
        assert_eq!(topic("panda/target_pose").unwrap().qos, R1);
        assert_eq!(topic("nothing"), None);
    }
}
