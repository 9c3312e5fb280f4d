"""The scorer of the data set: apart from the planner, right where the planner is, strict."""

import ast
import inspect
import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import ff_planner_ros.bench.scorer as scorer
from ff_planner_ros.analysis.plan_json import plan_dictionary
from ff_planner_ros.bench import contest, dataset
from ff_planner_ros.bench.scorer.flight import flown, joint_motion, momenta, torques
from ff_planner_ros.bench.scorer.score import load, score
from ff_planner_ros.errors import InvalidInput
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.scenario import load_scenario
from ff_planner_ros.planning.task import PlanningTask, perform

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
                own = name.startswith("ff_planner_ros.bench.scorer")
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


def _nearer(answer, file):
    """Put a sphere of the scenario on the arm's way."""
    content = file.read_text()
    center = content.index("center: [")
    end = content.index("]", center)
    place = answer["ee_positions"][len(answer["time"]) // 2]
    file = file.with_name("nearer.yaml")
    file.write_text(f"{content[:center]}center: {place!r}{content[end + 1 :]}")
    return file


TAMPERED = {
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


def test_an_example_of_a_foreign_method_has_under_a_hundred_lines():
    file = Path(inspect.getfile(contest)).parent / "entrants" / "rrt_connect.py"
    lines = [line for line in file.read_text().splitlines() if line.strip()]
    assert len(lines) < 100


FOREIGN = """
import os


def answer(scenario, seconds):
    if scenario.parent.name == "planar":
        return {"status": "no_plan"}
    if scenario.parent.name == "ordinary":
        raise ValueError("cannot")
    os._exit(1)
"""


def test_a_foreign_method_is_a_file_that_may_refuse_raise_or_die(plans, tmp_path):
    directory, file = plans["planar"][0].parents[2], tmp_path / "foreign.py"
    file.write_text(FOREIGN)
    which = [(kind, 0) for kind in ("planar", "ordinary", "bodies")]
    done = contest._in_turn(directory, 5.0, (str(file), which))
    assert [one.score.faults for one in done] == [
        ("no plan: no_plan",),
        ("ValueError: cannot",),
        ("the process ended: exit code 1",),
    ]
    assert [row[3] for row in contest.rows(done)] == ["0.0%"] * 4


def test_a_foreign_method_may_be_a_command_line(plans, tmp_path):
    file, _, answer = plans["planar"]
    (tmp_path / "kept.json").write_text(json.dumps(answer))
    given = contest._by_command(f"cp {tmp_path / 'kept.json'} {{answer}} {{scenario}}x", file, 9.0)
    assert given["status"] == "no answer"  # cp has two sources, and the last is no directory
    assert given["message"].startswith("exit code 1: cp: ")
    (tmp_path / "run.sh").write_text(f"cp {tmp_path / 'kept.json'} $2\n")
    given = contest._by_command(f"sh {tmp_path / 'run.sh'} {{scenario}} {{answer}}", file, 9.0)
    assert score(file, given).solved


def test_a_method_that_is_not_known_is_refused_by_name(tmp_path):
    with pytest.raises(InvalidInput, match=r"not_there\.py"):
        list(contest.results([str(tmp_path / "not_there.py")], tmp_path, 1, 1.0, 1))
