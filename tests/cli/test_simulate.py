"""`catenary simulate` makes figures, a bag that inference reads, a video and a picture of an episode; mistakes are named."""

import os
import shutil
import signal
import subprocess

import pytest
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from support.program import MODEL, MODELS, ROOT
from support.waiting import wait_for

BAR = MODELS / "dlo_0.yaml"
CABLE = MODELS / "measured_cable.yaml"
ACTIONS = "dx_m,dz_m\n" + "0.05,-0.05\n0.04,-0.06\n" * 2
# Stand-in of ffmpeg that writes the number of bytes on its stdin, or fails if FFMPEG_FAILS is set.
FFMPEG = """#!/bin/sh
[ "$FFMPEG_FAILS" ] && { echo "Unknown encoder" >&2; exit 1; }
for last; do :; done
wc -c > "${last#file:}"
"""


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "actions.csv").write_text(ACTIONS)
    return tmp_path


@pytest.fixture
def report(program, folder):
    """Document that `catenary simulate` prints in the test's folder."""
    return lambda *arguments, **environment: program.json("simulate", *arguments, folder=folder, **environment)


@pytest.fixture
def refused(program, folder):
    """Runs `catenary simulate`, which has to be refused with one line that holds all of `says`, and to leave no file."""

    def run(*arguments, says, **environment):
        before = sorted(folder.iterdir())
        done = program("simulate", *arguments, folder=folder, **environment)
        assert done.returncode in (1, 2) and done.stdout == ""
        lines = done.stderr.splitlines()
        assert len(lines) == 1 and lines[0].startswith("catenary: "), done.stderr
        for part in says:
            assert part in lines[0], done.stderr
        assert sorted(folder.iterdir()) == before, "something was left behind"

    return run


EPISODE = ("--model", BAR, "--actions", "actions.csv")
ONE = (*EPISODE, "--fidelity", "fast")


def test_an_episode_becomes_figures_a_bag_and_a_video(report, folder):
    said = report(*ONE, "--out", "out/bag", "--video", "out/bar.gif", "--effect", "table_friction=0.4")
    (episode,) = said["episodes"]
    assert episode["parameters"] == {
        "length_m": 0.2, "youngs_modulus_pa": 45000.0, "table_friction": 0.4, "kelvin_voigt_time_s": pytest.approx(0.0224, abs=1e-4)
    }  # fmt: skip
    assert episode["duration_s"] == 2.0 and len(episode["rewards"]) == 4 and episode["unconverged_steps"] == 0
    heights = [z for _, z in episode["keypoints_m"]]
    assert heights == sorted(heights, reverse=True), "it hangs from the grip"
    gif = (folder / "out/bar.gif").read_bytes()
    assert gif.startswith(b"GIF89a") and gif.endswith(b";") and 20_000 < len(gif) < 2_000_000
    assert sorted(p.name for p in (folder / "out").iterdir()) == ["bag", "bar.gif"]
    with Reader(folder / "out/bag") as bag:
        counts = {c.topic: c.msgcount for c in bag.connections}
    assert counts == {
        "/dlo/keypoints": 121, "/panda/current_pose": 401, "/panda/current_twist": 401, "/panda/external_wrench": 401,
        "/panda/joint_states": 401, "/panda/arm_state": 1, "/tf": 401, "/tf_static": 1, "/panda/target_pose": 4,
        "/panda/accepted_target": 4, "/policy/action": 4, "/policy/observation": 5, "/episode/event": 2,
    }  # fmt: skip
    assert said["messages"] == sum(counts.values())


def test_the_bag_holds_transforms_of_hand_and_camera_and_the_answer_to_each_target(report, folder):
    report(*ONE, "--out", "bag")
    store = get_typestore(Stores.ROS2_JAZZY)
    definition = (ROOT / "msgs/msg/AcceptedTarget.msg").read_text()
    store.register(get_types_from_msg(definition, "catenary_msgs/msg/AcceptedTarget"))
    read = {t: [] for t in ("/tf_static", "/tf", "/panda/current_pose", "/panda/target_pose", "/panda/accepted_target")}
    with Reader(folder / "bag") as bag:
        for source, _, data in bag.messages([c for c in bag.connections if c.topic in read]):
            read[source.topic].append(store.deserialize_cdr(data, source.msgtype))
    (camera,) = read["/tf_static"][0].transforms
    assert (camera.header.frame_id, camera.child_frame_id) == ("panda_link0", "camera_color_optical_frame")
    for pose, tf in zip(read["/panda/current_pose"], read["/tf"], strict=True):
        (hand,) = tf.transforms
        assert (hand.header, hand.child_frame_id) == (pose.header, "panda_hand_tcp")
        assert (hand.transform.translation.x, hand.transform.translation.z) == (pose.pose.position.x, pose.pose.position.z)
    for i, (target, answer) in enumerate(zip(read["/panda/target_pose"], read["/panda/accepted_target"], strict=True)):
        assert answer.accepted and answer.reason == "" and answer.accepted_count == i + 1
        assert (answer.header, answer.pose) == (target.header, target.pose)


