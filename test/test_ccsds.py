"""A plan as CCSDS messages: read by another reader, also between its points; what is refused."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import handmade_plans
import numpy as np
import pytest
from handmade_plans import POINTS, Joints, Made, made, resting
from robots import LEMUR_SCENARIO
from scipy.interpolate import CubicHermiteSpline
from scipy.spatial.transform import Rotation

from ff_planner_ros.bag import read_plans
from ff_planner_ros.cli import main
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import InvalidInput
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.runs import ccsds

GOLDEN_BAG = Path(__file__).parent / "golden_bags" / "node"
EPOCH = "2026-11-30T23:59:58.25"
LABELS = ccsds.Labels("CHASER", "1998-067A", "EARTH", "GCRF")
METADATA = """OBJECT_NAME = {}
OBJECT_ID = UNKNOWN
CENTER_NAME = EARTH
REF_FRAME_A = EME2000
REF_FRAME_B = SC_BODY_1
ATTITUDE_DIR = A2B
TIME_SYSTEM = UTC
START_TIME = 2026-11-30T23:59:58.250000000
STOP_TIME = 2026-12-01T00:00:08.250000000
ATTITUDE_TYPE = QUATERNION/DERIVATIVE
QUATERNION_TYPE = LAST
INTERPOLATION_METHOD = HERMITE
INTERPOLATION_DEGREE = 3
"""


@dataclass(frozen=True)
class Block:
    """A segment of an AEM as it is written."""

    metadata: str
    time: Array  # from the first point of the file [s]
    quaternions: Array  # Q1 Q2 Q3 QC
    rates: Array


def aem_blocks(text: str) -> list[Block]:
    """Read an AEM without the product."""
    blocks, first = [], None
    for told in text.split("META_START\n")[1:]:
        metadata, rest = told.split("META_STOP\n")
        rows = [line.split() for line in rest.split("DATA_START\n")[1].split("\n")]
        rows = rows[: rows.index(["DATA_STOP"])]
        epochs = np.array([row[0] for row in rows], dtype="datetime64[ns]")
        first = epochs[0] if first is None else first
        numbers = np.array([row[1:] for row in rows], dtype=np.float64)
        since = (epochs - first).astype(np.int64) / 1e9
        metadata = re.sub("COMMENT .*\n", "", metadata)
        blocks.append(Block(metadata, since, *np.hsplit(numbers, 2)))
    return blocks


def interpolated(block: Block, time: Array) -> Rotation:
    """Return chaser to inertial axes by the polynomials that the file names."""
    told = CubicHermiteSpline(block.time, block.quaternions, block.rates)(time)
    return Rotation.from_quat(told)


def largest_angle(one: Rotation, other: Rotation) -> float:
    return float((one.inv() * other).magnitude().max())


def read_oem(path: Path) -> Any:
    reader = pytest.importorskip("oem", reason="pip install '.[ccsds]' brings a reader of OEM")
    return list(reader.OrbitEphemerisMessage.open(path))


def positions_in(segment: Any) -> tuple[Array, Array]:
    """Return positions [m] and velocities [m/s] at the points of a segment of an OEM."""
    states = list(segment)
    km = np.array([[*one.position, *one.velocity] for one in states])
    return 1e3 * km[:, :3], 1e3 * km[:, 3:]


@pytest.fixture(scope="module")
def answer(tmp_path_factory: pytest.TempPathFactory) -> Path:
    directory = tmp_path_factory.mktemp("answer")
    files = ("--json", str(directory / "plan.json"), "--bag", str(directory / "bag"))
    assert main(["plan", str(LEMUR_SCENARIO), *files]) == 0
    return directory


def export(source: Path, directory: Path, *options: str) -> tuple[Path, Path]:
    oem, aem = directory / "chaser.oem", directory / "chaser.aem"
    assert main(["export", str(source), "--oem", str(oem), "--aem", str(aem), *options]) == 0
    return oem, aem


def planned(path: Path) -> dict[str, Array]:
    told = json.loads(path.read_text())
    return {key: np.array(told[key]) for key in told if key == "time" or key.startswith("chaser_")}


def test_another_reader_finds_each_point_of_the_plan(answer: Path, tmp_path: Path) -> None:
    oem, _ = export(answer / "plan.json", tmp_path, "--epoch", EPOCH)
    (segment,) = read_oem(oem)
    named = {"OBJECT_NAME": "lemur", "CENTER_NAME": "EARTH", "REF_FRAME": "EME2000"}
    named |= {"TIME_SYSTEM": "UTC", "INTERPOLATION": "HERMITE", "INTERPOLATION_DEGREE": "3"}
    assert {key: str(segment.metadata[key]) for key in named} == named
    plan, (places, velocities) = planned(answer / "plan.json"), positions_in(segment)
    every = (len(places) - 1) // (len(plan["time"]) - 1)
    np.testing.assert_allclose(places[::every], plan["chaser_positions"], rtol=0.0, atol=6e-10)
    wanted = plan["chaser_linear_velocities"]
    np.testing.assert_allclose(velocities[::every], wanted, rtol=0.0, atol=6e-10)
    epochs = [one.epoch for one in segment][::every]
    since = np.array([(one - epochs[0]).sec for one in epochs])
    np.testing.assert_allclose(since, plan["time"], rtol=0.0, atol=1e-9)


def test_the_attitude_at_each_point_is_the_plans(answer: Path, tmp_path: Path) -> None:
    _, aem = export(answer / "plan.json", tmp_path, "--epoch", EPOCH)
    (block,) = aem_blocks(aem.read_text())
    assert block.metadata == METADATA.format("lemur")
    plan = planned(answer / "plan.json")
    there = Rotation.from_quat(plan["chaser_quaternions_xyzw"])
    assert largest_angle(interpolated(block, plan["time"]), there) < 1e-9
    assert (np.sum(block.quaternions[1:] * block.quaternions[:-1], axis=1) > 0.9).all()


def test_its_quaternion_takes_inertial_to_chaser_components(lemur: Robot) -> None:
    """By the matrix of 504.0-B, written out, for a chaser turned by +30 deg about inertial z."""
    turned = Rotation.from_euler("z", 30.0, degrees=True)
    still = made(lemur, resting(np.full(lemur.joints, 0.3)), np.zeros(6), np.zeros(3), turned)
    (segment,) = ccsds.segments_of([(lemur, still.plan.trajectory)], ccsds.epoch_ns(EPOCH))
    (block,) = aem_blocks(ccsds.aem([segment], LABELS))
    a, b, c, d = block.quaternions[0]
    to_chaser = np.array(
        [
            [a * a - b * b - c * c + d * d, 2 * (a * b + c * d), 2 * (a * c - b * d)],
            [2 * (a * b - c * d), -a * a + b * b - c * c + d * d, 2 * (b * c + a * d)],
            [2 * (a * c + b * d), 2 * (b * c - a * d), -a * a - b * b + c * c + d * d],
        ]
    )
    seen = to_chaser @ np.array([1.0, 0.0, 0.0])
    np.testing.assert_allclose(seen, [np.cos(np.pi / 6), -0.5, 0.0], atol=1e-12)


def moving(robot: Robot) -> Made:
    """A system that flies and turns, and whose joints move on smooth ways that jerk at points."""
    rng = np.random.default_rng(7)
    shape = POINTS, robot.joints
    joints = Joints(
        0.4 + 0.02 * np.cumsum(rng.uniform(-1.0, 1.0, shape), axis=0),
        *(rng.uniform(-0.05, 0.05, shape), rng.uniform(-0.05, 0.05, shape)),
    )
    twist = np.array([0.01, -0.02, 0.03, 0.02, -0.01, 0.03])
    return made(robot, joints, twist, np.array([1.0, -2.0, 3.0]))


def chaser_of(robot: Robot, q: Array) -> tuple[Array, Rotation]:
    """Where the chaser is, by the placement of its frame in the base."""
    base = Rotation.from_quat(q[:, 3:7])
    places = q[:, :3] + base.apply(np.array(robot.position_chaser_in_base))
    return places, base * Rotation.from_matrix(np.array(robot.rotation_chaser_to_base))


def test_between_the_points_it_is_the_motion_that_physics_makes(
    robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Within 1e-6 m and 1e-9 rad, by another integration of the conserved momentum."""
    monkeypatch.setattr(handmade_plans, "ACCURACY", 1e-13)
    truth = moving(robot)
    start = ccsds.epoch_ns("2026-11-30T12:00:00")
    (segment,) = ccsds.segments_of([(truth.problem.robot, truth.plan.trajectory)], start)
    (block,) = aem_blocks(ccsds.aem([segment], LABELS))
    places, attitudes = chaser_of(robot, truth.q)
    assert largest_angle(interpolated(block, truth.time), attitudes) < 1e-9
    numbers = [line.split()[1:] for line in ccsds.oem([segment], LABELS).split("\n")]
    rows = [row for row in numbers if len(row) == 6 and "." in row[0]]
    km = np.array(rows, dtype=np.float64)
    told = CubicHermiteSpline(block.time, 1e3 * km[:, :3], 1e3 * km[:, 3:])(truth.time)
    assert np.abs(told - places).max() < 1e-6
    assert len(block.time) < 400 * POINTS


