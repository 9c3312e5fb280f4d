"""The bag's files against what the reader of rosbag2 needs (`rosbag2_format.py`)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml
from ff_planner_msgs.msg import ChaserState
from rosbag2_format import check_bag
from std_msgs.msg import String

from ff_planner_ros.bag.mcap.encoding import encode
from ff_planner_ros.bag.mcap.rosbag2_metadata import QualityOfService
from ff_planner_ros.bag.writer import BagWriter

START = 1_760_000_000_000_000_000
TYPES = (
    "ff_planner_msgs/msg/ChaserState",
    "visualization_msgs/msg/MarkerArray",
    "ff_planner_msgs/msg/Exchange",
)
TOPIC = ("topics_with_message_count", 1, "topic_metadata")


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    """Two files with messages, the second with one topic only; then one without any."""
    directory = tmp_path / "run"
    with BagWriter(directory, flush_interval=0.15) as writer:
        writer.custom_data["dropped"] = "0"
        writer.add_topic("/text", "std_msgs/msg/String", [])
        for number, name in enumerate(TYPES):
            writer.add_topic(f"/topic_{number}", name, [QualityOfService(), QualityOfService()])
        for offset in (30, 10, 20):
            writer.write("/topic_0", encode(ChaserState()), START + offset, START)
            writer.write("/text", encode(String()), START + offset, START)
        writer.split()
        writer.write("/text", encode(String()), START + 40, START)
        writer.split()
    return directory


def test_rosbag2_finds_all_that_it_needs(bag: Path) -> None:
    check_bag(bag)


def test_rosbag2_finds_all_that_it_needs_in_a_bag_without_anything(tmp_path: Path) -> None:
    BagWriter(tmp_path / "empty", 0.25).close()
    check_bag(tmp_path / "empty")


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (("version",), 8),
        (("message_count",), 8),
        (("duration", "nanoseconds"), -1),
        (("starting_time", "nanoseconds_since_epoch"), 1e9),
        (("files", 1, "message_count"), 3),
        (("relative_file_paths",), ["run_0.mcap"]),
        (("custom_data",), {"dropped": None, "why": ["a", "list"]}),
        ((*TOPIC, "offered_qos_profiles"), "[]"),
        ((*TOPIC, "type_description_hash"), ""),
        ((*TOPIC, "offered_qos_profiles", 0, "history"), 1),
    ],
)
def test_the_check_itself_finds_what_rosbag2_would_stumble_over(
    bag: Path, path: tuple[Any, ...], value: Any
) -> None:
    file = bag / "metadata.yaml"
    document = yaml.safe_load(file.read_text())
    place = document["rosbag2_bagfile_information"]
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = value
    file.write_text(yaml.safe_dump(document))
    with pytest.raises(AssertionError):
        check_bag(bag)