def test_inference_reads_the_bag(program, report, folder):
    report(*ONE, "--out", "bag", "--noise", "--seed", 3)
    sizes = ["--preset", "networks", "--iterations", 1, "--simulations", 40]
    said = program.json("infer", "--bag", "bag", "--model", MODEL, "--out", "out", *sizes, folder=folder)
    assert said["frames"] == 9


def test_images_go_into_the_bag_on_request(report, folder):
    (folder / "actions.csv").write_text("dx_m,dz_m\n0.01,0\n")
    report(*ONE, "--out", "bag", "--images")
    store = get_typestore(Stores.ROS2_JAZZY)
    with Reader(folder / "bag") as bag:
        (source,) = [c for c in bag.connections if c.topic == "/camera/camera/color/image_raw"]
        pictures = [store.deserialize_cdr(data, source.msgtype) for _, _, data in bag.messages([source])]
    assert len(pictures) == 31 and {(p.width, p.height, p.encoding) for p in pictures} == {(640, 480, "rgb8")}
    assert (pictures[0].data != pictures[-1].data).any()


def test_one_seed_gives_one_bag_and_video_and_another_seed_others(report, folder):
    for name, seed in (("a", 7), ("b", 7), ("c", 8)):
        report(*ONE, "--noise", "--seed", seed, "--out", f"{name}/bag", "--video", f"{name}/bar.gif")
    read = lambda name, file: (folder / name / file).read_bytes()
    for file in ("bag/bag_0.mcap", "bar.gif"):
        assert read("a", file) == read("b", file)
        assert read("a", file) != read("c", file)


def test_a_recorded_motion_is_followed_and_compared(report):
    report(*ONE, "--out", "bag")
    (episode,) = report("--model", BAR, "--track", "bag", "--fidelity", "fast")["episodes"]
    assert episode["rmse_mm"] < 2.0 and episode["rewards"] == []
    (other,) = report("--model", BAR, "--track", "bag", "--fidelity", "fast", "--theta", "length_m=0.3")["episodes"]
    assert other["rmse_mm"] > 20.0


def test_a_cable_seen_in_a_plane_becomes_a_video(report, folder):
    columns = "t_s,grip_x_m,grip_z_m,grip_pitch_rad," + ",".join(f"p{i}_{a}_m" for i in range(1, 5) for a in "xz")
    rows = [[0.1 * i, 0.01 * i, 0.75, 0.0, *(c for k in range(1, 5) for c in (0.01 * i, 0.75 - 0.1 * k))] for i in range(8)]
    (folder / "track.csv").write_text("\n".join([columns, *(",".join(f"{v:.3f}" for v in row) for row in rows)]) + "\n")
    said = report("--model", CABLE, "--track", "track.csv", "--fidelity", "fast", "--video", "c.gif")
    assert said["episodes"][0]["rmse_mm"] < 100.0
    assert (folder / "c.gif").stat().st_size > 5_000


def test_several_models_go_into_one_picture(report, refused, folder):
    models = [part for i in range(4) for part in ("--model", MODELS / f"dlo_{i}.yaml")]
    arguments = (*models, "--actions", "actions.csv", "--fidelity", "fast")
    said = report(*arguments, "--picture", "four.png", "--moments", 3)
    assert [e["model"] for e in said["episodes"]] == [f"dlo_{i}" for i in range(4)]
    assert (folder / "four.png").read_bytes().startswith(b"\x89PNG")
    refused(*arguments, "--out", "bag", says=("--out", "one --model", "got 4"))