def test_another_reader_interpolates_to_a_micrometre(lemur: Robot, tmp_path: Path) -> None:
    truth, file = moving(lemur), tmp_path / "chaser.oem"
    motion = truth.plan.trajectory
    segments = ccsds.segments_of([(lemur, motion)], ccsds.epoch_ns("2026-11-30T12:00:00"))
    file.write_text(ccsds.oem(segments, LABELS))
    (segment,) = read_oem(file)
    places, _ = chaser_of(lemur, truth.q)
    begin, after = (one.epoch for one in list(segment)[:2])
    second = (after - begin) / (after - begin).sec
    for index in range(7, len(truth.time), 61):
        found = segment(begin + truth.time[index] * second)
        assert np.linalg.norm(1e3 * np.array(found.position) - places[index]) < 1e-6


def test_in_an_orbit_it_is_the_same_motion(lemur: Robot) -> None:
    """7000 km away and at 7.5 km/s, but for the digits of a double there."""
    motion, start = moving(lemur).plan.trajectory, ccsds.epoch_ns(EPOCH)
    place, speed = np.array([7e6, -1e5, 2e5]), np.array([10.0, 7500.0, -300.0])
    there = replace(
        motion,
        chaser_positions=motion.chaser_positions + place + np.outer(motion.time, speed),
        chaser_linear_velocities=motion.chaser_linear_velocities + speed,
    )
    (near,) = ccsds.segments_of([(lemur, motion)], start)
    (far,) = ccsds.segments_of([(lemur, there)], start)
    assert far.epochs == near.epochs
    np.testing.assert_allclose(far.poses[:, 3:], near.poses[:, 3:], rtol=0.0, atol=1e-10)
    first = np.datetime64(near.epochs[0])
    since = (np.array(near.epochs, dtype="datetime64[ns]") - first).astype(np.int64) / 1e9
    moved = far.poses[:, :3] - place - np.outer(since, speed)
    np.testing.assert_allclose(moved, near.poses[:, :3], rtol=0.0, atol=1e-8)


