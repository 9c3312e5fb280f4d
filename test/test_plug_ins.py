"""A requirement that a user brings is planned with, certified, checked, named and recorded."""

from __future__ import annotations

import shutil
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pinocchio as pin
import pytest
import reference_program
import yaml
from changed_parameters import replaced
from core_rows import sensitivity_of
from judging import violations
from recorded_requests import only_request
from robots import CONFIG
from ros_processes import Scene, connected_client, private_domain, running_planner

from ff_planner_ros.cli import main
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import InvalidInput, NoPlanFound, Status
from ff_planner_ros.messages.plans import plan_from_answer
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.motion.joint_motion import joint_motion
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.motion.system_frame import system_frame
from ff_planner_ros.planning.optimisation.free_program import goal_motion
from ff_planner_ros.planning.optimisation.program import path_program
from ff_planner_ros.planning.problem.problem import (
    DurationRange,
    Parametrisation,
    PlanningProblem,
)
from ff_planner_ros.planning.problem.user_requirements import requirements_read
from ff_planner_ros.planning.requirements.requirement import Requirement
from ff_planner_ros.planning.scenario.scenario import load_task
from ff_planner_ros.planning.scenario.scenario_writer import write_scenario
from ff_planner_ros.planning.search.families import path_families
from ff_planner_ros.planning.search.planner import plan
from ff_planner_ros.planning.task.task import PlanningTask, perform, without_search
from ff_planner_ros.runs.replay import Verdict, replay

EXAMPLE = Path(__file__).resolve().parents[1] / "examples" / "keep_out_plane.py"
SETTINGS = load_parameters().planner
# The capture's elbow goes 0.1 m further along -y than it begins.
POINT, NORMAL = [0.0, 0.45, 0.0], [0.0, -1.0, 0.0]
GIVEN = {"keep_out_plane": {"point": POINT, "normal": NORMAL, "distance": 0.0}}


def write_distribution(directory: Path, loads: str = "keep_out_plane:KeepOutPlane") -> Path:
    """Write a distribution that brings the example along, as pip installs it."""
    info = directory / "keep_out_plane-1.0.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: keep-out-plane\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(
        f"[ff_planner_ros.requirements]\nkeep_out_plane = {loads}\n"
    )
    shutil.copy(EXAMPLE, directory)
    return directory


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> type[Any]:
    """The example's requirement, installed."""
    directory = write_distribution(tmp_path / "site")
    monkeypatch.syspath_prepend(directory)
    monkeypatch.setenv("PYTHONPATH", str(directory))
    monkeypatch.delitem(sys.modules, "keep_out_plane", raising=False)
    import keep_out_plane

    kind: type[Any] = keep_out_plane.KeepOutPlane
    return kind


@pytest.fixture
def kept(installed: type[Any], lemur_capture: PlanningProblem) -> PlanningProblem:
    return replace(lemur_capture, requirements=(installed(POINT, NORMAL),))


def least_height(problem: PlanningProblem, found: Plan) -> float:
    """Return how far inside the arm's joints and end effector are at worst, by Pinocchio alone."""
    robot, joints = problem.robot, joint_motion(found.trajectory)
    data, lowest = robot.model.createData(), np.inf
    q = pin.neutral(robot.model)
    for row in joints.at(np.linspace(0.0, joints.time[-1], 2000))[0]:
        q[7:] = row
        pin.framesForwardKinematics(robot.model, data, q)
        places = [data.oMi[joint].translation for joint in range(2, robot.model.njoints)]
        places.append(data.oMf[robot.tip_frame_id].translation)
        lowest = min(lowest, float(((np.array(places) - POINT) @ NORMAL).min()))
    return lowest


@pytest.mark.law("PLAN-30")
@pytest.mark.parametrize("family", [Parametrisation.AUTO, Parametrisation.JOINT_SPLINE])
def test_a_plan_keeps_it_between_the_points_too(
    kept: PlanningProblem, lemur_capture: PlanningProblem, family: Parametrisation
) -> None:
    free = perform(PlanningTask(replace(lemur_capture, parametrisation=family), SETTINGS))
    assert least_height(lemur_capture, free) < -0.01
    found = perform(PlanningTask(replace(kept, parametrisation=family), SETTINGS))
    assert 0.0 <= least_height(kept, found) < 0.05
    assert found.metrics.joint_path_length > free.metrics.joint_path_length
    (note,) = found.notes
    assert "keep_out_plane, which makes it slower" in note
    assert not free.notes


