"""A bag as a message log: a rosbag2 folder (MCAP or sqlite3), or one MCAP file, which need not have been ended in order."""

import pathlib
import struct

from mcap.exceptions import McapError
from mcap.reader import NonSeekingReader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader, AnyReaderError
from rosbags.typesys import Stores, get_typestore

from .message_log import Channel, Endpoint, InspectError, MessageLog


def read(path, names=None):
    """The messages of these topics. With None: of all of them, as lengths in bytes."""
    path = pathlib.Path(path)
    if not path.exists():
        raise InspectError(f"--bag {path}: expected a bag folder or an .mcap file, found nothing there")
    if path.is_dir():
        return read_folder(path, names)
    if path.suffix != ".mcap":
        raise InspectError(f"--bag {path}: expected a bag folder or an .mcap file, found another file")
    return read_mcap(path, names)


def read_folder(path, names):
    if not (path / "metadata.yaml").exists():
        files = sorted(file.name for file in path.iterdir())
        hint = "; give the .mcap file itself" if any(file.endswith(".mcap") for file in files) else ""
        found = ", ".join(files[:5]) or "an empty folder"
        raise InspectError(f"--bag {path}: expected a metadata.yaml in the folder, found {found}{hint}")
    log = MessageLog(f"bag {path}")
    try:
        # Bags of sqlite3 hold no definitions: those of ROS itself are known.
        with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
            for connection in reader.connections:
                channel = log.channels.setdefault(connection.topic, Channel(connection.msgtype))
                channel.count += connection.msgcount
                channel.publishers += [
                    Endpoint("", profile.reliability.name.lower(), profile.durability.name.lower())
                    for profile in connection.ext.offered_qos_profiles
                ]
            chosen = [c for c in reader.connections if names is None or c.topic in names]
            # An empty choice would be all.
            for connection, time_ns, data in reader.messages(chosen) if chosen else ():
                message = len(data) if names is None else decode(reader, connection, data, path)
                log.channels[connection.topic].messages.append((time_ns, message))
    except AnyReaderError as error:
        raise InspectError(f"--bag {path}: expected a bag that rosbags reads: {error}") from error
    return log


def decode(reader, connection, data, path):
    try:
        return reader.deserialize(data, connection.msgtype)
    except Exception as error:  # rosbags lets through what its parser met: KeyError, struct.error and others
        raise InspectError(f"--bag {path}: {connection.topic}: no message of {connection.msgtype} can be made: {error!r}") from error


def read_mcap(path, names):
    """What stands in the file up to its end or to where it breaks off."""
    log, broken = MessageLog(f"bag {path}"), None
    try:
        with open(path, "rb") as file:
            decoders = DecoderFactory()
            # In the order of the file: to sort them is to read to an end that may not be there.
            for schema, channel, message in NonSeekingReader(file).iter_messages(log_time_order=False):
                known = log.channels.setdefault(channel.topic, Channel(schema.name))
                known.count += 1
                if names is None:
                    known.messages.append((message.log_time, len(message.data)))
                elif channel.topic in names:
                    known.messages.append((message.log_time, decoders.decoder_for(channel.message_encoding, schema)(message.data)))
    except (McapError, EOFError, struct.error) as error:
        broken = error
    if broken and not log.channels:
        raise InspectError(f"--bag {path}: expected an MCAP file with messages, found none: {broken!r}") from broken
    for channel in log.channels.values():
        channel.messages.sort(key=lambda pair: pair[0])
    return log
