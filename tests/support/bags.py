"""Bags that rosbags writes: the sample bag anew, as it is or changed, in any format."""

from rosbags.rosbag2 import CompressionFormat, CompressionMode, Reader, StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from .program import BAG


def writer_of(out, plugin, mode, version):
    """Writer of a bag that does not exist yet; the compression is zstd."""
    writer = Writer(out, version=version, storage_plugin=plugin)
    if mode not in (None, CompressionMode.NONE):
        writer.set_compression(mode, CompressionFormat.ZSTD)
    return writer


def copied(out, source=BAG, plugin=StoragePlugin.MCAP, mode=None, time_of=lambda connection, number, time_ns: time_ns):
    """Copies a bag's messages byte by byte; `time_of(connection, number, time_ns)` gives the time at which each is logged."""
    with Reader(source) as reader, writer_of(out, plugin, mode, 9) as writer:
        topics = {}
        for c in reader.connections:
            known = {"msgdef": c.msgdef.data, "rihs01": c.digest, "offered_qos_profiles": c.ext.offered_qos_profiles}
            topics[c.id] = writer.add_connection(c.topic, c.msgtype, **known)
        for number, (connection, time_ns, data) in enumerate(reader.messages()):
            writer.write(topics[connection.id], time_of(connection, number, time_ns), data)
    return out


def store_for(reader, distribution):
    """Types of a ROS 2 distribution, and the types of a bag that it lacks."""
    store = get_typestore(distribution)
    for connection in reader.connections:
        types = get_types_from_msg(connection.msgdef.data, connection.msgtype)
        store.register({name: kind for name, kind in types.items() if name not in store.types})
    return store


def rewritten(out, change=None, source=BAG, plugin=StoragePlugin.MCAP, mode=None, version=9, distribution=Stores.ROS2_JAZZY):
    """Decodes a bag and writes it with the types of a distribution.

    `change(topic, number, message)` may change each message; the number counts the messages of its topic.
    """
    with Reader(source) as reader, writer_of(out, plugin, mode, version) as writer:
        store, topics, counts = store_for(reader, distribution), {}, {}
        for c in reader.connections:
            profiles = c.ext.offered_qos_profiles
            topics[c.id] = writer.add_connection(c.topic, c.msgtype, typestore=store, offered_qos_profiles=profiles)
        for connection, time_ns, data in reader.messages():
            message = store.deserialize_cdr(data, connection.msgtype)
            number = counts[connection.topic] = counts.get(connection.topic, -1) + 1
            if change:
                change(connection.topic, number, message)
            writer.write(topics[connection.id], time_ns, store.serialize_cdr(message, connection.msgtype))
    return out
