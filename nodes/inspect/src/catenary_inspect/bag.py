"""Message log of a bag: a folder or a file of rosbag2, complete or damaged. Missing parts are noted."""

import pathlib
import tempfile

from rosbags.rosbag2.metadata import parse_qos
from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from . import database, mcap_file
from .definitions import Definitions, Undecodable
from .message_log import Channel, Endpoint, InspectError, MessageLog
from .packed import TooLarge, is_packed, unpack, unpack_file

# Distance in ns from the middle of a bag above which a log time is far, as for `catenary info`: ten years.
FAR_NS = 10 * 365 * 86_400 * 10**9
# Number of different times of a topic that a note lists.
LISTED = 3
EXPECTED = "expected a bag folder or an .mcap or .db3 file"


def read(path, names=None):
    """Reads the messages of the named topics; without names, the lengths in bytes of the messages of all topics."""
    path = pathlib.Path(path)
    if not path.exists():
        raise InspectError(f"--bag {path}: {EXPECTED}, found nothing there")
    log = MessageLog(f"bag {path}")
    files = files_of(path, log.notes) if path.is_dir() else [path]
    reading, foreign = Reading(log, names), []
    for file in files:
        try:
            reading.read(file)
        except (NoBag, OSError) as error:
            foreign.append(f"{file}: {error}")
    if len(foreign) == len(files):
        raise InspectError(f"--bag {path}: {EXPECTED}, found " + "; ".join([*foreign, *log.notes]))
    log.notes += [*foreign, *reading.notes()]
    if not log.channels and log.notes:
        raise InspectError(f"--bag {path}: expected messages, found none: {'; '.join(log.notes)}")
    if reading.unfinished or (path.is_dir() and not (path / "metadata.yaml").exists()):
        program = "catenary" if reading.is_plain_mcap else "ros2 bag"
        log.notes.append(f"`{program} reindex {path}` finishes it")
    log.notes += leave_far_out(log)
    for channel in log.channels.values():
        channel.messages.sort(key=lambda pair: pair[0])
    return log


