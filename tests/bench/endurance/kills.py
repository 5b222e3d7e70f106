"""SIGKILL to each node during an episode, and its effect on the episode, the arm and the graph."""

import math
import os
import signal
import time

from action_msgs.msg import GoalStatus
from catenary_msgs.action import Infer, Train
from catenary_msgs.msg import ArmState
from catenary_msgs.srv import Simulate
from rclpy.action import ActionClient
from rclpy.serialization import deserialize_message

from bag_stamps import stamps_in
from graph import Driver, Heard
from support.contract import BAYES, BY_NAME, CAMERA, CELL, POOL, RUNNER, TOPICS, TRACKER, TRAINER
from support.policy import STEPS
from support.program import BAG, MODEL
from support.stamps import stamp_of_bytes_ns

RECORDER = "recorder"
VICTIMS = (CAMERA, TRACKER, RUNNER, CELL, POOL, BAYES, TRAINER, RECORDER)
# Nodes that an episode needs: it goes on only if they are back in time.
NEEDED = {CAMERA, TRACKER, RUNNER, CELL}
POSE, STATE, TARGET, ACCEPTED = "/panda/current_pose", "/panda/arm_state", "/panda/target_pose", "/panda/accepted_target"
# Topics that flow again after a restart: the node's own, and those of nodes that depend on it.
FLOWS = {
    CAMERA: ("/dlo/mask", "/dlo/keypoints"),
    TRACKER: ("/dlo/keypoints",),
    CELL: (POSE, STATE, "/camera/camera/color/camera_info", "/dlo/mask", "/dlo/keypoints"),
}
ENABLED = (ArmState.MODE_TRACKING, ArmState.MODE_HOLD, ArmState.MODE_MOVING)
# Longest time from the kill to an arm that follows no target: data may be 1 s late, the step after it takes 0.5 s, and the arm
# treats one and a half steps without a target as silence.
STOP_S = 2.5
# Largest motion of an arm that counts as standing.
STILL_M = 0.001
# Longest time until everything works again: 1 s of the launch's delay, the start, discovery, and the lease of the arm's commander.
HEALED_S = 15
# Longest end of a recording that a killed recorder may lose: 1 s, and half a second for a busy machine.
LACKS_S = 1.5


def distance(a, b):
    a, b = a.pose.position, b.pose.position
    return math.dist((a.x, a.y, a.z), (b.x, b.y, b.z))


def bag_lacks(bag, killed):
    """Seconds between the last message in a killed recorder's bag and the kill."""
    last = max(logged for path in bag.glob("*.mcap") for rows in stamps_in(path).values() for _, logged in rows)
    return 1e-9 * (killed - last)


