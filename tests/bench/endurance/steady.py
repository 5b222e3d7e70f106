"""Memory, messages and rates of the graph while episodes follow one another and a recorder listens."""

import concurrent.futures
import multiprocessing
import shutil
import time

from bag_stamps import stamps_in
from figures import gaps, memory
from graph import Driver, Heard
from processes import Sampler
from support.stamps import stamp_of_bytes_ns

IMAGE, INFO = "/camera/camera/color/image_raw", "/camera/camera/color/camera_info"
STREAMS = {"image": INFO, "mask": "/dlo/mask", "keypoints": "/dlo/keypoints"}
RELIABLE = (
    "/policy/action", "/policy/observation", "/panda/target_pose", "/panda/accepted_target", "/episode/event", "/panda/arm_state",
)  # fmt: skip
RATE_HZ = 60
# Lowest rate that is accepted: one frame in a hundred may be missing.
LEAST_HZ = 0.99 * RATE_HZ
# Largest slope of a process's memory that is accepted: 60 MB in a working day of ten hours.
FLAT_KB_PER_MIN = 100
# Latched states fill the queues of their readers in 82 s (4096 at 50 Hz), and allocators settle in some minutes.
WARM_UP_S = 300
# Measured size of a recording with images.
IMAGES_GB_PER_MIN = 3.4
FILE_BYTES = 1 << 30
FILE_S = 60
# Number of failed episodes after which the run ends.
MOST_FAILURES = 10


class Recording:
    """A recorder whose finished files are read while it runs; files with images are removed after that."""

    def __init__(self, session, images):
        self.session, self.images, self.found, self.bytes, self.reading = session, images, {}, 0, []
        self.bag = session.folder / "bag"
        options = ("--images", "--compression", "none") if images else ()
        # Files are limited because the recorder has the index of a file's chunks in memory until the file ends.
        limits = ("-b", FILE_BYTES, "-d", FILE_S)
        self.process = session.start("record", "--out", self.bag, *limits, *options, name="recorder")
        session.wait_for(self.bag.exists, 20, "the recorder's bag")
        self.pool = concurrent.futures.ProcessPoolExecutor(1, multiprocessing.get_context("spawn"))

    def read_finished(self, all_of_them=False):
        """Starts to read the files that will not grow any more."""
        read = len(self.reading)
        # The number of files comes from the newest name, because files that were read may be removed.
        files = 1 + max(int(path.stem.rpartition("_")[2]) for path in self.bag.glob("*.mcap"))
        for number in range(read, files if all_of_them else files - 1):
            path = self.bag / f"bag_{number}.mcap"
            self.bytes += path.stat().st_size
            self.reading.append(self.pool.submit(take, path, self.images))

    def end(self):
        self.session.stop(self.process)
        self.read_finished(all_of_them=True)
        for part in concurrent.futures.as_completed(self.reading):
            for topic, stamps in part.result().items():
                self.found.setdefault(topic, []).extend(stamps)
        self.pool.shutdown()
        return self.found


def take(path, remove):
    """Reads the stamps of a file, and removes the file on request."""
    found = stamps_in(path)
    if remove:
        path.unlink()
    return found


def run(session, minutes, images, say):
    """Runs episodes for `minutes`; returns the figures."""
    if images:
        free_gb = shutil.disk_usage(session.folder).free / 1e9
        assert free_gb > 5, f"two files of the bag need 5 GB, the disk has {free_gb:.1f}"
    session.launch()
    ros = session.ros
    heard = {name: Heard(ros, name, keep=name in RELIABLE) for name in (*STREAMS.values(), *RELIABLE)}
    ros.wait_for(lambda: all(heard[name].messages for name in (*STREAMS.values(), "/panda/arm_state")), 30, "every stream")
    recording = Recording(session, images)
    driver = Driver(ros)
    driver.episode(0, steps=2)
    pids = {name: session.pid_of(name) for name in sorted(session.nodes)}
    pids |= {"launch": session.children[0].pid, "recorder": recording.process.pid}
    sampler = Sampler(pids)
    sampler.start()
    begun, began_s, results, failures = time.time_ns(), time.monotonic(), [], []
    while time.monotonic() - began_s < 60 * minutes:
        recording.read_finished()
        try:
            results.append(driver.episode(len(results) + 1))
            say(f"{(time.monotonic() - began_s) / 60:.1f} min: episode {results[-1].episode}, {results[-1].end}")
        except AssertionError as error:
            failures.append(str(error))
            say(f"{(time.monotonic() - began_s) / 60:.1f} min: {error}")
            # A missing node makes every episode fail.
            if len(failures) > MOST_FAILURES:
                raise
    ended = time.time_ns()
    ros.spin(1)
    sampler.stop()
    assert {name: session.pid_of(name) for name in sorted(session.nodes)}.items() <= pids.items(), "a node was started anew"
    bag = recording.end()
    return {
        "seconds": 1e-9 * (ended - begun),
        "episodes": len(results),
        "failures": failures,
        "load": sum(sampler.load) / len(sampler.load),
        "bag_mb": recording.bytes / 1e6,
        "processes": sampler.samples,
        "messages": messages(heard, bag, results, begun, ended),
        "streams": streams(heard, bag, images, begun, ended),
    }


