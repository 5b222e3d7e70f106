"""Nodes of a lab in rclpy that replace ours: an arm, a policy runner, a simulator pool, inference and training."""

import math
import threading
import time

import rclpy
import tomllib
from catenary_msgs.action import FindEffects, Infer, MoveToStart, RunEpisode, Train
from catenary_msgs.msg import AcceptedTarget, ArmState, Keypoints, Mixture, Parameter, Track
from catenary_msgs.srv import CloseEnvs, OpenEnvs, StepEnvs
from geometry_msgs.msg import PoseStamped
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import MultiThreadedExecutor

from .contract import BASE, BY_NAME, OPTICAL
from .policy import policy_file
from .program import ROOT
from .ros import sees

IMAGE_PX = 256
# bayes_sim takes no tracks from a pool of another version than its own.
VERSION = tomllib.loads((ROOT / "Cargo.toml").read_text())["workspace"]["package"]["version"]


class StandIn:
    """A node of rclpy in a context of its own, spun by its own threads."""

    def __init__(self, domain, name):
        self.context = rclpy.Context()
        self.context.init(domain_id=domain)
        self.node = rclpy.create_node(name, context=self.context)
        self.group = ReentrantCallbackGroup()
        self.executor = MultiThreadedExecutor(3, context=self.context)
        self.executor.add_node(self.node)
        self.thread = threading.Thread(target=self.executor.spin)

    def __enter__(self):
        self.thread.start()
        return self

    def __exit__(self, *_):
        self.executor.shutdown()
        self.thread.join()
        # rclpy's shutdown does not wait for its thread pool. A callback that starts after the node is destroyed would fail, and
        # the garbage collector would print its error in the middle of another test.
        self.executor._executor.shutdown(wait=True)
        self.node.destroy_node()
        self.context.try_shutdown()

    def sees(self, *nodes):
        return sees(self.node, nodes)

    def publisher(self, name):
        row = BY_NAME[name]
        return self.node.create_publisher(row.kind, name, row.profile)

    def listen(self, name, heard):
        row = BY_NAME[name]
        self.node.create_subscription(row.kind, name, heard, row.profile, callback_group=self.group)

    def serve(self, name, answer):
        self.node.create_service(BY_NAME[name].kind, name, answer, callback_group=self.group)

    def act(self, name, execute, accepts=lambda goal: True):
        ActionServer(
            self.node, BY_NAME[name].kind, name, execute, callback_group=self.group,
            goal_callback=lambda goal: GoalResponse.ACCEPT if accepts(goal) else GoalResponse.REJECT,
            cancel_callback=lambda goal: CancelResponse.ACCEPT,
        )  # fmt: skip

    def stamped(self, message, frame):
        message.header.stamp, message.header.frame_id = self.node.get_clock().now().to_msg(), frame
        return message


class Arm(StandIn):
    """An arm that reaches each target at once, and keypoints of a bar that hangs from it."""

    def __init__(self, domain):
        super().__init__(domain, "lab_arm")
        self.pose = PoseStamped().pose
        self.pose.position.x, self.pose.position.z = 0.40, 0.42
        self.pose.orientation.x, self.pose.orientation.w = 1.0, 0.0
        self.enabled, self.requests, self.targets = False, [], []
        # Mode that it tells while it is not enabled; None tells no state, as between two messages of a slow topic.
        self.disabled_mode = ArmState.MODE_IDLE
        self.swing_px, self.shows_target = 0.0, lambda: True
        self.state, self.told = self.publisher("/panda/arm_state"), self.publisher("/panda/current_pose")
        self.keypoints, self.answers = self.publisher("/dlo/keypoints"), self.publisher("/panda/accepted_target")
        self.serve("/panda/enable", self.enable)
        self.listen("/panda/target_pose", self.follow)
        self.node.create_timer(0.02, self.measure, callback_group=self.group)

    def enable(self, request, response):
        self.enabled = request.data
        self.requests.append(request.data)
        response.success = True
        return response

    def follow(self, target):
        self.targets.append(target)
        self.pose = target.pose
        self.answers.publish(AcceptedTarget(header=target.header, accepted=True, pose=target.pose))

    def measure(self):
        mode = ArmState.MODE_TRACKING if self.enabled else self.disabled_mode
        if mode is not None:
            self.state.publish(self.stamped(ArmState(mode=mode, success_rate=1.0, is_sim=True), BASE))
        self.told.publish(self.stamped(PoseStamped(pose=self.pose), BASE))
        u = IMAGE_PX * self.pose.position.x + self.swing_px * math.sin(6.0 * time.monotonic())
        seen = Keypoints(image_width=IMAGE_PX, image_height=IMAGE_PX, dlo_u=[u] * 4, dlo_v=[100.0, 120.0, 140.0, 160.0])
        seen.dlo_scores, seen.target_seen = [1.0] * 4, self.shows_target()
        seen.target_u, seen.target_v, seen.target_score = 200.0, 200.0, float(seen.target_seen)
        self.keypoints.publish(self.stamped(seen, OPTICAL))


