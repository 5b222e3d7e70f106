"""Nodes of every kind live through what the network and the operating system do to them: claims of memory in a datagram, and a stop.

The launch is that of the emulated arm, which has every kind of node but recorder and replayer; these run beside it.
"""

import os
import pathlib
import re
import signal
import sys
import time

import pytest
from catenary_msgs.msg import ArmState, Keypoints
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.srv import ListParameters
from sensor_msgs.msg import Image
from std_srvs.srv import SetBool

from support.contract import BY_NAME
from support.program import BAG
from support.rtps import DISCOVERY, claim, claims, discovery_port, of_users, resident_mb, send
from support.session import given, session_in


class Nodes:
    """Nodes of a session by name, with their processes, and a client of a service of each."""

    def __init__(self, session, pids):
        self.session, self.pids = session, pids
        create = session.ros.node.create_client
        self.clients = {name: create(ListParameters, f"/{name}/list_parameters") for name in pids}

    def answer(self):
        """Fails unless the processes are the same as before, and each node answers its service."""
        ros = self.session.ros
        ros.wait_for(lambda: all(c.service_is_ready() for c in self.clients.values()), 30, "the services of the nodes")
        calls = {name: client.call_async(ListParameters.Request()) for name, client in self.clients.items()}
        for name, call in calls.items():
            assert ros.result(call, 30, f"an answer of {name}").result.names
            assert self.session.pid_of(name) == self.pids[name], f"{name} was started anew"


@pytest.fixture(scope="module")
def everything(tmp_path_factory):
    """A node of every kind."""
    with session_in(tmp_path_factory.mktemp("everything")) as session:
        nodes = session.nodes | {"panda_bridge", "panda_emulator"}
        session.launch(f"address:=127.45.{session.domain}.1", file="emulated.launch.xml", nodes=nodes)
        recorder = session.node("recorder", *given(f"output:={session.folder / 'bag'}", "topics:=[/dlo/keypoints]"))
        away = "/panda/current_pose:=/other/pose"
        replayer = session.node("replayer", "-r", away, *given(f"bag:={BAG}", "loop:=true", "topics:=[/panda/current_pose]"))
        pids = {name: session.pid_of(name) for name in nodes} | {"recorder": recorder.pid, "replayer": replayer.pid}
        everything = Nodes(session, pids)
        everything.answer()
        yield everything


def test_a_claim_of_4_gib_costs_no_node_its_life_or_memory(everything):
    session, pids = everything.session, everything.pids
    reports = []
    session.ros.node.create_subscription(DiagnosticArray, "/diagnostics", reports.append, 100)
    before = {name: resident_mb(pid)[0] for name, pid in pids.items()}
    for pid in pids.values():
        # Both sockets, and each form of the claim twice.
        for port in (discovery_port(pid, session.domain), discovery_port(pid, session.domain) + 1):
            send([*claims(), *claims()], port)
    everything.answer()
    for name, pid in pids.items():
        grown_mb = resident_mb(pid)[1] - before[name]
        print(f"{name}: {before[name]:.0f} MB before, at most {grown_mb:.0f} MB more")
        # The peak holds the start of the node, too; a claim that is heard adds 4 GB.
        assert grown_mb < 500, name
    keypoints = session.ros.listen(Keypoints, "/dlo/keypoints")
    session.ros.wait_for(lambda: len(keypoints) > 10, 20, "keypoints")
    log = session.text("log/camera.log")
    assert re.search(r"DDS participant 010f636c61696d7334676962 was dropped: it is a fragment of 4096 MiB, and the limit is", log), log
    told = lambda: any("messages that claimed too much" in s.message for r in reports for s in r.status if s.name == "/camera")
    session.ros.wait_for(told, 20, "the warning of the camera on /diagnostics")


def test_a_process_that_was_stopped_goes_on(everything):
    session, pids = everything.session, everything.pids
    keypoints = session.ros.listen(Keypoints, "/dlo/keypoints")
    session.ros.wait_for(lambda: len(keypoints) > 10, 30, "keypoints")
    launch = next(child for child in session.children if child.args[1] == "launch")
    # More than once: a thread of RustDDS loses the network only if it waits at the moment of the stop.
    for stopped_s in (3, 0.3, 0.3):
        for pid in (launch.pid, *pids.values()):
            os.kill(pid, signal.SIGSTOP)
        time.sleep(stopped_s)
        for pid in (launch.pid, *pids.values()):
            os.kill(pid, signal.SIGCONT)
        keypoints.clear()
        began_s = time.monotonic()
        session.ros.wait_for(lambda: len(keypoints) > 3, 20, "keypoints")
        print(f"stopped for {stopped_s} s: the fourth keypoints {time.monotonic() - began_s:.2f} s later")
    # Longer than the checks of a lost network.
    session.ros.spin(1.5)
    everything.answer()
    assert launch.poll() is None and "restarting" not in session.text("launch.err")


