"""Messages by topic with their times of arrival, from a bag or from the running graph."""

from dataclasses import dataclass, field


class InspectError(Exception):
    """A mistake that the user can correct; says where, what was expected and what was found."""


@dataclass
class Endpoint:
    """A publisher or subscription: its node and profile."""

    node: str
    reliability: str
    durability: str


@dataclass
class Channel:
    """One topic.

    `messages`: pairs of the time of arrival (ns) and the message, or its length in bytes in a report of all topics.
    `count`: number of messages, also of topics whose messages were not read. `unheard`: reason why the topic could not be heard.
    `since_ns`: begin of listening to live topics; latched messages are older.
    """

    type_name: str
    publishers: list = field(default_factory=list)
    subscriptions: list = field(default_factory=list)
    messages: list = field(default_factory=list)
    count: int = 0
    since_ns: int = 0
    unheard: str = ""


@dataclass
class MessageLog:
    """Messages of a bag or graph (`origin`, in the user's words). `notes`: sentences on missing and damaged parts."""

    origin: str
    channels: dict = field(default_factory=dict)
    nodes: list = field(default_factory=list)
    notes: list = field(default_factory=list)

    def describe(self):
        """Topics with their numbers of messages, in words."""
        counts = {name: max(channel.count, len(channel.messages)) for name, channel in sorted(self.channels.items())}
        return ", ".join(f"{name} ({count})" for name, count in counts.items() if count) or "no message"

    def need(self, topic, type_name, purpose):
        """Messages of a topic that `purpose` needs; raises InspectError if there are none."""
        channel = self.channels.get(topic)
        if channel is None or not channel.messages:
            raise InspectError(f"{self.origin}: expected messages on {topic} ({type_name}) for {purpose}, found {self.describe()}")
        if channel.type_name != type_name:
            raise InspectError(f"{self.origin}: {topic}: expected {type_name} for {purpose}, found {channel.type_name}")
        return channel.messages

    def get(self, topic):
        """Messages of a topic; an empty list for a missing topic."""
        channel = self.channels.get(topic)
        return channel.messages if channel else []


def stamp_ns(stamp):
    """A builtin_interfaces/Time in ns."""
    return stamp.sec * 10**9 + stamp.nanosec