class Stranger(StandIn):
    """Another laboratory's graph: it accepts every command and notes its name. Its publishers (`publishes`) stay silent."""

    SERVICES = ("/panda/enable", "/panda/hold", "/panda/error_recovery", "/panda/set_compliance")
    ACTIONS = ("/panda/move_to_start", "/policy_runner/run_episode")

    def __init__(self, domain, services=SERVICES, actions=ACTIONS, topics=("/panda/target_pose",), publishes=()):
        super().__init__(domain, "lab_robot")
        self.received = []
        self.publishers = [self.publisher(name) for name in publishes]
        for name in services:
            self.serve(name, self.noting(name))
        for name in actions:
            self.act(name, self.done, accepts=lambda goal, name=name: self.received.append(name) or True)
        for name in topics:
            self.listen(name, lambda message, name=name: self.received.append(name))

    def noting(self, name):
        def answer(request, response):
            self.received.append(name)
            response.success = True
            return response

        return answer

    def done(self, handle):
        handle.succeed()
        return BY_ACTION[type(handle.request)].Result(success=True)


BY_ACTION = {MoveToStart.Goal: MoveToStart, RunEpisode.Goal: RunEpisode}


class Runner(StandIn):
    """A policy runner and arm that report moves and episodes without doing them."""

    def __init__(self, domain, steps=3, refuses=False, endless=False):
        super().__init__(domain, "lab_runner")
        self.goals, self.moves, self.steps, self.endless = [], 0, steps, endless
        self.act("/panda/move_to_start", self.move)
        self.act("/policy_runner/run_episode", self.run, accepts=lambda goal: not refuses)

    def move(self, handle):
        self.moves += 1
        handle.publish_feedback(MoveToStart.Feedback(distance=0.1))
        handle.succeed()
        return MoveToStart.Result(success=True)

    def run(self, handle):
        self.goals.append(handle.request)
        pause, step = threading.Event(), 0
        while step < self.steps or self.endless:
            if handle.is_cancel_requested:
                handle.canceled()
                return RunEpisode.Result(message="cancelled", end="cancelled")
            handle.publish_feedback(RunEpisode.Feedback(step=step, reward=0.25))
            step += 1
            pause.wait(0.05)
        handle.succeed()
        return RunEpisode.Result(success=True, episode=41, end="step_limit", rewards=[0.25] * step, episode_return=0.25 * step)


