"""Stamps and logging times of the messages in a file of a bag."""

from mcap.exceptions import McapError
from mcap.records import Channel, Message
from mcap.stream_reader import StreamReader

from support.stamps import stamp_of_bytes_ns


def messages_of(path):
    """Topic and record of each message; an unfinished file gives the messages that it has."""
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
    """Stamp and logging time (ns) of every message, by topic."""
    found = {}
    for topic, message in messages_of(path):
        found.setdefault(topic, []).append((stamp_of_bytes_ns(message.data), message.log_time))
    return found
