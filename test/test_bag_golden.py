"""Bags of earlier versions stay readable: see golden_bags/README.md."""

from __future__ import annotations

import csv
import hashlib
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

GOLDEN = Path(__file__).parent / "golden_bags"
# Of each: outcomes in order, SHA-256 of the file.
BAGS = {
    "offline_solved": (
        ["SOLVED"],
        "378de0177975d7169b929062fae76b791fcc2d7398b9d83063b320e90d458835",
    ),
    "offline_refused": (
        ["GOAL_OUT_OF_REACH"],
        "0768df916fb445e4c84eef473790122b193f4ccb35784c5c2f4fec9212df37a8",
    ),
    "node": (
        [
            "NO_STATE",
            "WRONG_FRAME",
            "WRONG_FRAME",
            "SOLVED",
            "OUT_OF_RANGE",
            "SOLVED",
            "GOAL_OUT_OF_REACH",
        ],
        "2a6d05cba1b7f44ffade4d484d02e5d097f36a3a33948f2c044cfcce98dbd574",
    ),
    "node_0_2": (
        ["NO_STATE", *4 * ["SOLVED"], "COLLISION"],
        "ccbdd48b53bd981601fb958dac3d2b2b975153469d6c20d8aa08f0789db28e64",
    ),
}

every_bag = pytest.mark.parametrize("name", BAGS)


def file_of(name: str) -> Path:
    (file,) = (GOLDEN / name).glob("*.mcap")
    return file


def test_every_golden_bag_is_tested() -> None:
    assert {path.name for path in GOLDEN.iterdir() if path.is_dir()} == set(BAGS)


@every_bag
def test_a_golden_bag_is_as_it_was_recorded(name: str) -> None:
    assert hashlib.sha256(file_of(name).read_bytes()).hexdigest() == BAGS[name][1]


@pytest.mark.law("BAG-03")
@every_bag
def test_every_message_is_decoded_as_an_independent_reader_does(name: str) -> None:
    with open_bag(GOLDEN / name) as bag:
        types = {topic.type_name for topic in bag.topics.values()}
        ours = {type_name: len(list(bag.decoded(type_name))) for type_name in types}
        assert sum(ours.values()) == bag.message_count
        assert bag.notes == ()
        states = [
            s.joint_positions.tolist() for _, s in bag.decoded("ff_planner_msgs/msg/ChaserState")
        ]
    with file_of(name).open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        theirs = [
            found[3].joint_positions for found in reader.iter_decoded_messages("/chaser_state")
        ]
    assert states == theirs


@every_bag
def test_its_answers_are_listed_in_order(name: str) -> None:
    plans = read_plans(GOLDEN / name)
    assert [plan.status for plan in plans] == BAGS[name][0]
    for plan in plans:
        assert (plan.trajectory is not None) == (plan.status == "SOLVED")
        assert all(np.isfinite(column).all() for column in plan.columns().values())


@every_bag
def test_info_tells_of_its_requests(name: str) -> None:
    text = "\n".join(info(GOLDEN / name))
    assert f"requests  {len(BAGS[name][0])}: " in text
    assert all(outcome in text for outcome in BAGS[name][0])
    assert "note:" not in text
    waiting = "publish_plan  1: 1 SOLVED"
    assert (waiting in text) == (name == "node_0_2")


@every_bag
def test_it_is_exported_and_recovered(name: str, tmp_path: Path) -> None:
    assert export_csv(GOLDEN / name, tmp_path / "tables") == ()
    with (tmp_path / "tables" / "answers.csv").open(newline="") as stream:
        assert [row["status"] for row in csv.DictReader(stream)] == BAGS[name][0]
    recovery = recover(GOLDEN / name, tmp_path / "recovered")
    assert recovery.is_whole
    with open_bag(GOLDEN / name) as old, open_bag(tmp_path / "recovered") as new:
        assert list(new.messages()) == list(old.messages())
