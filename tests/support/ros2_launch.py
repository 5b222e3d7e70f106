"""Processes that ROS 2's own launch would start for a launch file. Needs launch, launch_xml and launch_ros."""

import asyncio
import os

import launch
import yaml
from launch.actions import ExecuteLocal, IncludeLaunchDescription
from launch.launch_description_sources import AnyLaunchDescriptionSource
from launch_ros.actions import Node


def processes(path, arguments, read=yaml.safe_load):
    """Processes in order, each as `catenary launch --show --json` prints it, with parameter files read by `read`."""
    before = dict(os.environ)
    context = launch.LaunchContext(argv=[])
    context._set_asyncio_loop(asyncio.new_event_loop())
    found = []
    try:
        source = AnyLaunchDescriptionSource(str(path))
        visit(IncludeLaunchDescription(source, launch_arguments=list(arguments.items())), context, before, found, read)
    finally:
        os.environ.clear()
        os.environ.update(before)
    return found


def visit(entity, context, before, found, read):
    """Appends the processes of an entity and of all inside it to `found`."""
    if not isinstance(entity, ExecuteLocal):
        for inner in entity.visit(context) or []:
            visit(inner, context, before, found, read)
    elif entity.condition is None or entity.condition.evaluate(context):
        found.append(process(entity, context, before, read))


def process(entity, context, before, read):
    """Process of an entity, prepared as `entity.execute` does. Launch keeps the values in private attributes."""
    private = lambda kind, name: getattr(entity, f"_{kind}__{name}")
    if isinstance(entity, Node):
        entity._perform_substitutions(context)
        names = {"ns": f"__ns:={entity.expanded_node_namespace}"}
        if private("Node", "node_name") is not None:
            names["name"] = f"__node:={private('Node', 'expanded_node_name')}"
        context.extend_locals({"ros_specific_arguments": names})
    entity.prepare(context)
    description = entity.process_description
    command = list(description.final_cmd)
    for i, word in enumerate(command):
        if "launch_params_" in word:
            with open(word) as file:
                command[i] = read(file)
            os.unlink(word)
    after = description.final_env
    changes = {name: value for name, value in after.items() if before.get(name) != value}
    changes |= {name: None for name in before if name not in after}
    retries = private("ExecuteLocal", "respawn_max_retries")
    timeouts = (entity.sigterm_timeout, entity.sigkill_timeout)
    grace = [float("".join(context.perform_substitution(part) for part in parts)) for parts in timeouts]
    return {
        "name": description.final_name.rsplit("-", 1)[0],
        "command": command,
        "environment": changes,
        "directory": description.final_cwd,
        "respawn": private("ExecuteLocal", "respawn"),
        "respawn_delay_s": private("ExecuteLocal", "respawn_delay") or 0.0,
        "respawn_max_retries": None if retries < 0 else retries,
        "sigterm_timeout_s": grace[0],
        "sigkill_timeout_s": grace[1],
    }
