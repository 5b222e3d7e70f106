"""What a bag's file holds: by topic the stamps of its messages and the times of logging, ns."""

import numpy
from mcap.exceptions import McapError
from mcap.records import Channel, Message
from mcap.stream_reader import StreamReader


def messages_of(path):
    """Topic and message of each; a file that was cut off gives what it has."""
    channels = {}
    with open(path, "rb") as file:
        try:
            for record in StreamReader(file).records:
                if isinstance(record, Channel):
                    channels[record.id] = record.topic
                elif isinstance(record, Message):
                    yield channels[record.channel_id], record
        except McapError:
            return


def stamps_in(path):
    found = {}
    for topic, message in messages_of(path):
        sec, nanosec = numpy.frombuffer(message.data[4:12], numpy.uint32)
        found.setdefault(topic, []).append((int(sec) * 10**9 + int(nanosec), message.log_time))
    return found
