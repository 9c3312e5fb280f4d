"""The scorer of the data set: apart from the planner, right where the planner is, strict."""

import ast
import inspect
import json
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

import ff_planner_benchmark.scorer as scorer
from ff_planner_benchmark import contest, contest_results, dataset, method_process
from ff_planner_benchmark.own_copy import own_copy
from ff_planner_benchmark.scorer.clearance import _between, clearance
from ff_planner_benchmark.scorer.flight import flown, joint_motion, momenta, torques
from ff_planner_benchmark.scorer.score import Score, load, score
from ff_planner_ros.analysis.plan_json import plan_dictionary
from ff_planner_ros.errors import InvalidInput
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.scenario.scenario import load_scenario
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.robot.state import SystemState

KINDS = ("planar", "ordinary", "bodies", "tumbling")


@pytest.fixture(scope="module")
def plans(tmp_path_factory):
    """Scenario files, with our plans of them and their answers."""
    directory = tmp_path_factory.mktemp("scorer") / "new"
    dataset.write_dataset(directory, 0, 1)
    found = {}
    for kind in KINDS:
        file = directory / "scenarios" / kind / "0000.yaml"
        task = PlanningTask(load_scenario(file), load_parameters().planner)
        plan = perform(task)
        found[kind] = file, plan, json.loads(json.dumps(plan_dictionary(plan, task, 0.0)))
    return found


def test_the_scorer_imports_nothing_of_the_planner():
    allowed = {"__future__", "collections", "dataclasses", "json", "pathlib", "typing", "xml"}
    allowed |= {"numpy", "scipy", "yaml", "coal"}
    for file in Path(inspect.getfile(scorer)).parent.glob("*.py"):
        for node in ast.walk(ast.parse(file.read_text())):
            names = [node.module] if isinstance(node, ast.ImportFrom) else []
            names += [one.name for one in node.names] if isinstance(node, ast.Import) else []
            for name in names:
                own = name.startswith("ff_planner_benchmark.scorer")
                assert own or name.split(".")[0] in allowed, f"{file.name} imports {name}"


@pytest.mark.parametrize("kind", KINDS)
def test_the_scorer_sees_the_motion_that_the_planner_foresaw(plans, kind):
    file, plan, answer = plans[kind]
    judged, motion = score(file, answer), plan.trajectory
    content, chain, _ = load(file)
    flight = flown(chain, content, joint_motion(answer))
    at = np.searchsorted(flight.times, motion.time[-1])
    chaser = flight.base.position[at] + flight.base.rotation[at] @ chain.center
    assert judged.solved, judged
    assert np.abs(chaser - motion.chaser_positions[-1]).max() < 1e-5
    turned = Rotation.from_matrix(flight.base.rotation[at])
    planned = Rotation.from_quat(motion.chaser_quaternions_xyzw[-1])
    assert (turned * planned.inv()).magnitude() < 1e-5
    assert judged.clearance > plan.metrics.min_clearance - 1e-5
    assert judged.miss < 1e-4


def test_momentum_in_the_scorers_flight_is_conserved(plans):
    file, _, answer = plans["tumbling"]
    content, chain, _ = load(file)
    flight = flown(chain, content, joint_motion(answer))
    of_base, of_joints = momenta(chain, flight.posture)
    own = np.einsum("tji,tkj->tki", flight.base.rotation, flight.twists.reshape(-1, 2, 3))
    held = (of_base @ own.reshape(-1, 6, 1) + of_joints @ flight.rates[..., None])[..., 0]
    linear, angular = (
        np.einsum("tij,tj->ti", flight.base.rotation, part) for part in np.split(held, 2, axis=1)
    )
    about_origin = angular + np.cross(flight.base.position, linear)
    assert np.abs(linear - linear[0]).max() < 1e-9 * np.abs(held).max()
    assert np.abs(about_origin - about_origin[0]).max() < 1e-9 * np.abs(held).max()
    # The pose is what the twists make it: differences of the positions
    moved = np.gradient(flight.base.position, flight.times, axis=0, edge_order=2)
    assert np.abs(moved - flight.twists[:, :3])[2:-2].max() < 1e-5


def test_torques_of_the_scorer_are_those_of_the_plan(plans):
    file, plan, answer = plans["ordinary"]
    content, chain, _ = load(file)
    flight = flown(chain, content, joint_motion(answer))
    found = [np.interp(plan.trajectory.time, flight.times, one) for one in torques(chain, flight).T]
    planned = plan.trajectory.joint_torques
    assert np.abs(np.array(found).T - planned)[1:-1].max() < 0.01 * np.abs(planned).max()


