"""Message log of the running graph, by rclpy."""

import contextlib
import importlib
import time

from .message_log import Channel, Endpoint, InspectError, MessageLog

# Time within which publishers of the needed topics have to be discovered.
PATIENCE_S = 5.0
# Time after which discovery is taken as complete.
SETTLE_S = 1.5


def import_rclpy():
    try:
        import rclpy
    except ImportError as error:
        raise InspectError(f"live topics need rclpy, which was not found ({error}): source a ROS 2 environment, or give --bag") from error
    return rclpy


def message_class(topic, type_name):
    """Python class of a message type."""
    package, kind, name = type_name.split("/")
    try:
        return getattr(importlib.import_module(f"{package}.{kind}"), name)
    except (ImportError, AttributeError) as error:
        raise InspectError(f"{topic}: expected a Python module of {type_name}, found none ({error}): build and source {package}") from error


@contextlib.contextmanager
def node():
    """Node of rclpy, and a function that spins it for some seconds."""
    rclpy = import_rclpy()
    from rclpy.executors import SingleThreadedExecutor

    context = rclpy.Context()
    context.init()
    mine = rclpy.create_node("catenary_inspect", context=context, enable_rosout=False)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(mine)
    try:
        yield mine, lambda seconds: executor.spin_once(timeout_sec=seconds)
    finally:
        executor.shutdown()
        mine.destroy_node()
        context.try_shutdown()


class Unseen(Exception):
    """This node has discovered no publisher of a needed topic; names the topics."""


def listen(names, needed, seconds, done=lambda log: False):
    """Listens to topics for `seconds`, or until `done(log)`; returns the log.

    `needed`: topics that need a publisher within PATIENCE_S. `names`: topics to listen to; None for the lengths in bytes of the
    messages of all topics.
    """
    attempts_left = 2
    while True:
        attempts_left -= 1
        with node() as (mine, spin):
            log = MessageLog("live graph")
            try:
                listen_with(mine, spin, log, names, needed, seconds, done)
                return log
            except Unseen as missing:
                others = sorted(name for name, channel in log.channels.items() if channel.publishers)
                # A participant of Fast DDS may never hear of some endpoints on RustDDS; the next participant mostly does.
                if others and attempts_left:
                    continue
                found = f"publishers of {', '.join(others)}" if others else "no publisher: is ROS_DOMAIN_ID right?"
                raise InspectError(f"live graph: expected a publisher of {missing} within {PATIENCE_S:g} s, found {found}") from None


def listen_with(mine, spin, log, names, needed, seconds, done):
    """Fills the log with the messages that this node hears."""
    subscribed, began, end = set(), time.monotonic(), None
    while end is None or time.monotonic() < end:
        add_endpoints(mine, log, subscribed, names)
        missing = [name for name in needed if name not in subscribed]
        elapsed = time.monotonic() - began
        if end is None and not missing and elapsed > SETTLE_S:
            end = time.monotonic() + seconds
        if missing and elapsed > PATIENCE_S:
            raise Unseen(", ".join(missing))
        for _ in range(50):
            spin(0.01)
        if done(log):
            break
    spaces = mine.get_node_names_and_namespaces()
    log.nodes = sorted(f"{space.rstrip('/')}/{name}" for name, space in spaces if name != mine.get_name())
    add_endpoints(mine, log, subscribed, names)


def add_endpoints(mine, log, subscribed, names):
    """Updates the log's publishers and subscriptions, and subscribes to topics that are new."""
    for name, types in mine.get_topic_names_and_types():
        if "/_" in name or name == "/parameter_events":
            continue
        publishers = endpoints(mine.get_publishers_info_by_topic(name))
        channel = log.channels.setdefault(name, Channel(", ".join(sorted(types))))
        channel.type_name = ", ".join(sorted(types))
        channel.publishers = publishers
        channel.subscriptions = endpoints(mine.get_subscriptions_info_by_topic(name))
        if publishers and name not in subscribed and (names is None or name in names):
            try:
                subscribe(mine, name, channel, raw=names is None)
            except InspectError as error:
                # In a report of all topics, a topic that cannot be heard is one of its lines.
                if names is not None:
                    raise
                channel.unheard = str(error)
            subscribed.add(name)


def endpoints(found):
    """Endpoints of other nodes; the name is empty for endpoints of the middleware itself."""

    def endpoint(info):
        unnamed = "UNKNOWN" in info.node_name
        node = "" if unnamed else f"{info.node_namespace.rstrip('/')}/{info.node_name}"
        return Endpoint(node, info.qos_profile.reliability.name.lower(), info.qos_profile.durability.name.lower())

    return [endpoint(info) for info in found if info.node_name != "catenary_inspect"]


def subscribe(mine, name, channel, raw):
    """Subscribes with the strongest profile that all publishers offer."""
    from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

    reliable = all(p.reliability == "reliable" for p in channel.publishers)
    latched = all(p.durability == "transient_local" for p in channel.publishers)
    profile = QoSProfile(
        depth=1000,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )
    if "," in channel.type_name:
        raise InspectError(f"live graph: {name}: expected one type, found {channel.type_name}")

    def came(message):
        channel.messages.append((time.time_ns(), len(message) if raw else message))

    channel.since_ns = time.time_ns()
    mine.create_subscription(message_class(name, channel.type_name), name, came, profile, raw=raw)
