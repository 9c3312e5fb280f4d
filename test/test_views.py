"""Views that open ready-made: every topic, field and frame in them is one that the node has.

Foxglove and RViz are not here: their files are read as JSON and YAML, and held against the node's
table of interfaces and its messages. Rerun itself checks its files in CI.
"""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
import venv
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest
import yaml
from ff_planner_msgs.msg import Scene
from robots import CONFIG
from test_node_interfaces import INTERFACES, ROW, Interface
from visualization_msgs.msg import Marker

from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.ros.messages import foreign  # noqa: F401 (finds the messages of /tf)

VIEWS = CONFIG / "views"
TABLE = {
    f"/{row.name.lstrip('/')}": row
    for row in (Interface(*found) for found in ROW.findall(INTERFACES.read_text(encoding="utf-8")))
    if row.direction == "publishes"
}
OF_ROS = {"/rosout": "rcl_interfaces/msg/Log"}
# Panels of Foxglove and displays of RViz, with what they show.
PANELS = {"3D", "Plot", "StateTransitions", "DiagnosticSummary", "RosOut"}
# Type, name and value of each constant, type and name of each field.
DEFINED = re.compile(r"^([\w/\[\]<=]+) (\w+)(=\d+)?", re.MULTILINE)
DISPLAYS = {
    "RobotModel": "std_msgs/msg/String",
    "MarkerArray": "visualization_msgs/msg/MarkerArray",
    "Path": "nav_msgs/msg/Path",
    "Pose": "geometry_msgs/msg/PoseStamped",
    "TF": "",
    "Grid": "",
}
BOUNDED = re.compile(r"<=|sequence<.*, *\d+>|, *\d+>")


def message(topic: str) -> Any:
    """The class of a topic's messages."""
    kind = TABLE[topic].type if topic in TABLE else OF_ROS[topic]
    package, _, name = kind.split("/")
    return getattr(import_module(f"{package}.msg"), name)


def require_field(path: str) -> None:
    """A path of Foxglove, `/topic.field[0].field`, leads to a field."""
    topic, *fields = path.split(".")
    found = message(topic)
    for field in fields:
        name, is_entry, _ = field.partition("[")
        kinds = found.get_fields_and_field_types()
        assert name in kinds, path
        assert bool(is_entry) == kinds[name].startswith("sequence<"), path
        found = found if is_entry else type(getattr(found(), name))


def panels(layout: Any) -> Iterator[str]:
    """Every panel that a place of the layout has."""
    if isinstance(layout, str):
        yield layout
        return
    assert layout["direction"] in ("row", "column")
    assert 0 < layout["splitPercentage"] < 100
    for part in ("first", "second"):
        yield from panels(layout[part])


def test_foxgloves_layout_shows_what_the_node_publishes() -> None:
    layout = json.loads((VIEWS / "foxglove.json").read_text(encoding="utf-8"))
    shown = list(panels(layout["layout"]))
    assert sorted(shown) == sorted(layout["configById"])  # each has its place, and once
    assert {name.split("!")[0] for name in shown} <= PANELS
    for name, settings in layout["configById"].items():
        for path in settings.get("paths", ()):
            require_field(path["value"])
            if path["timestampMethod"] == "headerStamp":
                require_field(f"{path['value'].split('.')[0]}.header")
        if "topicToRender" in settings:
            assert message(settings["topicToRender"])
        if name.startswith("3D!"):
            require_scene(settings)


def require_scene(settings: Any) -> None:
    parameters = load_parameters()
    assert settings["followTf"] == parameters.inertial_frame
    assert set(settings["topics"]) <= set(TABLE)
    robot = settings["layers"]["preview"]
    assert robot["framePrefix"] == parameters.tf.preview_prefix
    assert TABLE[robot["topic"]].type == "std_msgs/msg/String"
    assert settings["layers"]["grid"]["frameId"] == parameters.inertial_frame


def test_rvizs_displays_hear_what_the_node_publishes() -> None:
    manager = yaml.safe_load((VIEWS / "rviz.rviz").read_text(encoding="utf-8"))[
        "Visualization Manager"
    ]
    parameters = load_parameters()
    assert manager["Global Options"]["Fixed Frame"] == parameters.inertial_frame
    for display in manager["Displays"]:
        plugin, _, kind = display["Class"].partition("/")
        assert plugin == "rviz_default_plugins"
        topic = display.get("Topic") or display.get("Description Topic")
        assert bool(topic) == bool(DISPLAYS[kind])
        if topic:
            row = TABLE[topic["Value"]]
            offered = f"{topic['Reliability Policy']}, {topic['Durability Policy']}".lower()
            # A latched topic is heard late only by who asks for that.
            assert (row.type, row.qos.strip()) == (DISPLAYS[kind], offered)
        if kind == "RobotModel":  # RViz puts a slash between
            assert f"{display['TF Prefix']}/" == parameters.tf.preview_prefix