class Kills:
    """A graph with a recorder, whose processes are killed one at a time."""

    def __init__(self, session, say):
        self.session, self.say = session, say
        session.launch()
        self.ros = session.ros
        topics = {POSE, STATE, TARGET, ACCEPTED, "/policy/action", *(topic for topics in FLOWS.values() for topic in topics)}
        self.heard = {name: Heard(self.ros, name) for name in topics}
        self.recorders = 0
        self.record()
        self.driver = Driver(self.ros)
        self.driver.episode(0, steps=2)

    def record(self):
        self.recorders += 1
        self.bag = self.session.folder / f"bag_{self.recorders}"
        self.recorder = self.session.start("record", "--out", self.bag, name=f"recorder_{self.recorders}")
        self.session.wait_for(self.bag.exists, 20, "the recorder's bag")

    def pid_of(self, node):
        if node == RECORDER:
            return self.recorder.pid if self.recorder.poll() is None else None
        return self.session.pid_of(node)

    def kill(self, node):
        """Kills a node during an episode; returns the figures of a row."""
        self.driver.to_start()
        goal = self.driver.begin(1)
        begun = time.time_ns()
        self.ros.wait_for(lambda: len(self.heard["/policy/action"].since(begun)) >= 3, 20, "three actions")
        result, ended = goal.get_result_async(), []
        result.add_done_callback(lambda _: ended.append(time.time_ns()))
        first, bag = self.pid_of(node), self.bag
        os.kill(first, signal.SIGKILL)
        killed = time.time_ns()
        if node == RECORDER:
            self.recorder.wait()
            self.record()
        else:
            self.ros.wait_for(lambda: self.session.pid_of(node) not in (None, first), 10, f"{node} to be started again")
        back = time.time_ns()
        found = {"victim": node, "process_s": 1e-9 * (back - killed)}
        found |= {"flows_s": self.flow(node, killed, back), "served_s": self.serve(node, killed)}
        found |= self.end_of(goal, result, ended, node, killed)
        found |= self.arm(back if node == CELL else killed, killed, found["went_on"])
        found |= self.next_episode(node, killed)
        return found | ({"bag_lacks_s": bag_lacks(bag, killed)} if node == RECORDER else {})

    def flow(self, node, killed, back):
        """Seconds from the kill until all topics of FLOWS are heard from after the restart; None for other nodes."""
        if node not in FLOWS:
            return None
        wanted = [self.heard[name] for name in FLOWS[node]]
        self.ros.wait_for(lambda: all(heard.sent_since(back) for heard in wanted), 30, f"the topics of {node}")
        return 1e-9 * (time.time_ns() - killed)

    def end_of(self, goal, result, ended, node, killed):
        """Tells whether the episode went on to its end; if not, how and when it ended.

        The result never comes from a dead runner, so the restarted one is asked for it, too.
        """
        asked = time.monotonic()
        answers = [result]

        def known():
            nonlocal asked
            if node == RUNNER and time.monotonic() - asked > 2:
                asked = time.monotonic()
                answers.append(goal.get_result_async())
            return next((answer.result() for answer in answers if answer.done()), None)

        answer = self.ros.wait_for(known, 40, "an end of the episode")
        seconds = 1e-9 * ((ended[0] if ended else time.time_ns()) - killed)
        if answer.status == GoalStatus.STATUS_SUCCEEDED:
            whole = len(answer.result.rewards) == STEPS
            return {"went_on": whole, "end": answer.result.end, "end_s": None if whole else seconds}
        end = answer.result.message or "no node knows of it any more"
        return {"went_on": False, "end": end, "end_s": seconds}

    def arm(self, since, killed, went_on):
        """Time at which the arm stopped following targets, its motion and accepted targets after that, and its mode at the end.

        Times are stamps of the arm's messages; `since` is the time from which there is an arm.
        """
        self.ros.spin(1)
        states, poses = self.measured(STATE, since), self.measured(POSE, since)
        mode = states[-1][1].mode
        if went_on:
            return {"stopped_s": None, "moved_m": None, "targets": None, "mode": mode}
        stopped = next((stamp for stamp, state in states if state.mode != ArmState.MODE_TRACKING), None)
        if stopped is None:
            return {"stopped_s": None, "moved_m": math.inf, "targets": None, "mode": mode}
        # 10 ms, two measurements at 200 Hz, until the order to stop takes effect.
        after = [pose for stamp, pose in poses if stamp > stopped + 10_000_000]
        accepted = [answer.accepted for stamp, answer in self.measured(ACCEPTED, since) if stamp > stopped]
        moved = max(distance(pose, after[0]) for pose in after)
        return {"stopped_s": 1e-9 * (stopped - killed), "moved_m": moved, "targets": sum(accepted), "mode": mode}

    def measured(self, name, since):
        """Stamps and messages of a topic from a time on."""
        heard = self.heard[name]
        stamped = [(stamp_of_bytes_ns(message[3]), message[3]) for message in heard.since(since)]
        return [(stamp, deserialize_message(bytes(data), heard.kind)) for stamp, data in stamped if stamp > since]

    def next_episode(self, node, killed):
        """Seconds from the kill to the begin of the next whole episode, refusals before it, and its number of steps."""
        refusals = []
        while True:
            try:
                self.driver.to_start()
                began = time.time_ns()
                result = self.driver.episode(2)
                return {"next_s": 1e-9 * (began - killed), "refusals": sorted(set(refusals)), "next_steps": len(result.rewards)}
            except AssertionError as error:
                refusals.append(str(error))
                assert time.time_ns() - killed < 120e9, f"no episode within 2 min after the death of {node}: {refusals[-1]}"

    def serve(self, node, killed):
        """Seconds from the kill until a learning node completes a goal again, or until the next bag has every flowing topic."""
        model = MODEL.read_text()
        if node in (POOL, TRAINER):
            sizes = {"total_steps": 64, "environments": 2, "fidelity": Simulate.Request.FIDELITY_FAST}
            self.act("/ppo_trainer/train", Train.Goal(model_yaml=model, **sizes))
        elif node == BAYES:
            goal = Infer.Goal(source=Infer.Goal.SOURCE_BAG, bags=[str(BAG)], model_yaml=model, iterations=1, simulations=20)
            self.act("/bayes_sim/infer", goal)
        elif node == RECORDER:
            flowing = {row.name for row in TOPICS if row.hz and row.name != "/camera/camera/color/image_raw"}
            path = self.bag / f"{self.bag.name}_0.mcap"
            self.ros.wait_for(lambda: flowing <= set(stamps_in(path)), 20, "all topics in the new bag")
        else:
            return None
        return 1e-9 * (time.time_ns() - killed)

    def act(self, name, goal):
        """Runs a goal to its end; sends it again after a second if no server answers or the server lacks another node."""
        client = ActionClient(self.ros.node, BY_NAME[name].kind, name)
        deadline = time.monotonic() + 60
        while True:
            try:
                result = self.ros.result(self.driver.send(client, goal, 3).get_result_async(), 30, f"the end of {name}").result
                assert result.success, f"{name}: {result.message}"
                return
            except AssertionError as error:
                self.say(str(error))
                if time.monotonic() > deadline:
                    raise
                self.ros.spin(1)