def test_a_point_that_the_motion_before_misses_is_told_all_the_same(lemur: Robot) -> None:
    """Points of a plan are 1e-8 rad off each other's motion; here it is a thousand times that."""
    motion = moving(lemur).plan.trajectory
    moved = motion.chaser_positions.copy()
    moved[5] += 1e-5
    aside = replace(motion, chaser_positions=moved)
    (segment,) = ccsds.segments_of([(lemur, aside)], ccsds.epoch_ns(EPOCH))
    distances = np.linalg.norm(segment.poses[:, :3] - moved[5], axis=1)
    assert distances.min() < 1e-9


def test_phases_are_segments_that_follow_each_other(tmp_path: Path) -> None:
    scenario, answer = LEMUR_SCENARIO.parent / "whole_capture.yaml", tmp_path / "whole.json"
    assert main(["plan", str(scenario), "--json", str(answer)]) == 0
    oem, aem = export(answer, tmp_path, "--epoch", EPOCH)
    blocks, phases = aem_blocks(aem.read_text()), json.loads(answer.read_text())["phases"]
    assert len(blocks) == len(phases) == 3
    begin = 0.0
    for block, phase in zip(blocks, phases, strict=True):
        assert block.time[0] == pytest.approx(begin, abs=1e-9)
        begin += phase["time"][-1]
        assert block.time[-1] == pytest.approx(begin, abs=1e-9)
        last = Rotation.from_quat(phase["chaser_quaternions_xyzw"][-1])
        assert largest_angle(Rotation.from_quat(block.quaternions[-1]), last) < 1e-9
    for segment, phase in zip(read_oem(oem), phases, strict=True):
        places, _ = positions_in(segment)
        ends = np.array(phase["chaser_positions"])[[0, -1]]
        np.testing.assert_allclose(places[[0, -1]], ends, rtol=0.0, atol=6e-10)


def test_a_plan_in_a_bag_begins_at_its_stamp(answer: Path, tmp_path: Path) -> None:
    _, aem = export(answer / "bag", tmp_path, "--object-name", "SERVICER 1")
    ((plan,), (block,)) = read_plans(answer / "bag"), aem_blocks(aem.read_text())
    told = re.search("START_TIME = (.*)", block.metadata)
    assert told is not None
    assert np.datetime64(told[1]).astype("datetime64[ns]").astype(np.int64) == plan.start_ns
    assert "OBJECT_NAME = SERVICER 1\n" in block.metadata