def test_mp4_goes_through_ffmpeg_or_is_refused_with_gif_as_the_alternative(report, refused, folder):
    refused(*ONE, "--video", "bar.mp4", says=("bar.mp4", "ffmpeg", ".gif"), PATH=str(folder / "nowhere"))
    ffmpeg = folder / "bin/ffmpeg"
    ffmpeg.parent.mkdir()
    ffmpeg.write_text(FFMPEG)
    ffmpeg.chmod(0o755)
    path = f"{ffmpeg.parent}:{os.environ['PATH']}"
    refused(*ONE, "--video", "bar.mp4", says=("bar.mp4", "Unknown encoder"), PATH=path, FFMPEG_FAILS="1")
    report(*ONE, "--video", "bar.mp4", "--video-rate", 10, PATH=path)
    assert int((folder / "bar.mp4").read_text()) == 21 * 640 * 480 * 3


@pytest.mark.skipif(shutil.which("ffmpeg") is None, reason="there is no ffmpeg on the PATH")
@pytest.mark.parametrize("size", [(640, 480), (641, 479)])
def test_the_real_ffmpeg_makes_a_video_of_every_frame(report, folder, size):
    (width, height), name = size, "a: bar.mp4"
    text = BAR.read_text().replace("image_width_px: 640", f"image_width_px: {width}")
    (folder / "bar.yaml").write_text(text.replace("image_height_px: 480", f"image_height_px: {height}"))
    report("--model", "bar.yaml", *ONE[2:], "--video", name, "--video-rate", 10)
    decode = ["ffmpeg", "-loglevel", "error", "-i", f"file:{name}", "-f", "rawvideo", "-pix_fmt", "rgb24", "-"]
    frames = subprocess.run(decode, cwd=folder, capture_output=True, check=True, timeout=60).stdout
    even = (width + width % 2, height + height % 2)
    assert len(frames) == 21 * 3 * even[0] * even[1]
    assert abs(frames[0] - 225) < 8, "the background is no longer light grey"
    assert frames[: len(frames) // 21] != frames[-len(frames) // 21 :]


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("--model", BAR), ("--actions",)),
        (("--model", BAR, "--actions", "nowhere.csv"), ("actions nowhere.csv", "No such file")),
        (("--model", BAR, "--actions", "bad.csv"), ("bad.csv: line 3, column dz_m", "0.06", '"0.6"')),
        (("--model", CABLE, "--actions", "actions.csv"), ("measured_cable", "no task", "--track")),
        (("--model", CABLE, "--track", "bad.csv"), ("bad.csv", "line 1, column")),
        ((*ONE, "--theta", "length=0.2"), ("--theta length", "length_m, youngs_modulus_pa")),
        ((*ONE, "--theta", "length_m"), ("length_m", "NAME=VALUE")),
        ((*ONE, "--theta", "length_m=-1"), ("length_m", "0.01 to 10", "-1")),
        ((*ONE, "--effect", "length_m=0.2"), ("--effect length_m", "--theta")),
        ((*ONE, "--effect", "drag=0.2"), ("`drag`", "linear_drag_n_s_m2")),
        ((*EPISODE, "--fidelity", "finest"), ("fast, fine_mesh, standard, reference", "finest")),
        ((*ONE, "--video", "bar.avi"), ("bar.avi", ".gif or .mp4")),
        ((*ONE, "--video", "bar.gif", "--video-rate", 100), ("--video-rate", "0.1 to 50", "100")),
        ((*ONE, "--out", "actions.csv"), ("--out actions.csv", "does not exist yet")),
        ((*ONE, "--images"), ("--out",)),
    ],
)
def test_mistakes_are_named(refused, folder, arguments, says):
    (folder / "bad.csv").write_text("dx_m,dz_m\n0,0\n0,0.6\n")
    refused(*arguments, says=says)


def test_ctrl_c_leaves_no_file(program, folder):
    (folder / "actions.csv").write_text("dx_m,dz_m\n" + "0.01,0\n-0.01,0\n" * 500)
    files = ("--out", "bag", "--video", "bar.gif")
    process = program.start("simulate", *EPISODE, "--fidelity", "reference", *files, folder=folder)
    wait_for(lambda: len(list(folder.iterdir())) >= 3, 20, "the unfinished bag and video")
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=20)
    assert process.returncode == 130 and out == "" and "interrupted" in err
    assert [p.name for p in folder.iterdir()] == ["actions.csv"]