class Pool(StandIn):
    """A simulator pool by formula: bars hang straight down, longer and softer ones lower."""

    def __init__(self, domain):
        super().__init__(domain, "lab_pool")
        self.simulated, self.opened, self.stepped, self.closed = [], [], 0, []
        self.serve("/simulator_pool/simulate", self.simulate)
        self.serve("/simulator_pool/open_envs", self.open)
        self.serve("/simulator_pool/step_envs", self.step)
        self.serve("/simulator_pool/close_envs", self.close)

    def simulate(self, request, response):
        self.simulated.append(request)
        frames = len(request.frame_times)
        for length_m, modulus_pa in zip(request.theta[0::2], request.theta[1::2]):
            softness = 0.02 * (12.0 - math.log(modulus_pa))
            hang = [c for k in range(1, 5) for c in (0.0, (length_m + softness) * k - 0.5)]
            response.tracks.append(
                Track(
                    time=request.frame_times, dlo=hang * frames, target=[0.1, 0.2] * frames, eef=[0.4, 0.42, 0.0] * frames,
                    action=[0.0, 0.0] * frames, end="complete",
                )
            )  # fmt: skip
        response.success, response.version = True, VERSION
        return response

    def open(self, request: OpenEnvs.Request, response):
        self.opened.append(request)
        response.success, response.handle, response.observations = True, 7, [0.4, 0.42] + [0.0] * 10
        response.observations *= request.count
        return response

    def step(self, request: StepEnvs.Request, response):
        self.stepped += 1
        count = len(request.actions) // 2
        response.success, response.rewards = True, [float(dx) for dx in request.actions[0::2]]
        response.observations = ([0.4, 0.42] + [0.0] * 10) * count
        response.final_observations = response.observations
        response.truncated, response.terminated = [self.stepped % 16 == 0] * count, [False] * count
        return response

    def close(self, request: CloseEnvs.Request, response):
        self.closed.append(request.handle)
        response.success = True
        return response


class Learner(StandIn):
    """Servers of inference, training and effect search with fixed answers."""

    def __init__(self, domain, endless=False):
        super().__init__(domain, "lab_learner")
        self.goals, self.cancelled, self.endless = [], 0, endless
        self.act("/bayes_sim/infer", self.infer)
        self.act("/ppo_trainer/train", self.train)
        self.act("/effect_finder/find", self.find)

    def work(self, handle, feedback):
        """Publishes feedback until the goal is done; returns True if it was cancelled."""
        self.goals.append(handle.request)
        pause, step = threading.Event(), 0
        while step < 4 or self.endless:
            if handle.is_cancel_requested:
                handle.canceled()
                self.cancelled += 1
                return True
            handle.publish_feedback(feedback(step))
            step += 1
            pause.wait(0.05)
        handle.succeed()
        return False

    def infer(self, handle):
        if self.work(handle, lambda step: Infer.Feedback(iteration=step, iterations=4, simulations=10 * step)):
            return Infer.Result(message="cancelled")
        parameters = [
            Parameter(name="length_m", prior=Parameter.PRIOR_UNIFORM, low=0.195, high=0.305),
            Parameter(name="youngs_modulus_pa", prior=Parameter.PRIOR_LOG_UNIFORM, low=1e3, high=5e4),
        ]
        middle = Mixture(parameters=parameters, weights=[1.0], means=[0.5, 0.5], covariances=[1e-4, 0.0, 0.0, 1e-4])
        found = {"losses": [1.5], "effective_sample_size": 33.0, "warnings": ["a warning"]}
        return Infer.Result(success=True, posterior=middle, simulations=40, **found)

    def train(self, handle):
        if self.work(handle, lambda step: Train.Feedback(steps=8 * step, total_steps=32, mean_return=0.5, success_rate=0.25)):
            return Train.Result(message="cancelled")
        curve = {"curve_steps": [16, 32], "curve_returns": [0.25, 0.5], "curve_successes": [0.0, 0.5]}
        curve |= {"curve_entropies": [1.5, 1.0], "curve_value_losses": [0.2, 0.1]}
        last = {"last_returns": [0.4, 0.6], "last_successes": [False, True]}
        return Train.Result(success=True, policy=policy_file(), steps_per_second=320.0, **curve, **last)

    def find(self, handle):
        if self.work(handle, lambda step: FindEffects.Feedback(stage="name", progress=0.25 * step)):
            return FindEffects.Result(message="cancelled")
        words = "the present model fits\ntip mass explains it"
        effects = {"found": ["tip_mass_kg"], "effects": ["tip_mass_kg", "density_change"], "probabilities": [0.75, 0.25]}
        return FindEffects.Result(success=True, message=words, verdict="named", model_yaml="version: 1\n", **effects)