def _random_motion(chain, content, seed):
    """Return rows of a motion that begins in the start state and goes nowhere in particular."""
    rng, joints = np.random.default_rng(seed), content["joints"]
    time = np.linspace(0.0, content["duration"], 6)
    angles = joints["position"] + np.cumsum(0.2 * rng.normal(size=(6, chain.joints)), axis=0)
    angles[0] = joints["position"]
    spline = CubicSpline(
        time, angles, bc_type=((1, joints["velocity"]), (1, np.zeros(chain.joints)))
    )
    fine = np.linspace(0.0, content["duration"], 100)
    rows = {"joint_positions": spline(fine), "joint_velocities": spline(fine, 1)}
    return {"time": fine.tolist()} | {name: value.tolist() for name, value in rows.items()}


@pytest.mark.parametrize("kind", ["bodies", "high_momentum"])
def test_mujoco_sees_a_random_flight_of_the_scorer_keep_momentum_under_its_torques(plans, kind):
    mujoco = pytest.importorskip("ff_planner_ros.simulation.engine")
    file = plans["planar"][0].parents[1] / kind / "0000.yaml"
    content, chain, _ = load(file)
    flight = flown(chain, content, joint_motion(_random_motion(chain, content, 18)))
    engine, drives, momentum = mujoco.Engine(load_scenario(file).robot), torques(chain, flight), []
    base = flight.base
    tip, tip_twists = flight.of(flight.posture.links[chain.tip]), flight.twist_at(chain.tip, chain)
    # By what a value changes, from five moments
    slope = np.array([1.0, -8.0, 0.0, 8.0, -1.0]) / (12.0 * flight.times[1])
    for at in range(2, 999, 71):
        lever = base.rotation[at] @ chain.center
        state = engine.state(
            SystemState(
                position_chaser_in_inertial=base.position[at] + lever,
                quaternion_chaser_to_inertial_xyzw=Rotation.from_matrix(
                    base.rotation[at]
                ).as_quat(),
                linear_velocity_chaser_in_inertial=flight.twists[at, :3]
                + np.cross(flight.twists[at, 3:], lever),
                angular_velocity_chaser_in_inertial=flight.twists[at, 3:],
                joint_positions=flight.angles[at],
                joint_velocities=flight.rates[at],
            )
        )
        seen = engine.observe(state)
        momentum.append(seen.momentum)
        assert np.abs(seen.ee_position - tip.position[at]).max() < 1e-9
        assert np.abs(seen.ee_twist - tip_twists[at]).max() < 1e-9
        change = engine.derivative(state, drives[at])
        around = slice(at - 2, at + 3)
        assert np.abs(change[:3] - slope @ base.position[around]).max() < 1e-7
        _, accelerations = engine.joints(change)
        assert np.abs(accelerations - slope @ flight.rates[around]).max() < 1e-3
    assert np.ptp(momentum, axis=0).max() < 1e-8 * np.abs(momentum).max()


