"""Loss and latency of colour images and poses between rclpy and our nodes, as figures.

    source .venv/ros.env; .venv/bin/python tests/bench/images/images.py [--seconds 10] [--json] [--default-profile]

From our nodes: images of the simulated cell, where a camera_info without its image counts as a loss, and poses of the replayer. The
latency is the time from the sending, by the timestamp of DDS, to the taking in Python. To our nodes: images and poses of rclpy that
the recorder logs, with the latency from the stamp to the logging. Takes about a minute. Run it on an idle machine.
"""

import argparse
import array
import json
import os
import pathlib
import sys
import tempfile
import threading
import time

import numpy
from mcap.reader import make_reader
from rclpy.serialization import serialize_message

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))
from support.contract import BY_NAME
from support.program import MODEL
from support.ros import Ros
from support.session import session_in
from support.stamps import CDR_HEADER, stamp_of_bytes_ns

IMAGE, INFO, POSE = "/camera/camera/color/image_raw", "/camera/camera/color/camera_info", "/panda/current_pose"
WIDTH, HEIGHT = 640, 480


def figures(sent, latencies_s):
    """Counts, loss and percentiles of the latency (ms)."""
    p50, p99 = (1e3 * numpy.percentile(latencies_s, [50, 99])).tolist() if latencies_s else (None, None)
    return {"sent": sent, "received": len(latencies_s), "loss": 1 - len(latencies_s) / sent, "p50_ms": p50, "p99_ms": p99}


def hear(ros, name, heard):
    """Subscribes to a topic; appends stamp, time of sending and time of taking (ns) of each message to `heard`.

    The messages stay undecoded, because decoding an image in Python takes longer than sending it.
    """

    def came(data, info):
        heard.append((stamp_of_bytes_ns(data), info["source_timestamp"], time.time_ns()))

    row = BY_NAME[name]
    ros.node.create_subscription(row.kind, name, came, row.profile_of_depth(1000), raw=True)


def camera_of_node(session, seconds):
    """Figures of a simulated cell's images."""
    cell = session.node("simulated_cell", "-p", f"model_file:={MODEL}", "-p", "fidelity:=fast")
    ros = session.meet("simulated_cell")
    images, infos = [], []
    hear(ros, IMAGE, images)
    hear(ros, INFO, infos)
    ros.wait_for(lambda: len(images) > 5, 20, "images")
    ros.spin(0.5)
    images.clear()
    infos.clear()
    ros.spin(seconds)
    session.stop(cell)
    ros.close()
    # Without the last camera_info, whose image may still be on its way.
    wanted = {stamp for stamp, _, _ in infos[:-1]}
    return figures(len(wanted), [1e-9 * (taken - sent) for stamp, sent, taken in images if stamp in wanted])


def poses_of_node(session, bag):
    """Figures of a bag's poses that the replayer plays."""
    ros = Ros(session.domain)
    heard = []
    hear(ros, POSE, heard)
    time.sleep(1)
    options = (f"bag:={bag}", "allow_others:=true", "wait_s:=10.0")
    replayer = session.node("replayer", *(part for option in options for part in ("-p", option)))
    ros.wait_for(lambda: replayer.poll() is not None, 120, "the end of the replay")
    ros.close()
    with open(bag / f"{bag.name}_0.mcap", "rb") as file:
        sent = make_reader(file).get_summary().statistics.message_count
    return figures(sent, [1e-9 * (taken - at) for _, at, taken in heard])


def recorded(session, name, rate_hz, seconds):
    """Figures and bag of messages that rclpy sends to a recorder."""
    row, bag = BY_NAME[name], session.folder / f"bag_{rate_hz}"
    options = (f"output:={bag}", f"topics:=[{name}]", "compression:=none")
    recorder = session.node("recorder", *(part for option in options for part in ("-p", option)), log=f"recorder_{rate_hz}")
    session.wait_for(bag.exists, 20, "the recorder's bag")
    ros = session.meet("recorder")
    publisher = ros.node.create_publisher(row.kind, name, row.profile)
    ros.wait_for(publisher.get_subscription_count, 20, "the recorder")
    ros.spin(0.5)
    message = row.kind()
    if name == IMAGE:
        message.width, message.height, message.encoding, message.step = WIDTH, HEIGHT, "rgb8", 3 * WIDTH
        message.data = array.array("B", bytes(3 * WIDTH * HEIGHT))
    sent = publish(publisher, message, rate_hz, seconds)
    time.sleep(0.5)
    session.stop(recorder)
    ros.close()
    latencies = []
    with open(bag / f"{bag.name}_0.mcap", "rb") as file:
        for _, _, logged in make_reader(file).iter_messages():
            latencies.append(1e-9 * (logged.log_time - stamp_of_bytes_ns(logged.data)))
    return figures(sent, latencies), bag


def publish(publisher, message, rate_hz, seconds):
    """Publishes a message with new stamps at a steady rate from a thread of its own; returns the number of messages."""
    data, count = bytearray(serialize_message(message)), round(rate_hz * seconds)

    def run():
        began = time.monotonic()
        for number in range(count):
            time.sleep(max(0, began + number / rate_hz - time.monotonic()))
            data[CDR_HEADER : CDR_HEADER + 8] = numpy.array(divmod(time.time_ns(), 10**9), numpy.uint32).tobytes()
            publisher.publish(bytes(data))

    thread = threading.Thread(target=run)
    thread.start()
    thread.join()
    return count


def measure(folder, seconds):
    """Rows of the table."""
    with session_in(folder) as session:
        rows = {"image 60 Hz, node to rclpy": camera_of_node(session, seconds)}
        rows["image 60 Hz, rclpy to node"], _ = recorded(session, IMAGE, 60, seconds)
        rows["pose 1 kHz, rclpy to node"], bag = recorded(session, POSE, 1000, seconds)
        rows["pose 1 kHz, node to rclpy"] = poses_of_node(session, bag)
        return rows


def table(rows):
    lines = [f"{'':<28} {'sent':>6} {'loss %':>7} {'p50 ms':>7} {'p99 ms':>7}"]
    for name, row in rows.items():
        p50, p99 = ("-" if row[key] is None else f"{row[key]:.2f}" for key in ("p50_ms", "p99_ms"))
        lines.append(f"{name:<28} {row['sent']:>6} {100 * row['loss']:>7.2f} {p50:>7} {p99:>7}")
    return "\n".join(lines)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=10, help="of each stream")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--default-profile", action="store_true", help="leave Fast DDS as it comes")
    arguments = parser.parse_args()
    if arguments.default_profile:
        os.environ.pop("FASTRTPS_DEFAULT_PROFILES_FILE")
    with tempfile.TemporaryDirectory() as folder:
        rows = measure(pathlib.Path(folder), arguments.seconds)
    print(json.dumps(rows, indent=2) if arguments.json else table(rows))


if __name__ == "__main__":
    main()