def test_one_plan_of_a_bag_with_several_is_asked_for(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    aem = tmp_path / "chaser.aem"
    assert main(["export", str(GOLDEN_BAG), "--aem", str(aem)]) == 2
    solved = [one for one in read_plans(GOLDEN_BAG) if one.trajectory is not None]
    named = ", ".join(one.plan_id for one in solved)
    assert f"--plan is missing: it must be one of {named}" in capsys.readouterr().err
    assert not aem.exists()
    wanted = solved[-1]
    assert wanted.trajectory is not None
    assert main(["export", str(GOLDEN_BAG), "--aem", str(aem), "--plan", wanted.plan_id]) == 0
    (block,) = aem_blocks(aem.read_text())
    last = Rotation.from_quat(wanted.trajectory.chaser_quaternions_xyzw[-1])
    assert largest_angle(Rotation.from_quat(block.quaternions[-1]), last) < 1e-9


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ((), "--epoch is missing: the plan has no start time in UTC"),
        (("--epoch", "now"), "--epoch is now: it must be a UTC time such as"),
        (("--epoch", "2026-02-30T00:00:00"), "--epoch is 2026-02-30T00:00:00: it must be"),
        (("--epoch", "2016-12-31T23:59:60"), "no leap second"),
        (("--epoch", "1970-01-01T00:00:12"), "the plan has no start time in UTC"),
        (("--epoch", EPOCH, "--ref-frame", "ITRF2000"), "--ref-frame is ITRF2000: it must be one"),
        (("--epoch", EPOCH, "--object-id", "a\nb"), "--object-id is"),
        (("--epoch", EPOCH, "--object-name", "café"), "--object-name is café: it must be 1 to 64"),
        (("--epoch", EPOCH, "--center-name", " "), "--center-name is"),
        (("--epoch", EPOCH, "--plan", "other"), "--plan is other: it must be one of plan.json"),
        (("--csv", "tables"), "--csv is tables: not beside --oem and --aem"),
    ],
)
def test_a_value_that_cannot_be_written_is_refused_by_name(
    options: tuple[str, ...],
    words: str,
    answer: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["export", str(answer / "plan.json"), "--oem", "chaser.oem", *options]) == 2
    assert words in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ((), "what to write is missing: one of --csv"),
        (("--csv", "tables", "--epoch", EPOCH), f"--epoch is {EPOCH}: it counts beside --oem"),
        (("--npz", "new.npz", "--ref-frame", "ICRF"), "--ref-frame is ICRF: it counts beside"),
    ],
)
def test_options_that_would_be_in_vain_are_refused(
    options: tuple[str, ...], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["export", str(GOLDEN_BAG), *options]) == 2
    assert words in capsys.readouterr().err


def test_a_file_that_is_there_stays(
    answer: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    there = tmp_path / "chaser.aem"
    there.write_text("mine")
    arguments = ["export", str(answer / "plan.json"), "--epoch", EPOCH, "--aem", str(there)]
    assert main(arguments) == 2
    assert "it exists already" in capsys.readouterr().err
    assert there.read_text() == "mine"


def test_samples_that_are_no_motion_are_refused(lemur: Robot) -> None:
    motion, start = moving(lemur).plan.trajectory, ccsds.epoch_ns(EPOCH)
    wrong = motion.chaser_linear_velocities.copy()
    wrong[3] += 1e6
    for told, words in (
        (replace(motion, chaser_linear_velocities=wrong), "motion of the chaser"),
        (replace(motion, time=np.zeros(POINTS)), "time"),
        (replace(motion, chaser_positions=np.full((POINTS, 3), np.nan)), "chaser_positions"),
    ):
        with pytest.raises(InvalidInput, match=words):
            ccsds.segments_of([(lemur, told)], start)


def test_a_chaser_whose_attitude_wheels_hold_needs_no_points_between(tmp_path: Path) -> None:
    answer = tmp_path / "wheels.json"
    assert (
        main(["plan", str(LEMUR_SCENARIO.parent / "lemur_wheels.yaml"), "--json", str(answer)]) == 0
    )
    _, aem = export(answer, tmp_path, "--epoch", EPOCH)
    (block,) = aem_blocks(aem.read_text())
    assert (block.quaternions == block.quaternions[0]).all()
    assert (block.rates == 0.0).all()
