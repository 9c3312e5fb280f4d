"""A recorded bag stays readable: see golden_bags/README.md."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from ff_planner_ros.bag import read_plans
from ff_planner_ros.bag.export import export_csv
from ff_planner_ros.bag.info import info
from ff_planner_ros.bag.reader import open_bag
from ff_planner_ros.bag.recover import recover

NODE = Path(__file__).parent / "golden_bags" / "node"
(FILE,) = NODE.glob("*.mcap")
OUTCOMES = [
    *("NO_STATE", "WRONG_FRAME", "WRONG_FRAME", "SOLVED", "OUT_OF_RANGE", "SOLVED"),
    *("GOAL_OUT_OF_REACH", *3 * ["SOLVED"], "COLLISION"),
]


@pytest.mark.law("BAG-03")
def test_every_message_is_decoded_as_an_independent_reader_does() -> None:
    with open_bag(NODE) as bag:
        types = {topic.type_name for topic in bag.topics.values()}
        ours = {type_name: len(list(bag.decoded(type_name))) for type_name in types}
        assert sum(ours.values()) == bag.message_count
        assert bag.notes == ()
        states = [
            s.joint_positions.tolist() for _, s in bag.decoded("ff_planner_msgs/msg/ChaserState")
        ]
    with FILE.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        theirs = [
            found[3].joint_positions for found in reader.iter_decoded_messages("/chaser_state")
        ]
    assert states == theirs


def test_its_answers_are_listed_in_order() -> None:
    plans = read_plans(NODE)
    assert [plan.status for plan in plans] == OUTCOMES
    for plan in plans:
        assert (plan.trajectory is not None) == (plan.status == "SOLVED")
        assert all(np.isfinite(column).all() for column in plan.columns().values())


def test_info_tells_of_its_requests() -> None:
    text = "\n".join(info(NODE))
    assert f"requests  {len(OUTCOMES)}: " in text
    assert all(outcome in text for outcome in OUTCOMES)
    assert "note:" not in text
    assert "publish_plan  1: 1 SOLVED" in text


def test_it_is_exported_and_recovered(tmp_path: Path) -> None:
    assert export_csv(NODE, tmp_path / "tables") == ()
    with (tmp_path / "tables" / "answers.csv").open(newline="") as stream:
        assert [row["status"] for row in csv.DictReader(stream)] == OUTCOMES
    recovery = recover(NODE, tmp_path / "recovered")
    assert recovery.is_whole
    with open_bag(NODE) as recorded, open_bag(tmp_path / "recovered") as new:
        assert list(new.messages()) == list(recorded.messages())