def test_a_process_that_was_stopped_beyond_a_lease_says_that_it_lost_the_network(session):
    camera = session.node("camera")
    session.wait_for(lambda: "health: " in session.text("camera.err"), 20, "its first report")
    camera.send_signal(signal.SIGSTOP)
    time.sleep(16.5)
    camera.send_signal(signal.SIGCONT)
    assert camera.wait(20) == 1
    assert "the network was lost: the process stood still" in session.text("camera.err")


def test_many_claims_together_have_a_limit(session):
    session.environment["CATENARY_MESSAGE_LIMIT_MIB"] = "4"
    camera = session.node("camera")
    session.meet("camera")
    images = session.ros.node.create_publisher(Image, "/camera/camera/color/image_raw", 1)
    session.ros.wait_for(images.get_subscription_count, 20, "the camera's subscription")
    before_mb = resident_mb(camera.pid)[0]
    every = [DISCOVERY, *of_users()]
    port = discovery_port(camera.pid, session.domain)
    for writer in range(20):
        sender = b"\x01\x0fmany" + writer.to_bytes(6)
        # 1 MiB is the limit for discovery, 4 MiB that of others; without a limit on their sum this were 7 GB.
        sizes = lambda entities: (1 if entities == DISCOVERY else 4) << 20
        send((claim(sizes(e), number, e, sender) for e in every for number in (1, 2)), port)
    Nodes(session, {"camera": camera.pid}).answer()
    grown_mb = resident_mb(camera.pid)[1] - before_mb
    print(f"{before_mb:.0f} MB before, at most {grown_mb:.0f} MB more")
    # 16 times 4 MiB, and what an allocator keeps for it.
    assert grown_mb < 200
    assert "incomplete messages have" in session.text("camera.err")


def test_a_node_beyond_its_memory_limit_ends_alone_and_is_started_again(session):
    # A limit of 4095 MiB for a message lets the claim through.
    session.environment["CATENARY_MESSAGE_LIMIT_MIB"] = "4095"
    arguments = ("learning:=false", "memory_limit_mib:=1500")
    launch = session.launch(*arguments, nodes={"simulated_cell", "camera", "keypoint_tracker", "policy_runner"})
    camera, tracker = session.pid_of("camera"), session.pid_of("keypoint_tracker")
    limits = pathlib.Path(f"/proc/{camera}/limits").read_text()
    assert re.search(rf"Max data size +{1500 << 20} ", limits), limits
    send((claim(4094 << 20, 1, entities) for entities in of_users()), discovery_port(camera, session.domain))
    session.wait_for(lambda: session.pid_of("camera") not in (None, camera), 30, "a new camera")
    assert launch.poll() is None and session.pid_of("keypoint_tracker") == tracker
    assert "camera was killed by signal 6: " in session.text("launch.err")
    assert re.search(r"memory allocation of 4\d+ bytes failed", session.text("log/camera.log"))
    # Its keypoints say that the new camera works; calls may still go to the ghost of the old one.
    keypoints = session.ros.listen(Keypoints, "/dlo/keypoints")
    session.ros.wait_for(lambda: len(keypoints) > 10, 30, "keypoints")


@pytest.mark.parametrize(("name", "value"), [("CATENARY_MEMORY_LIMIT_MIB", "10"), ("CATENARY_MESSAGE_LIMIT_MIB", "64M")])
def test_a_wrong_limit_is_named(session, name, value):
    session.environment[name] = value
    camera = session.node("camera")
    assert camera.wait(20) == 2
    assert f'{name}="{value}": expected ' in session.text("camera.err")


def test_a_bridge_that_was_stopped_in_a_motion_ends_it(session):
    model = session.root / "launch_configs/models/soft_bar.yaml"
    bridge = session.node("panda_bridge", *given(f"model_file:={model}", "settle_time_s:=0.2"))
    session.start_script(sys.executable, session.root / "tests/support/stand_in_lab.py", session.domain, name="lab")
    ros, states = session.meet("panda_bridge", "cartesian_impedance_controller"), []
    row = BY_NAME["/panda/arm_state"]
    ros.node.create_subscription(row.kind, row.name, states.append, row.profile)
    ros.wait_for(lambda: states and states[-1].mode == ArmState.MODE_IDLE, 20, "an arm at rest")
    enabled = lambda: states[-1].mode in (ArmState.MODE_HOLD, ArmState.MODE_TRACKING)
    ros.wait_for(lambda: ros.call(SetBool, "/panda/enable", SetBool.Request(data=True)).success, 10, "an arm that can be enabled")
    ros.wait_for(enabled, 10, "an enabled arm")
    bridge.send_signal(signal.SIGSTOP)
    time.sleep(1.5)
    states.clear()
    bridge.send_signal(signal.SIGCONT)
    # The last state from before the stop may still come.
    ros.wait_for(lambda: states and not enabled(), 10, "an arm that is not enabled")
    ros.spin(1)
    assert states[-1].mode == ArmState.MODE_IDLE and bridge.poll() is None
    assert re.search("stood still for more than 1 s: disabled|the controller is silent: disconnected", session.text("panda_bridge.err"))
