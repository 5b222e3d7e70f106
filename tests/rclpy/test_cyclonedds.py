"""Topics between our nodes and Cyclone DDS, the DDS of a second vendor, without ROS."""

from dataclasses import dataclass, field

import pytest
from cyclonedds.core import Policy, Qos
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.idl import IdlStruct, annotations, types
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

from support.contract import BY_NAME
from support.masks import SIZE_PX, hanging_bar
from support.waiting import wait_for

CONFIG = """<CycloneDDS><Domain><General><Interfaces><NetworkInterface name="lo" multicast="true"/></Interfaces></General>
<Discovery><ParticipantIndex>auto</ParticipantIndex><Peers><Peer Address="127.0.0.1"/></Peers></Discovery></Domain></CycloneDDS>"""


@dataclass
@annotations.final
class Time(IdlStruct, typename="builtin_interfaces::msg::dds_::Time_"):
    sec: types.int32 = 0
    nanosec: types.uint32 = 0


@dataclass
@annotations.final
class Header(IdlStruct, typename="std_msgs::msg::dds_::Header_"):
    stamp: Time = field(default_factory=Time)
    frame_id: str = ""


@dataclass
@annotations.final
class Image(IdlStruct, typename="sensor_msgs::msg::dds_::Image_"):
    header: Header
    height: types.uint32
    width: types.uint32
    encoding: str
    is_bigendian: types.uint8
    step: types.uint32
    data: types.sequence[types.uint8]


@dataclass
@annotations.final
class Keypoints(IdlStruct, typename="catenary_msgs::msg::dds_::Keypoints_"):
    header: Header
    image_width: types.uint32
    image_height: types.uint32
    dlo_u: types.array[types.float64, 4]
    dlo_v: types.array[types.float64, 4]
    dlo_scores: types.array[types.float32, 4]
    target_seen: bool
    target_u: types.float64
    target_v: types.float64
    target_score: types.float32


@dataclass
@annotations.final
class Vector(IdlStruct, typename="geometry_msgs::msg::dds_::Point_"):
    x: types.float64 = 0.0
    y: types.float64 = 0.0
    z: types.float64 = 0.0


@dataclass
@annotations.final
class Quaternion(IdlStruct, typename="geometry_msgs::msg::dds_::Quaternion_"):
    x: types.float64 = 0.0
    y: types.float64 = 0.0
    z: types.float64 = 0.0
    w: types.float64 = 1.0


@dataclass
@annotations.final
class Pose(IdlStruct, typename="geometry_msgs::msg::dds_::Pose_"):
    position: Vector = field(default_factory=Vector)
    orientation: Quaternion = field(default_factory=Quaternion)


@dataclass
@annotations.final
class PoseStamped(IdlStruct, typename="geometry_msgs::msg::dds_::PoseStamped_"):
    header: Header = field(default_factory=Header)
    pose: Pose = field(default_factory=Pose)


@dataclass
@annotations.final
class AcceptedTarget(IdlStruct, typename="catenary_msgs::msg::dds_::AcceptedTarget_"):
    header: Header
    accepted: bool
    reason: str
    pose: Pose
    clipped_x: bool
    clipped_y: bool
    clipped_z: bool
    accepted_count: types.uint64
    rejected_count: types.uint64


@dataclass
@annotations.final
class ArmState(IdlStruct, typename="catenary_msgs::msg::dds_::ArmState_"):
    header: Header
    mode: types.uint8
    errors: types.sequence[str]
    reflex: bool
    success_rate: types.float64
    fault: str
    is_sim: bool


class Cyclone:
    """A participant of Cyclone in the session's domain."""

    def __init__(self, domain):
        self.domain = Domain(domain, CONFIG)
        self.participant = DomainParticipant(domain)

    def topic(self, name, kind):
        row = BY_NAME[name]
        reliable, latched = row.reliability == "reliable", row.durability == "transient_local"
        qos = Qos(
            Policy.Reliability.Reliable(duration(milliseconds=100)) if reliable else Policy.Reliability.BestEffort,
            Policy.Durability.TransientLocal if latched else Policy.Durability.Volatile,
            Policy.History.KeepLast(max(row.depth, 10)),
            Policy.DataRepresentation(use_cdrv0_representation=True),
        )
        return Topic(self.participant, f"rt{name}", kind, qos=qos), qos

    def reader(self, name, kind):
        topic, qos = self.topic(name, kind)
        return DataReader(self.participant, topic, qos=qos)

    def writer(self, name, kind):
        topic, qos = self.topic(name, kind)
        return DataWriter(self.participant, topic, qos=qos)


def test_a_mask_of_cyclone_becomes_keypoints_that_cyclone_reads(session):
    session.node("keypoint_tracker")
    cyclone = Cyclone(session.domain)
    masks, keypoints = cyclone.writer("/dlo/mask", Image), cyclone.reader("/dlo/keypoints", Keypoints)
    pixels = list(hanging_bar().data)
    header = Header(Time(5, 7), "somewhere")
    image = Image(header, SIZE_PX, SIZE_PX, "mono8", 0, SIZE_PX, pixels)

    def answered():
        masks.write(image)
        return keypoints.take(1)

    (seen,) = wait_for(answered, 20, "keypoints of the mask")
    assert seen.header == header and (seen.image_width, seen.image_height) == (SIZE_PX, SIZE_PX)
    assert list(seen.dlo_u) == pytest.approx([128] * 4, abs=2)
    assert seen.target_seen and (seen.target_u, seen.target_v) == pytest.approx((210, 190), abs=1.5)


def test_a_target_of_cyclone_is_answered_by_the_cell(session):
    model = session.root / "launch_configs/models/soft_bar.yaml"
    session.node("simulated_cell", "-p", f"model_file:={model}", "-p", "fidelity:=fast")
    cyclone = Cyclone(session.domain)
    # This reader is later than the cell and gets the latched state.
    states, poses = cyclone.reader("/panda/arm_state", ArmState), cyclone.reader("/panda/current_pose", PoseStamped)
    (state,) = wait_for(lambda: states.take(1), 20, "the arm's state")
    assert state.mode == 0 and state.is_sim and state.header.frame_id == "panda_link0" and state.success_rate == 1.0
    (measured,) = wait_for(lambda: poses.take(1), 20, "a pose")
    assert (measured.pose.position.x, measured.pose.position.z) == pytest.approx((0.40, 0.42), abs=0.01)
    targets, answers = cyclone.writer("/panda/target_pose", PoseStamped), cyclone.reader("/panda/accepted_target", AcceptedTarget)

    def answered():
        targets.write(PoseStamped(Header(Time(8, 9), "panda_link0"), measured.pose))
        return answers.take(1)

    (answer,) = wait_for(answered, 20, "an answer to the target")
    assert not answer.accepted and "not enabled" in answer.reason
    assert answer.header == Header(Time(8, 9), "panda_link0")