def memory_of(figures):
    """Memory and share of a processor of each process, after the warm-up."""
    found, warm_up_s = {}, min(WARM_UP_S, figures["seconds"] / 2)
    for name, samples in figures["processes"].items():
        times, rss, cpu = zip(*samples)
        found[name] = memory(times, rss, warm_up_s) | {"cpu": (cpu[-1] - cpu[0]) / (times[-1] - times[0])}
    return found


def messages(heard, bag, results, begun, ended):
    """Counts of messages by reliable topic: told by whole episodes, sent (sequence numbers of DDS), heard by rclpy, in the bag."""
    steps = sum(len(result.rewards) for result in results)
    told = dict.fromkeys(RELIABLE, steps) | {"/policy/observation": steps + len(results), "/episode/event": 2 * len(results)}
    found = {}
    for name in RELIABLE:
        came = [message for message in heard[name].messages if begun <= message[1] <= ended]
        numbers = [message[0] for message in came]
        stamps = {stamp_of_bytes_ns(message[3]) for message in came}
        first, last = min(stamps), max(stamps)
        recorded = {stamp for stamp, _ in bag.get(name, []) if first <= stamp <= last}
        # No message tells how many states an arm publishes.
        found[name] = {"told": None if name == "/panda/arm_state" else told[name], "sent": max(numbers) - min(numbers) + 1}
        found[name] |= {"rclpy": len(set(numbers)), "bag": len(recorded), "differ": len(stamps ^ recorded)}
    return found


def streams(heard, bag, images, begun, ended):
    """Rates and gaps of the streams as sent, and shares lost at each stage, on the way to rclpy and into the bag."""
    found, before = {}, None
    for name, topic in STREAMS.items():
        came = [message for message in heard[topic].messages if begun <= message[1] <= ended]
        numbers, sent_ns = [message[0] for message in came], [message[1] for message in came]
        sent, seconds = max(numbers) - min(numbers) + 1, 1e-9 * (sent_ns[-1] - sent_ns[0])
        p99, longest = gaps(sent_ns, numbers)
        first, last = stamp_of_bytes_ns(came[0][3]), stamp_of_bytes_ns(came[-1][3])
        in_bag = len({stamp for stamp, _ in bag.get(IMAGE if name == "image" and images else topic, []) if first <= stamp <= last})
        row = {"hz": (sent - 1) / seconds, "p99_ms": p99, "max_ms": longest}
        row["dropped"] = 1 - row["hz"] / (RATE_HZ if before is None else before)
        found[name] = row | {"lost_rclpy": 1 - len(numbers) / sent, "lost_bag": 1 - in_bag / sent}
        before = row["hz"]
    return found


def no_loss(row, failed=0):
    """Tells whether rclpy and the bag have all messages that were sent and, if no episode failed, that the episodes told of."""
    return row["sent"] == row["rclpy"] == row["bag"] and row["differ"] == 0 and (failed or row["told"] in (None, row["sent"]))


def verdicts(figures):
    """Pairs of a requirement in words and True if it holds."""
    for name, row in figures["memory"].items():
        yield f"memory of {name} is flat: at most {row['high']:.0f} kB/min", row["high"] <= FLAT_KB_PER_MIN
    whole, failed = figures["episodes"], len(figures["failures"])
    yield f"{whole} of {whole + failed} episodes ran to their end", not failed
    for name, row in figures["messages"].items():
        yield f"every message of {name} came to rclpy and into the bag", no_loss(row, failed)
    for name, row in figures["streams"].items():
        yield f"{name} is sent at {RATE_HZ} Hz: {row['hz']:.2f}", row["hz"] >= LEAST_HZ
