"""The planner's answers as arrays, against an independent decoder and answers made by hand."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from answers import exchange, write_bag
from ff_planner_msgs.msg import Plan, PlanAnswer, PlanMetrics, PlanRequest
from geometry_msgs.msg import PoseStamped, Twist
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from trajectory_msgs.msg import JointTrajectoryPoint

from ff_planner_ros.bag import read_plans
from ff_planner_ros.bag.exchanges import EXCHANGE
from ff_planner_ros.bag.export import export_csv, export_npz
from ff_planner_ros.bag.info import info
from ff_planner_ros.cli import main
from ff_planner_ros.errors import BagError, Status

NODE = Path(__file__).parent / "golden_bags" / "node"


def response(plan_id: str, code: int = Status.SOLVED, joints: int = 2) -> PlanAnswer:
    """An answer with a plan on three points, every number of it another."""
    numbers = iter(np.arange(1.0, 1000.0) / 7)

    def some(count: int) -> list[float]:
        return [next(numbers) for _ in range(count)]

    answer = PlanAnswer(plan_id=plan_id)
    answer.status.code, answer.status.message = int(code), "because"
    if code != Status.SOLVED:
        return answer
    plan = Plan()
    plan.joint_trajectory.header.stamp.sec = 5
    plan.joint_trajectory.joint_names = [f"j{number}" for number in range(joints)]
    metrics = PlanMetrics(peak_joint_torques=some(joints), joint_path_length=1.5)
    answer.plans, answer.metrics = [plan], [metrics]
    for number in range(3):
        point = JointTrajectoryPoint(
            positions=some(joints),
            velocities=some(joints),
            accelerations=some(joints),
            effort=some(joints),
        )
        point.time_from_start.nanosec = number * 250_000_000
        plan.joint_trajectory.points.append(point)
        for path, twists in (
            (plan.chaser_path, plan.chaser_twists),
            (plan.end_effector_path, plan.end_effector_twists),
        ):
            stamped, twist = PoseStamped(), Twist()
            for vector in (stamped.pose.position, twist.linear, twist.angular):
                vector.x, vector.y, vector.z = some(3)
            turn = stamped.pose.orientation
            turn.x, turn.y, turn.z, turn.w = some(4)
            path.poses.append(stamped)
            twists.append(twist)
    return answer


def write(directory: Path, *answers: PlanAnswer) -> Path:
    return write_bag(directory, *map(exchange, answers))


def answered_exchanges() -> list[Any]:
    """Return what rosbags reads of the requests for a plan."""
    with AnyReader([NODE]) as reader:
        decoded = [
            reader.deserialize(data, EXCHANGE)
            for connection, _, data in reader.messages()
            if connection.msgtype == EXCHANGE
        ]
    return [one for one in decoded if one.event == "answered"]


def test_plans_are_those_that_an_independent_decoder_finds_published() -> None:
    with next(NODE.glob("*.mcap")).open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        topics = ("/joint_trajectory", "/predicted_chaser_path")
        found = [(one[1].topic, one[3]) for one in reader.iter_decoded_messages(topics)]
    trajectories, paths = ([one for topic, one in found if topic == wanted] for wanted in topics)
    plans = [plan for plan in read_plans(NODE) if plan.trajectory is not None]
    assert len(plans) == len(trajectories) == len(paths) == 5
    for plan, trajectory, path in zip(plans, trajectories, paths, strict=True):
        motion = plan.trajectory
        published = [list(point.positions) for point in trajectory.points]
        assert motion.joint_positions.tolist() == published
        places = [stamped.pose.position for stamped in path.poses]
        assert motion.chaser_positions.tolist() == [[p.x, p.y, p.z] for p in places]


def test_arrays_are_what_the_messages_say() -> None:
    answers = [one.answer[0] for one in answered_exchanges()]
    plans = read_plans(NODE)
    assert [plan.plan_id for plan in plans] == [answer.plan_id for answer in answers]
    solved = 0
    for plan, answer in zip(plans, answers, strict=True):
        assert plan.message == answer.status.message
        if plan.trajectory is None:
            continue
        solved += 1
        (made,) = answer.plans
        motion, points = plan.trajectory, made.joint_trajectory.points
        stamp = made.joint_trajectory.header.stamp
        assert plan.start_ns == stamp.sec * 10**9 + stamp.nanosec
        assert plan.joint_names == tuple(made.joint_trajectory.joint_names)
        assert motion.time[-1] >= made.duration - 1e-9
        for field, ours in (
            ("positions", motion.joint_positions),
            ("velocities", motion.joint_velocities),
            ("accelerations", motion.joint_accelerations),
            ("effort", motion.joint_torques),
        ):
            assert ours.tolist() == [getattr(point, field).tolist() for point in points]
        for path, twists, who in (
            (made.chaser_path, made.chaser_twists, "chaser"),
            (made.end_effector_path, made.end_effector_twists, "ee"),
        ):
            poses = [stamped.pose for stamped in path.poses]
            places = [[p.position.x, p.position.y, p.position.z] for p in poses]
            turns = [[*(getattr(p.orientation, axis) for axis in "xyzw")] for p in poses]
            linear = [[t.linear.x, t.linear.y, t.linear.z] for t in twists]
            angular = [[t.angular.x, t.angular.y, t.angular.z] for t in twists]
            assert getattr(motion, f"{who}_positions").tolist() == places
            assert getattr(motion, f"{who}_quaternions_xyzw").tolist() == turns
            assert getattr(motion, f"{who}_linear_velocities").tolist() == linear
            assert getattr(motion, f"{who}_angular_velocities").tolist() == angular
        (metrics,) = answer.metrics
        assert plan.metrics["min_clearance"] == metrics.min_clearance
        assert plan.metrics["peak_joint_torques"] == tuple(metrics.peak_joint_torques)
    assert solved == 5


def test_columns_are_one_dimensional_equally_long_and_named_with_their_unit(tmp_path: Path) -> None:
    (plan,) = read_plans(write(tmp_path / "run", response("a")))
    columns = plan.columns()
    assert {column.shape for column in columns.values()} == {(3,)}
    assert len(columns) == 1 + 4 * 2 + 2 * 13
    assert columns["time_s"].tolist() == [0.0, 0.25, 0.5]
    assert (
        columns["j1_velocity_rad_per_s"].tolist() == plan.trajectory.joint_velocities[:, 1].tolist()
    )
    assert columns["chaser_qw"].tolist() == plan.trajectory.chaser_quaternions_xyzw[:, 3].tolist()
    assert columns["ee_z_m"].tolist() == plan.trajectory.ee_positions[:, 2].tolist()
    distinct = {tuple(column.tolist()) for column in columns.values()}
    assert len(distinct) == len(columns)  # no two are of the same quantity


def test_what_an_answer_lacks_is_nan(tmp_path: Path) -> None:
    answer = response("a")
    for point in answer.plans[0].joint_trajectory.points:
        point.effort = []
    answer.plans[0].end_effector_twists = []
    (plan,) = read_plans(write(tmp_path / "run", answer))
    assert np.isnan(plan.trajectory.joint_torques).all()
    assert plan.trajectory.joint_torques.shape == (3, 2)
    assert np.isnan(plan.trajectory.ee_linear_velocities).all()
    assert np.isfinite(plan.trajectory.ee_positions).all()


def test_an_answer_that_makes_no_sense_is_told_and_the_others_are_read(tmp_path: Path) -> None:
    crooked = response("crooked")
    crooked.plans[0].end_effector_twists = crooked.plans[0].end_effector_twists[:2]
    bag = write(tmp_path / "run", crooked, response("sound"))
    with pytest.warns(UserWarning, match=r"cannot be understood: .*\(2, 6\), not \(3, 6\)"):
        (plan,) = read_plans(bag)
    assert plan.plan_id == "sound"


def test_a_refusal_has_metrics_only_if_there_was_an_attempt(tmp_path: Path) -> None:
    refused, tried = (response(name, Status.COLLISION) for name in ("refused", "tried"))
    tried.solver.rollouts, tried.metrics = 7, [PlanMetrics(min_clearance=-0.25)]
    first, second = read_plans(write(tmp_path / "run", refused, tried))
    assert (first.status, first.metrics) == ("COLLISION", {})
    assert {column.shape for column in first.columns().values()} == {(0,)}
    assert second.metrics["min_clearance"] == -0.25
    assert second.trajectory is None


def test_a_status_of_a_later_version_is_given_as_its_number(tmp_path: Path) -> None:
    (plan,) = read_plans(write(tmp_path / "run", response("a", 999)))
    assert plan.status == "999"


def test_two_robots_in_one_bag_are_told_apart(tmp_path: Path) -> None:
    answers = response("/a/1"), response("/b/1", Status.BUSY)
    bag = write_bag(
        tmp_path / "run",
        ("/a/exchanges", exchange(answers[0])),
        ("/a/exchanges", exchange(request=PlanRequest())),
        ("/b/exchanges", exchange(answers[1], interface="action", requester="fleet")),
    )
    assert [plan.topic for plan in read_plans(bag)] == ["/a/exchanges", "/b/exchanges"]
    text = "\n".join(info(bag))
    assert "requests  3: 1 SOLVED, 1 BUSY, 1 no answer" in text
    assert "service  SOLVED  /a/1  because" in text
    assert "action  BUSY  /b/1  because" in text
    assert "note: it is of 2 planners, /a, /b: " in text
    assert [plan.row()["requester"] for plan in read_plans(bag)] == [None, "fleet"]


def test_tables_hold_the_columns_to_the_last_bit(tmp_path: Path) -> None:
    bag = write(tmp_path / "run", response("run.1"), response("run.2", Status.BUSY))
    assert main(["export", str(bag), "--csv", str(tmp_path / "tables")]) == 0
    assert {file.name for file in (tmp_path / "tables").iterdir()} == {"answers.csv", "run.1.csv"}
    with (tmp_path / "tables" / "run.1.csv").open(newline="") as stream:
        names, *rows = csv.reader(stream)
    columns = read_plans(bag)[0].columns()
    assert names == list(columns)
    assert np.array(rows, dtype=float).tolist() == np.column_stack(list(columns.values())).tolist()
    with (tmp_path / "tables" / "answers.csv").open(newline="") as stream:
        first, second = csv.DictReader(stream)
    assert (first["plan_id"], first["status"], first["joint_path_length_rad"]) == (
        "run.1",
        "SOLVED",
        "1.5",
    )
    assert (second["status"], second["joint_path_length_rad"]) == ("BUSY", "")


def test_every_answer_of_every_bag_has_the_same_columns(tmp_path: Path) -> None:
    bags = [NODE]
    bags.append(write(tmp_path / "lone", response("a", joints=3), response("b", 999)))
    bags.append(write(tmp_path / "refused", response("c", Status.BUSY)))
    headers = set()
    for number, bag in enumerate(bags):
        tables = tmp_path / f"tables_{number}"
        export_csv(bag, tables)
        with (tables / "answers.csv").open(newline="") as stream:
            names, *rows = csv.reader(stream)
        headers.add(tuple(names))
        plans = read_plans(bag)
        assert {tuple(plan.row()) for plan in plans} == {tuple(names)}
        # Where a body is captured, there is its motion, too.
        columns = {(bool(plan.target_body), tuple(plan.columns())) for plan in plans}
        assert len(columns) == len({captures for captures, _ in columns})
        written = [["" if cell is None else str(cell) for cell in p.row().values()] for p in plans]
        assert rows == written
    (names,) = headers
    # A quantity with a unit has it in its name.
    length, per_second = ("duration", "solve_time", "time_budget"), ("velocity", "start_velocity")
    for name in names:
        assert not name.endswith(length)
        assert not (name.startswith(per_second) and not name.endswith("_per_s"))


def test_a_row_says_what_was_asked_and_what_the_solver_did() -> None:
    told = [(one.request[0], one.answer[0]) for one in answered_exchanges()]
    rows = [plan.row() for plan in read_plans(NODE)]
    for row, (asked, answer) in zip(rows, told, strict=True):
        goal, twist = asked.goal.pose.pose, asked.goal.twist
        assert [row[f"target_{axis}_m"] for axis in "xyz"] == coordinates(goal.position)
        assert [row[f"target_q{axis}"] for axis in "xyz"] == coordinates(goal.orientation)
        velocity = [row[f"target_velocity_{axis}_m_per_s"] for axis in "xyz"]
        assert velocity == coordinates(twist.linear)
        assert row["duration_s"] == asked.duration
        assert row["weight_joint_path_length"] == asked.objective.joint_path_length
        assert row["weight_chaser_attitude"] == asked.objective.chaser_attitude
        assert row["asked_points"] == (asked.search.points or None)
        tried = bool(answer.solver.rollouts)
        assert row["iterations"] == (answer.solver.iterations if tried else None)
        assert row["solve_time_s"] == (answer.solver.solve_time or None)
        points = sum(len(plan.joint_trajectory.points) for plan in answer.plans)
        assert row["points"] == (points or None)
        assert row["end_behaviour"] == (asked.end_behaviour or None)
    assert [row["status"] for row in rows].count("SOLVED") == 5


def test_an_answer_whose_request_is_not_in_the_bag_has_nothing_in_its_place(
    tmp_path: Path,
) -> None:
    (plan,) = read_plans(write(tmp_path / "run", response("a")))
    row = plan.row()
    assert {row[name] for name in ("asked_ns", "target_x_m", "duration_s")} == {None}
    assert row["peak_joint_torques_Nm"] == " ".join(map(repr, plan.metrics["peak_joint_torques"]))


def coordinates(vector: Any) -> list[float]:
    return [vector.x, vector.y, vector.z]


def test_an_npz_file_holds_the_arrays_to_the_last_bit(tmp_path: Path) -> None:
    bag = write(tmp_path / "run", response("run.1"))
    assert main(["export", str(bag), "--npz", str(tmp_path / "plans.npz")]) == 0
    (plan,) = read_plans(bag)
    with np.load(tmp_path / "plans.npz") as arrays:
        assert arrays["run.1/joint_names"].tolist() == ["j0", "j1"]
        assert arrays["run.1/ee_positions"].tolist() == plan.trajectory.ee_positions.tolist()
        assert arrays["run.1/metrics/joint_path_length"] == 1.5
        assert arrays["run.1/start_ns"] == 5 * 10**9


def test_strange_plan_ids_make_harmless_files_that_all_differ(tmp_path: Path) -> None:
    ids = ["../../etc/x", "..", "", "a/b", "a\\b", "A_b", "answers", "ä" * 300]
    bag = write(tmp_path / "run", *map(response, ids))
    export_csv(bag, tmp_path / "deep" / "tables")
    names = {file.name.lower() for file in (tmp_path / "deep" / "tables").iterdir()}
    assert len(names) == 1 + len(ids)  # on any file system
    assert {path.name for path in tmp_path.iterdir()} == {"run", "deep"}


def test_nothing_is_overwritten(tmp_path: Path) -> None:
    bag = write(tmp_path / "run", response("a"))
    (tmp_path / "there").mkdir()
    with pytest.raises(BagError, match="there exists already"):
        export_csv(bag, tmp_path / "there")
    with pytest.raises(BagError, match="there exists already"):
        export_npz(bag, tmp_path / "there")
    with pytest.raises(BagError, match="cannot be written"):
        export_npz(bag, tmp_path / "nowhere" / "plans.npz")
    with pytest.raises(BagError, match="cannot be written"):
        export_csv(bag, bag / "metadata.yaml" / "tables")


def test_a_bag_without_answers_is_not_exported(tmp_path: Path) -> None:
    bag = write(tmp_path / "run")
    with pytest.raises(BagError, match="holds no answer of the planner"):
        export_csv(bag, tmp_path / "tables")
    assert not (tmp_path / "tables").exists()
    assert read_plans(bag) == []
