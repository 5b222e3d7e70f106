"""The layout of Foxglove and the configuration of RViz show topics and fields of the contract."""

import json
import re

import pytest
from rosidl_parser.definition import AbstractNestedType, Array, NamespacedType
from ruamel.yaml import YAML

from support.contract import BY_NAME, interface
from support.program import ROOT

LAUNCH_CONFIGS = ROOT / "launch_configs"
RVIZ_TYPES = {"Pose": "geometry_msgs/msg/PoseStamped", "Image": "sensor_msgs/msg/Image", "Wrench": "geometry_msgs/msg/WrenchStamped"}


def walk(value):
    """Every mapping in a document, nested ones included."""
    if isinstance(value, dict):
        yield value
    for inner in value.values() if isinstance(value, dict) else value if isinstance(value, list) else []:
        yield from walk(inner)


def foxglove():
    return json.loads((LAUNCH_CONFIGS / "foxglove.json").read_text())


def check_path(path):
    """Asserts that a message path such as /topic.field.inner[2] leads to a number or a string."""
    topic, *fields = path.split(".")
    cls = BY_NAME[topic].kind
    for field in fields:
        name, index = re.fullmatch(r"(\w+)(?:\[(\d+)\])?", field).groups()
        kind = dict(zip(cls.get_fields_and_field_types(), cls.SLOT_TYPES))[name]
        if index is not None:
            assert isinstance(kind, AbstractNestedType) and (not isinstance(kind, Array) or int(index) < kind.size), path
            kind = kind.value_type
        cls = interface("/".join(kind.namespaced_name())) if isinstance(kind, NamespacedType) else None
    assert cls is None, f"{path} leads to no value"


def test_foxglove_shows_fields_of_the_contract():
    paths = [path["value"] for mapping in walk(foxglove()) for path in mapping.get("paths", [])]
    assert len(paths) > 20
    for path in paths:
        check_path(path)
    keys = ("topicPath", "topicToRender", "imageTopic", "calibrationTopic")
    topics = {mapping[key] for mapping in walk(foxglove()) for key in keys if key in mapping}
    topics |= {name for mapping in walk(foxglove()) if isinstance(mapping.get("topics"), dict) for name in mapping["topics"]}
    assert topics <= set(BY_NAME) and {"/camera/camera/color/image_raw", "/dlo/mask", "/bayes_sim/posterior"} <= topics


def test_foxgloves_layout_places_every_panel_once():
    document = foxglove()
    tabs = [tab for config in document["configById"].values() for tab in config.get("tabs", [])]
    placed = re.findall(r'"(\w+![a-z]+)"', json.dumps([document["layout"], tabs]))
    assert sorted(placed) == sorted(document["configById"])


def test_rviz_asks_for_offered_profiles():
    document = YAML(typ="safe").load((LAUNCH_CONFIGS / "catenary.rviz").read_text())
    assert document["Visualization Manager"]["Global Options"]["Fixed Frame"] == "panda_link0"
    displays = [d for d in document["Visualization Manager"]["Displays"] if "Topic" in d]
    assert len(displays) == 5
    for display in displays:
        topic = display["Topic"]
        row = BY_NAME[topic["Value"]]
        assert RVIZ_TYPES[display["Class"].split("/")[1]] == row.type_name
        asked = tuple(topic[key].lower().replace(" ", "_") for key in ("Reliability Policy", "Durability Policy"))
        assert (*asked, topic["Depth"]) == (row.reliability, row.durability, row.depth)


@pytest.mark.parametrize("name", ["foxglove.json", "catenary.rviz"])
def test_the_readme_names_the_layout(name):
    assert name in (ROOT / "nodes/inspect/README.md").read_text()