def run(session, victims, say):
    """Kills the victims one after the other; returns a row of figures for each."""
    kills = Kills(session, say)
    found = []
    for victim in victims:
        found.append(kills.kill(victim))
        say(f"{victim}: {found[-1]}")
    session.stop(kills.recorder)
    return found


def healed_s(row):
    """Seconds from the kill until the victim does all of its work again; for nodes of an episode, until the next whole episode."""
    needed = row["next_s"] if row["victim"] in NEEDED and not row["went_on"] else 0
    return max(row["process_s"], row["flows_s"] or 0, row["served_s"] or 0, needed)


def fails_safe(row):
    """Tells whether an episode that did not go on left a standing arm; the cell's arm is judged from its restart on."""
    stops_s = STOP_S + (row["process_s"] if row["victim"] == CELL else 0)
    stopped = row["stopped_s"] is not None and row["stopped_s"] < stops_s
    return stopped and row["moved_m"] < STILL_M and row["targets"] == 0 and row["mode"] not in ENABLED


def verdicts(found):
    """Pairs of a requirement in words and True if it holds."""
    for row in found:
        victim = row["victim"]
        if row["went_on"]:
            yield f"{victim} dies: the episode goes on to its end", True
        else:
            stopped = "never stops"
            if row["stopped_s"] is not None:
                stopped = f"stops after {row['stopped_s']:.2f} s, then moves {1e3 * row['moved_m']:.2f} mm"
            yield f"{victim} dies: the episode fails after {row['end_s']:.1f} s, the arm {stopped}", victim in NEEDED and fails_safe(row)
        yield f"{victim} is healed in {healed_s(row):.1f} s", healed_s(row) < HEALED_S
        yield f"the next episode after the death of {victim} has {row['next_steps']} steps", row["next_steps"] == STEPS
        if victim == RECORDER:
            yield f"its bag lacks the last {row['bag_lacks_s']:.2f} s", row["bag_lacks_s"] < LACKS_S