def test_the_digest_covers_it_and_problems_without_one_keep_theirs(
    installed: type[Any], kept: PlanningProblem, lemur_capture: PlanningProblem
) -> None:
    def digest(*requirements: Requirement) -> str:
        return PlanningTask(replace(kept, requirements=requirements), SETTINGS).digest

    assert digest() == PlanningTask(lemur_capture, SETTINGS).digest
    narrower = installed(POINT, NORMAL, 0.01)
    other = type("Other", (installed,), {"name": "keep_in"})(POINT, NORMAL)
    assert len({digest(), digest(*kept.requirements), digest(narrower), digest(other)}) == 4


def test_the_core_asks_for_its_rows_by_the_duration_too(kept: PlanningProblem) -> None:
    lasts = kept.duration
    window = DurationRange(0.8 * lasts, 1.2 * lasts, np.array([0.01, -0.02, 0.005]))
    motion = goal_motion(replace(kept, duration_range=window), lasts)
    for family, *_ in path_families(kept, SETTINGS):
        program = path_program(kept, family.lasting(kept, motion), SETTINGS)
        x = next(iter(family.first_guesses((), 13, 0.0)))
        found, expected = program.linearise(x), reference_program.linearise(program, x)
        assert (found.names == expected.names).all()
        for name in ("constraints", "constraints_jacobian"):
            assert getattr(found, name) == pytest.approx(getattr(expected, name), abs=1e-9), name


def test_its_rows_have_exact_derivatives(kept: PlanningProblem) -> None:
    (required,), rng = kept.requirements, np.random.default_rng(20261124)
    for (family, *_), step in zip(path_families(kept, SETTINGS), (1e-5, 1e-5), strict=True):
        guess = next(iter(family.first_guesses((), 13, 0.0)))
        x, way = guess + rng.normal(scale=0.1 * family.stride), rng.normal(size=len(guess))

        def rows(along: float, family: Any = family, x: Array = x, way: Array = way) -> Any:
            motion = family.motion(x + along * way, 25)
            found = required.rows(kept, motion, sensitivity_of(family, motion), 0.01)
            return found.values, found.jacobian @ way

        (before, _), (_, exact), (after, _) = (rows(along) for along in (-step, 0.0, step))
        assert len(before) == len(exact) == len(after) > 20
        assert np.abs(exact).max() > 1e-3
        assert exact == pytest.approx((after - before) / (2.0 * step), abs=1e-6)


@pytest.mark.law("PLAN-30")
def test_the_check_finds_what_a_search_did_not_keep_and_names_it(
    kept: PlanningProblem, lemur_capture: PlanningProblem
) -> None:
    ignorant = without_search(
        lambda problem, settings: plan(replace(problem, requirements=()), settings)
    )
    with pytest.raises(NoPlanFound, match=r"0\.\d+ m beyond keep_out_plane at t = ") as refused:
        perform(PlanningTask(kept, SETTINGS), method=ignorant)
    assert refused.value.status is Status.LIMIT_VIOLATED
    # The same plan, were there none to keep.
    found = perform(PlanningTask(lemur_capture, SETTINGS))
    assert not violations(lemur_capture, found, SETTINGS)
    assert violations(kept, found, SETTINGS)


def test_a_start_beyond_it_is_refused_at_once(
    installed: type[Any], lemur_capture: PlanningProblem
) -> None:
    beyond = replace(lemur_capture, requirements=(installed([0.0, 0.3, 0.0], NORMAL),))
    with pytest.raises(InvalidInput, match=r"^keep_out_plane is -0\.1"):
        perform(PlanningTask(beyond, SETTINGS))


def test_it_is_seen_from_the_frame_that_plans_are_made_in(lemur_capture: PlanningProblem) -> None:
    seen: list[Any] = []

    @dataclass(frozen=True)
    class Told(Requirement):
        name: ClassVar[str] = "told"

        def seen_from(self, frame: Any) -> Told:
            seen.append(frame)
            return self

    frame = system_frame(lemur_capture.robot, lemur_capture.start)
    frame.problem(replace(lemur_capture, requirements=(Told(),)))
    assert seen == [frame]

    class Loose(Requirement):
        name = "loose"

    with pytest.raises(InvalidInput, match="each must be a dataclass"):
        replace(lemur_capture, requirements=(Loose(),))


