"""Parameters that a node of rclpy reads from ROS 2 arguments."""

import math

import pytest


def written(value):
    """Value as the JSON tables of tests write it, with infinities and NaN as words."""
    if isinstance(value, float) and not math.isfinite(value):
        return repr(value)
    return value if value is None or isinstance(value, (bool, int, float, str)) else [written(item) for item in value]


def of_rclpy(arguments):
    """Type and value of each parameter for the node /cam, by name; None if rclpy refuses the arguments."""
    # A submodule, because the folder tests/rclpy passes for an empty package `rclpy`.
    pytest.importorskip("rclpy.node")
    import rclpy

    context = rclpy.Context()
    try:
        context.init(args=["x", "--ros-args", *arguments], domain_id=99)
    except Exception:
        return None
    try:
        node = rclpy.create_node("cam", context=context, enable_rosout=False, start_parameter_services=False)
        values = {name: [value.type_.name, written(value.value)] for name, value in node._parameter_overrides.items()}
        node.destroy_node()
        return values
    finally:
        context.try_shutdown()
