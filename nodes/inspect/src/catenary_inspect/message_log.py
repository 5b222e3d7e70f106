"""Messages by topic with the times at which they came, wherever they are from."""

from dataclasses import dataclass, field


class InspectError(Exception):
    """Something that the user has to mend: says where, what was found and what is needed."""


@dataclass
class Endpoint:
    """A publisher or subscription: its node and profile."""

    node: str
    reliability: str
    durability: str


@dataclass
class Channel:
    """One topic. `messages` are pairs of the time of arrival in ns and the message, or its length in bytes where no topic was asked
    for; `count` is known of topics that were not asked for, too. `since_ns`: when listening began, live; what is latched is older.
    `unheard`: why nothing was listened to."""

    type_name: str
    publishers: list = field(default_factory=list)
    subscriptions: list = field(default_factory=list)
    messages: list = field(default_factory=list)
    count: int = 0
    since_ns: int = 0
    unheard: str = ""


@dataclass
class MessageLog:
    """`origin` names the bag or the graph in messages to the user. `notes`: what is missing or damaged, in sentences."""

    origin: str
    channels: dict = field(default_factory=dict)
    nodes: list = field(default_factory=list)
    notes: list = field(default_factory=list)

    def describe(self):
        """What there is, in words."""
        counts = {name: max(channel.count, len(channel.messages)) for name, channel in sorted(self.channels.items())}
        return ", ".join(f"{name} ({count})" for name, count in counts.items() if count) or "no message"

    def need(self, topic, type_name, purpose):
        """The messages of a topic that `purpose` cannot do without."""
        channel = self.channels.get(topic)
        if channel is None or not channel.messages:
            raise InspectError(f"{self.origin}: expected messages on {topic} ({type_name}) for {purpose}, found {self.describe()}")
        if channel.type_name != type_name:
            raise InspectError(f"{self.origin}: {topic}: expected {type_name} for {purpose}, found {channel.type_name}")
        return channel.messages

    def get(self, topic):
        """The messages of a topic, none where it is not there."""
        channel = self.channels.get(topic)
        return channel.messages if channel else []


def stamp_ns(stamp):
    """A builtin_interfaces/Time in ns."""
    return stamp.sec * 10**9 + stamp.nanosec