@pytest.mark.usefixtures("installed")
def test_a_scenario_holds_it_and_is_read_back_as_the_same_task(
    kept: PlanningProblem, tmp_path: Path
) -> None:
    task = PlanningTask(kept, SETTINGS)
    write_scenario(task, tmp_path / "kept.yaml")
    assert yaml.safe_load((tmp_path / "kept.yaml").read_text())["requirements"] == GIVEN
    assert load_task(tmp_path / "kept.yaml", load_parameters().of_scenarios()).digest == task.digest


@pytest.mark.usefixtures("installed")
@pytest.mark.parametrize(
    ("given", "field", "words"),
    [
        ({"keep_out": {}}, "requirements.keep_out", "no installed distribution has it"),
        ({"keep_out_plane": {"point": POINT}}, "requirements.keep_out_plane.normal", "missing"),
        ({"keep_out_plane": GIVEN["keep_out_plane"] | {"distance": -1.0}}, "distance", "negative"),
        ([], "requirements", "it must hold the values of each requirement, by name"),
    ],
)
def test_what_is_wrong_in_a_scenario_is_refused_by_its_place(
    given: Any, field: str, words: str
) -> None:
    with pytest.raises(InvalidInput, match=words) as refused:
        requirements_read("requirements", given)
    assert field in refused.value.field


def test_what_cannot_be_imported_is_refused_in_words(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(write_distribution(tmp_path / "site", loads="nowhere:Nothing"))
    with pytest.raises(InvalidInput, match=r"nowhere:Nothing: its entry point cannot be loaded"):
        requirements_read("requirements", GIVEN)


def test_two_of_one_name_and_one_of_ours_are_refused(
    installed: type[Any], lemur_capture: PlanningProblem
) -> None:
    one = installed(POINT, NORMAL)
    with pytest.raises(InvalidInput, match="a name of its own"):
        replace(lemur_capture, requirements=(one, one))
    namesake = type("Namesake", (installed,), {"name": "clear_of_obstacles"})(POINT, NORMAL)
    with pytest.raises(InvalidInput, match="a requirement of the planner has this name"):
        perform(PlanningTask(replace(lemur_capture, requirements=(namesake,)), SETTINGS))


@pytest.mark.usefixtures("installed")
def test_the_nodes_parameter_lists_the_plug_ins_that_are_loaded() -> None:
    parameters = load_parameters()
    assert parameters.requirements == ()
    text = yaml.safe_dump(GIVEN)
    (required,) = replaced(parameters, "planner.plugins", text).requirements
    assert required.name == "keep_out_plane"
    assert required.point.tolist() == POINT
    for wrong in ("keep_out_plane", "{", "nothing: {}"):
        with pytest.raises(InvalidInput, match=r"^planner\.plugins"):
            replaced(parameters, "planner.plugins", wrong)


@pytest.mark.usefixtures("installed")
def test_a_bag_holds_it_and_replays_and_says_what_is_not_installed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    scenario = yaml.safe_load((CONFIG / "scenarios" / "lemur_capture.yaml").read_text())
    scenario["robot"]["urdf"] = str(CONFIG / "robots" / "lemur" / "lemur.urdf")
    (tmp_path / "kept.yaml").write_text(yaml.safe_dump(scenario | {"requirements": GIVEN}))
    bag = tmp_path / "bag"
    assert main(["plan", str(tmp_path / "kept.yaml"), "--bag", str(bag)]) == 0
    recorded = only_request(bag)
    assert replay(recorded).verdict is Verdict.IDENTICAL
    digest = recorded.answer.task_digest
    assert recorded.planned_task().digest == digest
    assert digest in capsys.readouterr().out
    # On a machine that lacks it.
    monkeypatch.setattr(sys, "path", [one for one in sys.path if Path(one).name != "site"])
    assert main(["replay", str(bag)]) == 3
    assert "requirements.keep_out_plane is unknown" in capsys.readouterr().out


@pytest.mark.ci
@pytest.mark.usefixtures("installed")
def test_a_node_plans_with_it_and_its_bag_replays(
    kept: PlanningProblem, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    listed = f"keep_out_plane: {{point: {POINT}, normal: {NORMAL}}}"
    with private_domain(), running_planner(tmp_path, "-p", f'planner.plugins:="{listed}"') as node:
        with connected_client() as client:
            client.wait_for_planner()
            client.wait_for_an_answer()
            answer = client.plan(Scene(kept).complete_request())
        assert node.stop() == 0
    assert answer.status.code == Status.SOLVED, answer.status.message
    found = plan_from_answer(answer)
    assert least_height(kept, found) >= 0.0
    assert main(["replay", str(node.bag)]) == 0
    assert "1 identical, 1 not planned" in capsys.readouterr().out