def test_the_scene_for_rerun_knows_markers() -> None:
    text = (VIEWS / "rerun_scene.py").read_text(encoding="utf-8")
    assert TABLE["/markers"].type == "visualization_msgs/msg/MarkerArray"
    assert 'topics=["/markers"]' in text
    types = dict(re.findall(r"^    ([A-Z_]+) = (\d+)$", text, re.MULTILINE))
    assert {name: getattr(Marker, name) for name in types} == {
        name: int(number) for name, number in types.items()
    }
    drawn = (CONFIG.parent / "ff_planner_ros/ros/outputs/markers.py").read_text(encoding="utf-8")
    assert set(re.findall(r"Marker\.([A-Z_]+)", drawn)) - {"DELETEALL"} == {*types}


def test_reruns_blueprint_names_topics() -> None:
    text = (VIEWS / "rerun_blueprint.py").read_text(encoding="utf-8")
    named = set(re.findall(r'"(/\w+)"', text))
    assert named <= {*TABLE, *OF_ROS}
    assert {"/planned_joint_states", "/tracking_error"} <= named
    assert f'target_frame="{load_parameters().inertial_frame}"' in text


@pytest.mark.ci
def test_rerun_reads_what_the_scripts_write(tmp_path: Path) -> None:
    venv.create(tmp_path / "rerun")
    binaries, uv = tmp_path / "rerun" / "bin", Path(sys.prefix) / "bin" / "uv"
    for_it = ["--python", str(binaries / "python")]
    pip = [str(uv), "pip", "install", *for_it]
    if not uv.exists():
        pip = [sys.executable, "-m", "pip", *for_it, "install"]
    wanted = ("rerun-sdk>=0.28", "mcap-ros2-support")
    if subprocess.run([*pip, "--quiet", *wanted], check=False).returncode:
        pytest.skip("rerun-sdk cannot be had here")
    bag, blueprint = tmp_path / "run_0.mcap", tmp_path / "planner.rbl"
    shutil.copy(next((Path(__file__).parent / "golden_bags/node").glob("*.mcap")), bag)
    # Rerun shows a file by the blueprint whose application is named as the file is.
    run = f'"{bag.stem}"'
    scene, recorded = tmp_path / "planner.rrd", (run, "/drawn/obstacles/0 ", "/drawn/bodies/4 ")
    for script, made, words in (
        ("rerun_blueprint.py", blueprint, (run,)),
        ("rerun_scene.py", scene, (*recorded, "/planned_joint_states ", "/view/")),
    ):
        written = [str(binaries / "python"), str(VIEWS / script), str(bag), str(made)]
        subprocess.run(written, check=True)
        told = []
        for verb in ("verify", "print"):
            found = subprocess.run(
                [str(binaries / "rerun"), "rrd", verb, str(made)],
                capture_output=True,
                text=True,
                check=True,
            )
            told.append(found.stdout + found.stderr)
        assert "1 file verified without error" in told[0]
        assert all(word in told[1] for word in words)


@pytest.mark.parametrize("topic", sorted(set(TABLE) - {"/exchanges"}))
def test_what_is_published_has_no_bounded_arrays(topic: str) -> None:
    """PlotJuggler could not read them until April 2026. Exchanges hold requests: no curves."""
    bounded = [path for path, kind in fields_in(message(topic), topic) if BOUNDED.search(kind)]
    assert not bounded


def test_a_bounded_array_is_found_wherever_it_is() -> None:
    """Bodies are heard, not published: they have shapes of shape_msgs, whose arrays are bounded."""
    bounded = {path for path, kind in fields_in(Scene, "") if BOUNDED.search(kind)}
    assert {".bodies.primitive", ".bodies.mesh", ".bodies.primitive.dimensions"} <= bounded


def fields_in(kind: Any, path: str) -> Iterator[tuple[str, str]]:
    """Every field of a message and of all that it holds, with its type."""
    for name, slot in zip(kind.get_fields_and_field_types(), kind.SLOT_TYPES, strict=True):
        told = kind.get_fields_and_field_types()[name]
        yield f"{path}.{name}", told
        inner = getattr(slot, "value_type", slot)
        if hasattr(inner, "namespaces"):
            part = getattr(import_module(".".join(inner.namespaces)), inner.name)
            yield from fields_in(part, f"{path}.{name}")


def test_the_constants_of_a_message_stand_before_their_field() -> None:
    """By which Foxglove knows whose they are, and shows their names instead of numbers."""
    named = dict[str, set[str]]()  # the types of the constants before each field
    for path in (CONFIG.parent / "msg_defs" / "msg").glob("*.msg"):
        waiting = set[str]()
        for kind, name, value in DEFINED.findall(path.read_text(encoding="utf-8")):
            waiting.add(kind)
            if not value:
                named |= {f"{path.stem}.{name}": waiting} if len(waiting) > 1 else {}
                waiting = set()
    # A capsule is one more of the types of shape_msgs.
    assert named == {"Obstacle.id": {"uint8", "string"}}