def leave_far_out(log):
    """Takes out messages that are logged decades away from the rest: at 0, or at 2^64 - x after a clock that ran backwards.

    Rates and ages would be those of their distance. Returns a note for each topic that had some.
    """
    times = sorted(time_ns for channel in log.channels.values() for time_ns, _ in channel.messages)
    if not times or times[-1] - times[0] <= FAR_NS:
        return []
    # Times after the year 2262 are no times of a clock, however many there are.
    possible = [time_ns for time_ns in times if time_ns < 2**63] or times
    middle, notes = possible[len(possible) // 2], []
    for name, channel in sorted(log.channels.items()):
        far = sorted({time_ns for time_ns, _ in channel.messages if abs(time_ns - middle) > FAR_NS})
        near = [pair for pair in channel.messages if abs(pair[0] - middle) <= FAR_NS]
        if far:
            count, channel.messages = len(channel.messages) - len(near), near
            listed = ", ".join(f"{time_ns} ns" for time_ns in far[:LISTED]) + (" and others" if len(far) > LISTED else "")
            of = "message is" if count == 1 else "messages are"
            notes.append(f"{name}: {count} {of} logged more than ten years away from the rest, at {listed}: left out")
    return notes


class NoBag(Exception):
    """The file is no part of a bag; says why."""


class Reading:
    """Fills `log` from the files of a bag. `failed`: by topic the number of undecodable messages and the first error."""

    def __init__(self, log, names):
        self.log, self.names = log, names
        self.definitions, self.failed = Definitions(), {}
        self.unfinished, self.is_plain_mcap = False, True

    def read(self, path):
        """Takes the readable messages of one file."""
        with open(path, "rb") as file:
            start = file.read(16)
        if is_packed(start):
            self.is_plain_mcap = False
            with tempfile.TemporaryDirectory() as folder:
                unpacked = pathlib.Path(folder, path.stem)
                try:
                    self.log.notes += unpack_file(path, unpacked)
                except TooLarge as error:
                    raise NoBag(f"a file of another kind: {error}") from error
                self.read_unpacked(path, unpacked)
        else:
            self.read_unpacked(path, path)

    def read_unpacked(self, path, source):
        """Takes the readable messages of the uncompressed file `source`, which notes call `path`."""
        with open(source, "rb") as file:
            start = file.read(16)
        if start.startswith(mcap_file.MAGIC):
            self.unfinished |= mcap_file.read(path, source, self, self.log.notes)
        elif start.startswith(database.MAGIC):
            self.is_plain_mcap = False
            database.read(path, source, self, self.log.notes)
        else:
            raise NoBag("another file, which begins neither as MCAP nor as sqlite3" if start else "an empty file")

    def define(self, topic, type_name, profiles):
        """Adds a topic and the QoS profiles of its publishers, a text in the form of rosbag2."""
        channel = self.log.channels.setdefault(topic, Channel(type_name))
        for profile in parsed(profiles):
            endpoint = Endpoint("", profile.reliability.name.lower(), profile.durability.name.lower())
            if endpoint not in channel.publishers:
                channel.publishers.append(endpoint)

    def take(self, topic, definition, time_ns, data):
        """Adds one message, decoded by its definition."""
        channel = self.log.channels[topic]
        channel.count += 1
        if self.names is not None and topic not in self.names:
            return
        try:
            if is_packed(data):
                # Only rosbag2 can index the folder of such a bag.
                self.is_plain_mcap, data = False, unpack(data)
            message = len(data) if self.names is None else self.definitions.decode(definition, data)
        except Undecodable as error:
            self.failed.setdefault(topic, [0, error])[0] += 1
        else:
            channel.messages.append((time_ns, message))

    def notes(self):
        """Notes on undecodable messages, one for each topic."""
        for topic, (count, error) in self.failed.items():
            channel = self.log.channels[topic]
            yield f"{topic}: {count} of {channel.count} messages of {channel.type_name} cannot be made: {error}"


def parsed(profiles):
    """QoS profiles of a text of rosbag2; none if the text cannot be parsed."""
    try:
        return parse_qos(profiles)
    except Exception:  # rosbags raises KeyError, TypeError and others on unexpected texts.
        return []


def files_of(folder, notes):
    """Files of a bag folder in the order of metadata.yaml, or all files by number if it is missing. Differences are noted."""
    present = {path.name: path for path in sorted(folder.iterdir(), key=order)}
    bag_files = [name for name in present if name.removesuffix(".zstd").endswith((".mcap", ".db3"))]
    try:
        listed = listed_in(folder / "metadata.yaml")
    except (OSError, YAMLError, KeyError, TypeError, ValueError, AttributeError) as error:
        is_missing = isinstance(error, FileNotFoundError)
        why = "is missing, as a recorder leaves it that was killed or still runs" if is_missing else f"cannot be read: {oneline(error)}"
        notes.append(f"{folder}: metadata.yaml {why}")
        listed = bag_files
    found = [name for name in listed if name in present]
    notes += [f"{folder / name}: listed in metadata.yaml, and missing" for name in listed if name not in present]
    notes += [f"{folder / name}: not listed in metadata.yaml" for name in bag_files if name not in found]
    found = found or bag_files
    if not found:
        others = ", ".join([*present][:5]) or "an empty folder"
        raise InspectError(f"--bag {folder}: {EXPECTED}, found no such file in the folder: {others}")
    return [present[name] for name in found]


def order(path):
    """Sort key of a file: its number in a split bag, then its name."""
    number = path.name.split(".")[0].rpartition("_")[2]
    return (int(number) if number.isdecimal() else float("inf"), path.name)


def listed_in(metadata):
    """Names of the files that a metadata.yaml lists."""
    paths = YAML(typ="safe").load(metadata.read_text())["rosbag2_bagfile_information"]["relative_file_paths"]
    return [pathlib.PurePath(path).name for path in paths]


def oneline(error):
    return " ".join(str(error).split())