def _nearer(answer, file):
    """Put a sphere of the scenario on the arm's way."""
    content = file.read_text()
    center = content.index("center: [")
    end = content.index("]", center)
    place = answer["ee_positions"][len(answer["time"]) // 2]
    file = file.with_name("nearer.yaml")
    file.write_text(f"{content[:center]}center: {place!r}{content[end + 1 :]}")
    return file


def _between_points(answer, turns, seconds):
    """Insert points at which a joint is elsewhere, so soon one after the other."""
    time = answer["time"][20]
    del answer["joint_accelerations"]
    for number, turn in enumerate(turns, 1):
        answer["time"].insert(20 + number, time + number * seconds)
        for name in ("joint_positions", "joint_velocities"):
            answer[name].insert(20 + number, list(answer[name][20]))
        answer["joint_positions"][20 + number][0] += turn


def _staircase(answer):
    """Stand still at points that the moments hit, and hurry between them."""
    motion, time = joint_motion(answer), np.linspace(0.0, answer["time"][-1], 1001)
    del answer["joint_accelerations"]
    still = np.zeros((1001, len(answer["joint_names"])))
    still[0] = answer["joint_velocities"][0]
    answer["time"], answer["joint_velocities"] = time.tolist(), still.tolist()
    answer["joint_positions"] = motion(time).tolist()


def _unsorted(answer):
    answer["time"][4], answer["time"][5] = answer["time"][5], answer["time"][4]


TAMPERED = {
    "between moments that do not show it": lambda a: _between_points(a, [0.3, 0.0], 1e-3),
    "times its largest rate": lambda a: _between_points(a, [0.5], 1e-5),
    "belong to the positions": _staircase,
    "time: not increasing": _unsorted,
    "misses by": lambda a: a["joint_positions"][-1].__setitem__(
        0, a["joint_positions"][-1][0] + 0.01
    ),
    "passes at": lambda a: a["joint_velocities"][-1].__setitem__(0, 0.05),
    "first positions": lambda a: a["joint_positions"][0].__setitem__(1, 0.3),
    "first rates": lambda a: a["joint_velocities"][0].__setitem__(1, 0.3),
    "largest rate": lambda a: a["joint_velocities"][20].__setitem__(2, 1.3),
    "leaves its range": lambda a: a["joint_positions"][20].__setitem__(2, 9.0),
    "largest torque": lambda a: a["joint_accelerations"][20].__setitem__(0, 60.0),
    "joint_positions": lambda a: a["joint_positions"].pop(),
    "joint_velocities": lambda a: a["joint_velocities"][3].__setitem__(0, float("nan")),
    "not readable": lambda a: a.pop("time"),
    "from 0 on": lambda a: a["time"].__setitem__(0, 0.1),
    "not increasing": lambda a: a["time"].__setitem__(5, a["time"][4]),
    "not finite": lambda a: a["joint_positions"][3].__setitem__(0, 1e300),
    "is missing": lambda a: a.pop("joint_velocities"),
    "up to the duration": lambda a: a["time"].__setitem__(-1, a["time"][-1] - 0.01),
    "joint_names": lambda a: a["joint_names"].reverse(),
    "no plan": lambda a: a.__setitem__("status", "no_plan_found"),
}


@pytest.mark.parametrize("fault", TAMPERED)
def test_an_answer_that_was_tampered_with_is_found_out(plans, fault):
    file, _, answer = plans["ordinary"]
    answer = json.loads(json.dumps(answer))
    TAMPERED[fault](answer)
    judged = score(file, answer)
    assert not judged.solved
    assert any(fault in told for told in judged.faults), judged


def test_a_motion_with_few_points_and_jumping_accelerations_is_no_fault_by_itself(plans):
    file = plans["ordinary"][0]
    content, *_ = load(file)
    begin, rate = (np.array(content["joints"][name]) for name in ("position", "velocity"))
    half, push = content["duration"] / 2, 0.01  # [rad/s^2], then as much the other way
    turns = [0.0, rate * half + push * half**2 / 2, 2.0 * rate * half + push * half**2]
    answer = {
        "time": [0.0, half, 2.0 * half],
        "joint_positions": [(begin + turn).tolist() for turn in turns],
        "joint_velocities": [(rate + more).tolist() for more in (0.0, push * half, 0.0)],
    }
    judged = score(file, answer)
    assert all("the end effector" in told or "clearance" in told for told in judged.faults), judged
    times = np.linspace(0.0, half, 1001)
    speeds = np.linalg.norm(rate + push * times[:, None], axis=1)
    assert judged.joint_path == pytest.approx(2.0 * np.trapezoid(speeds, times), rel=1e-4)


@pytest.mark.parametrize("kind", ["ordinary", "bodies"])
def test_a_sphere_on_the_way_is_hit_with_lines_and_with_shapes(plans, kind):
    file, _, answer = plans[kind]
    judged = score(_nearer(answer, file), answer)
    assert judged.clearance < -0.01
    assert any("clearance" in told for told in judged.faults), judged


@pytest.mark.parametrize("answer", [None, [], "solved", {}, {"time": "now"}, {"time": [[0.0]]}])
def test_what_is_no_answer_is_a_fault_and_no_error(plans, answer):
    judged = score(plans["planar"][0], answer)
    assert not judged.solved
    assert judged.faults


@pytest.mark.ci
def test_the_certified_clearance_of_bodies_is_a_bound_and_near_to_what_many_moments_show(tmp_path):
    (tmp_path / "scenarios" / "bodies").mkdir(parents=True)
    (tmp_path / "robots").mkdir()
    # Two bodies pass each other fast here, 1.5 mm apart
    name, (urdf, pairs) = dataset._write(tmp_path, 0, ("bodies", 7))
    (tmp_path / "robots" / f"{name}.urdf").write_text(urdf)
    file = tmp_path / "scenarios" / "bodies" / "0007.yaml"
    plan = perform(PlanningTask(load_scenario(file), load_parameters().planner)).trajectory
    names = ("time", "joint_positions", "joint_velocities", "joint_accelerations")
    motion = joint_motion({name: getattr(plan, name) for name in names})
    content, chain, _ = load(file)
    truth, _ = clearance(chain, content, flown(chain, content, motion, 3000), pairs)
    sampled, certified = clearance(chain, content, flown(chain, content, motion), pairs)
    assert certified <= truth <= sampled + 1e-9
    assert truth - certified < 5e-4


def test_an_example_of_a_foreign_method_has_under_a_hundred_lines():
    file = Path(inspect.getfile(contest)).parent / "entrants" / "rrt_connect.py"
    lines = [line for line in file.read_text().splitlines() if line.strip()]
    assert len(lines) < 100


FOREIGN = """
from __future__ import annotations

import os
from dataclasses import dataclass

from beside import CANNOT


@dataclass
class Found:
    angles: list[float]


def answer(scenario, seconds):
    if scenario.parent.name == "planar":
        return {"status": "no_plan"}
    if scenario.parent.name == "ordinary":
        raise ValueError(CANNOT)
    os._exit(1)
"""


def test_a_foreign_method_is_a_file_that_may_refuse_raise_or_die(plans, tmp_path):
    directory, file = plans["planar"][0].parents[2], tmp_path / "foreign.py"
    file.write_text(FOREIGN)
    (tmp_path / "beside.py").write_text("CANNOT = 'cannot'\n")
    copies = [own_copy(directory, kind, 0) for kind in ("planar", "ordinary", "bodies")]
    done = contest._judged_in_turn(5.0, (str(file), copies))
    assert [one.score.faults for one in done] == [
        ("no plan: no_plan",),
        ("ValueError: cannot",),
        ("the process ended: exit code 1",),
    ]
    assert [row[3] for row in contest_results.rows(done)] == ["0.0%"] * 4


def test_a_run_that_was_stopped_goes_on_with_what_its_file_has(tmp_path):
    file = tmp_path / "foreign.py"
    file.write_text("def answer(scenario, seconds):\n    raise AssertionError\n")
    done = [
        contest_results.Result(str(file), kind, 0, 0.5, Score(kind == "planar", ("missed",), 0.01))
        for kind in dataset.CLASSES
    ]
    kept = contest_results.Kept(tmp_path / "answers.json", "hash", 5.0)
    assert kept.read() == []
    kept.write(done[:3])
    kept.write(done)
    assert kept.read() == done
    assert list(contest.results([str(file)], tmp_path, 1, 5.0, 1, kept.read())) == []
    for other in (
        contest_results.Kept(kept.file, "other", 5.0),
        contest_results.Kept(kept.file, "hash", 4.0),
    ):
        with pytest.raises(InvalidInput, match="does not hold answers with"):
            other.read()


def test_why_answers_do_not_count_is_told_once_for_each_reason():
    def missed(kind, *faults):
        return contest_results.Result("mine", kind, 3, 0.1, Score(not faults, faults))

    done = [missed("planar"), missed("ordinary", "late by 3.1e-02 s", "hit")]
    done += [missed("bodies", "hit"), missed("bodies", "late by 4 s")]
    late = ("mine", "2", "ordinary/0003", "late by 3.1e-02 s")
    assert list(contest_results.reasons(done, 2)) == [late, ("mine", "2", "ordinary/0003", "hit")]
    rest = ("mine", "", "", "and 1 more, which --json FILE has")
    assert list(contest_results.reasons(done, 1)) == [late, rest]


UNFIT = {
    "no_answer.py": ("x = 1", "it must have a function answer"),
    "dies.py": ("import os; os._exit(3)", "the process ended"),
}


@pytest.mark.parametrize("name", UNFIT)
def test_a_file_that_is_no_method_is_refused_before_anything_is_planned(tmp_path, name):
    content, reason = UNFIT[name]
    (tmp_path / name).write_text(content)
    with pytest.raises(InvalidInput, match=f"{name}: .*{reason}"):
        list(contest.results([str(tmp_path / name)], tmp_path, 1, 1.0, 1))


def test_a_foreign_method_may_be_a_command_line(plans, tmp_path):
    by_command, (file, _, answer) = method_process._by_command, plans["planar"]
    (tmp_path / "kept.json").write_text(json.dumps(answer))
    given = by_command(f"cp {tmp_path / 'kept.json'} {{answer}} {{scenario}}x", file, 9.0)
    assert given["status"] == "no answer"  # cp has two sources, and the last is no directory
    assert given["message"].startswith("exit code 1: cp: ")
    (tmp_path / "run.sh").write_text(f"cp {tmp_path / 'kept.json'} $2\n")
    given = by_command(f"sh {tmp_path / 'run.sh'} {{scenario}} {{answer}}", file, 9.0)
    assert score(file, given).solved


def test_a_method_that_is_not_known_is_refused_by_name(tmp_path):
    with pytest.raises(InvalidInput, match=r"not_there\.py"):
        list(contest.results([str(tmp_path / "not_there.py")], tmp_path, 1, 1.0, 1))


@pytest.mark.parametrize("end", np.linspace(0.01, 0.3, 30))
def test_a_box_that_passes_through_a_point_between_two_moments_is_as_deep_as_it_gets(end):
    """From one side to the other, outside at both ends or not, beside moments of rest."""
    half, fine = 0.1, np.linspace(-end, end, 1001)
    places = np.array([end, end, -end, -end])
    corners = half * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    seen = corners + places[:, None, None] * np.array([1.0, 0.0, 0.0])
    least, bound = _between(np.abs(places) - half, seen, radius=0.02)
    deepest = (np.abs(fine) - half).min() - 0.02
    assert least == pytest.approx(end - half - 0.02)
    assert bound <= deepest + 1e-12
