"""The ROS 2 interface of the graph, as other programs see it: a row for each topic, service and action.

`publishers`, `subscribers` and `server` name nodes of the simulated cell's graph. `remark` says why a row has none.
"""

import importlib
from dataclasses import dataclass

BEST_EFFORT, RELIABLE, LATCHED = ("best_effort", "volatile"), ("reliable", "volatile"), ("reliable", "transient_local")
NODES = (
    "simulated_cell",
    "camera",
    "keypoint_tracker",
    "policy_runner",
    "simulator_pool",
    "bayes_sim",
    "ppo_trainer",
    "effect_finder",
)
CELL, CAMERA, TRACKER, RUNNER, POOL, BAYES, TRAINER, FINDER = NODES
BASE, OPTICAL = "panda_link0", "camera_color_optical_frame"


def interface(type_name):
    """Python class of `package/kind/Name`."""
    package, kind, name = type_name.split("/")
    return getattr(importlib.import_module(f"{package}.{kind}"), name)


@dataclass(frozen=True)
class Topic:
    """A topic with its QoS, frame and nominal rate in Hz."""

    name: str
    type_name: str
    reliability: str
    durability: str
    depth: int
    frame: str | None = None
    hz: float | None = None
    publishers: tuple = ()
    subscribers: tuple = ()
    remark: str = ""

    @property
    def kind(self):
        return interface(self.type_name)

    @property
    def profile(self):
        # Not at the top: the table of names is used without rclpy, too.
        from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

        return QoSProfile(
            history=HistoryPolicy.KEEP_LAST,
            depth=self.depth,
            reliability=ReliabilityPolicy[self.reliability.upper()],
            durability=DurabilityPolicy[self.durability.upper()],
        )

    def profile_of_depth(self, depth):
        profile = self.profile
        profile.depth = depth
        return profile


@dataclass(frozen=True)
class Endpoint:
    """A service or an action.

    `caller`: the node or command of ours that calls it, to which a server in rclpy can answer in place of ours.
    `large`: our own nodes exchange large answers by a topic beside the service.
    """

    name: str
    type_name: str
    server: str | None = None
    caller: str | None = None
    remark: str = ""
    large: bool = False

    @property
    def kind(self):
        return interface(self.type_name)


def topic(name, type_name, qos, depth, frame=None, hz=None, publishers=(), subscribers=(), remark=""):
    return Topic(name, type_name, *qos, depth, frame, hz, publishers, subscribers, remark)


TOPICS = (
    topic("/camera/camera/color/image_raw", "sensor_msgs/msg/Image", BEST_EFFORT, 5, OPTICAL, 60, (CELL,), (CAMERA,)),
    topic("/camera/camera/color/camera_info", "sensor_msgs/msg/CameraInfo", BEST_EFFORT, 5, OPTICAL, 60, (CELL,)),
    topic("/dlo/mask", "sensor_msgs/msg/Image", BEST_EFFORT, 1, OPTICAL, 60, (CAMERA,), (TRACKER,)),
    topic("/dlo/keypoints", "catenary_msgs/msg/Keypoints", BEST_EFFORT, 1, OPTICAL, 60, (TRACKER,), (RUNNER, BAYES, FINDER)),
    topic("/panda/joint_states", "sensor_msgs/msg/JointState", BEST_EFFORT, 1, BASE, 200, (CELL,)),
    topic("/panda/current_pose", "geometry_msgs/msg/PoseStamped", BEST_EFFORT, 1, BASE, 200, (CELL,), (RUNNER, BAYES, FINDER)),
    topic("/panda/current_twist", "geometry_msgs/msg/TwistStamped", BEST_EFFORT, 1, BASE, 200, (CELL,)),
    topic("/panda/external_wrench", "geometry_msgs/msg/WrenchStamped", BEST_EFFORT, 1, BASE, 200, (CELL,)),
    topic("/panda/arm_state", "catenary_msgs/msg/ArmState", LATCHED, 1, BASE, 50, (CELL,), (RUNNER,)),
    topic("/panda/arm_law", "std_msgs/msg/String", LATCHED, 1, None, None, (CELL,), (RUNNER,)),
    topic("/panda/target_pose", "geometry_msgs/msg/PoseStamped", RELIABLE, 1, BASE, None, (RUNNER,), (CELL,)),
    topic("/panda/accepted_target", "catenary_msgs/msg/AcceptedTarget", RELIABLE, 10, BASE, None, (CELL,), (RUNNER,)),
    topic("/policy/action", "catenary_msgs/msg/EefDelta", RELIABLE, 10, BASE, None, (RUNNER,), (BAYES, FINDER)),
    topic("/policy/observation", "catenary_msgs/msg/Observation", RELIABLE, 10, None, None, (RUNNER,), (BAYES, FINDER)),
    topic("/episode/event", "catenary_msgs/msg/EpisodeEvent", LATCHED, 16, None, None, (RUNNER,), (CELL, BAYES, FINDER)),
    topic("/bayes_sim/posterior", "catenary_msgs/msg/Mixture", LATCHED, 1, None, None, (BAYES,)),
    topic("/tf", "tf2_msgs/msg/TFMessage", RELIABLE, 100, None, 200, (CELL,)),
    topic("/tf_static", "tf2_msgs/msg/TFMessage", LATCHED, 1, None, None, (CELL,)),
    topic("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray", RELIABLE, 10, None, None, NODES),
    topic("/rosout", "rcl_interfaces/msg/Log", LATCHED, 1000, None, None, NODES),
    topic("/clock", "rosgraph_msgs/msg/Clock", BEST_EFFORT, 1, remark="the cell where publish_clock is set, the replayer with --clock"),
)

SERVICES = (
    Endpoint("/panda/enable", "std_srvs/srv/SetBool", CELL, RUNNER),
    Endpoint("/panda/hold", "std_srvs/srv/Trigger", CELL, remark="no node of ours calls it"),
    Endpoint("/panda/error_recovery", "std_srvs/srv/Trigger", CELL, remark="no node of ours calls it"),
    Endpoint("/panda/set_compliance", "catenary_msgs/srv/SetCompliance", CELL, remark="no node of ours calls it"),
    Endpoint("/simulator_pool/simulate", "catenary_msgs/srv/Simulate", POOL, BAYES, large=True),
    Endpoint("/simulator_pool/open_envs", "catenary_msgs/srv/OpenEnvs", POOL, TRAINER, large=True),
    Endpoint("/simulator_pool/step_envs", "catenary_msgs/srv/StepEnvs", POOL, TRAINER, large=True),
    Endpoint("/simulator_pool/close_envs", "catenary_msgs/srv/CloseEnvs", POOL, TRAINER),
)

ACTIONS = (
    Endpoint("/panda/move_to_start", "catenary_msgs/action/MoveToStart", CELL, "catenary deploy"),
    Endpoint("/policy_runner/run_episode", "catenary_msgs/action/RunEpisode", RUNNER, "catenary deploy"),
    Endpoint("/bayes_sim/infer", "catenary_msgs/action/Infer", BAYES, "catenary infer"),
    Endpoint("/ppo_trainer/train", "catenary_msgs/action/Train", TRAINER, "catenary train"),
    Endpoint("/effect_finder/find", "catenary_msgs/action/FindEffects", FINDER, "catenary find-effects"),
)

# Topics of catenary_msgs/msg/Reply for large answers between our own nodes, hidden by their names as those of actions are.
REPLIES = tuple(f"{row.name}/_reply" for row in SERVICES if row.large)

BY_NAME = {row.name: row for row in (*TOPICS, *SERVICES, *ACTIONS)}
