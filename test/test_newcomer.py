"""What a newcomer meets in a notebook: every public name, with what people give and ask.

The laws go over all public names and their parameters, so that a new one is tried as well.
"""

from __future__ import annotations

import copy
import inspect
import pickle
import pydoc
import warnings
from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass, replace
from enum import Enum
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import robots

import ff_planner_ros as ff
from ff_planner_ros import errors
from ff_planner_ros.bag import read_plans
from ff_planner_ros.planning.task.task import PlanningTask
from ff_planner_ros.robot.collision.bodies import Body

SCENARIOS = robots.CONFIG / "scenarios"
BAG = Path(__file__).parent / "golden_bags" / "node"
NO_TURN = [0.0, 0.0, 0.0, 1.0]
NOTHING = [0.0, 0.0, 0.0]
# What the docs name as public, by its name there.
PUBLIC: dict[str, Any] = {name: getattr(ff, name) for name in ff.__all__}
PUBLIC["bag.read_plans"] = read_plans
# Made by the others, not by a user's arguments.
RESULTS = {"Robot", "Plan", "Trajectory", "Metrics", "Verification"}
ERRORS = {"FfPlannerError", "InvalidInput", "NoPlanFound"}
CHOICES = {name for name, one in PUBLIC.items() if isinstance(one, type) and issubclass(one, Enum)}
# Objects of the program's own, not of a user's.
NOT_TRIED = {("perform", "watch"), ("perform", "method")}
SLOW = {"perform", "plot_plan", "simulate_plan"}  # where an argument is allowed


@cache
def problem(name: str = "lemur_capture") -> ff.PlanningProblem:
    return ff.load_scenario(SCENARIOS / f"{name}.yaml")


@cache
def task(name: str = "lemur_capture") -> PlanningTask:
    return ff.load_task(SCENARIOS / f"{name}.yaml", ff.Defaults(ff.load_parameters().planner))


@cache
def plan(name: str = "lemur_capture") -> ff.Plan:
    return ff.perform(task(name))


@cache
def arguments() -> dict[str, dict[str, Any]]:
    """Return arguments with which each public name can be called: at least the required ones."""
    the_robot, capture, settings = (
        problem().robot,
        SCENARIOS / "lemur_capture.yaml",
        task().settings,
    )
    body, start = problem("lemur_tumbling").target_body, problem().start
    return {
        "load_scenario": {"path": capture},
        "load_task": {"path": capture, "defaults": ff.Defaults(settings)},
        "load_parameters": {"path": robots.CONFIG / "planner.yaml"},
        "load_robot": {
            "urdf": robots.LEMUR_URDF,
            "base_link": "chaser",
            "tip_link": "end_effector",
            "srdf": None,
        },
        "share_directory": {},
        "bag.read_plans": {"bag": BAG},
        "perform": {"task": task()},
        "simulate_plan": {"robot": the_robot, "trajectory": plan().trajectory},
        "plot_plan": {"problem": problem(), "plan": plan(), "directory": "plots"},
        "with_capture_target": {"body": body, "problem": problem()},
        "Defaults": {"settings": settings},
        "PlanningTask": {"problem": problem(), "settings": settings},
        "PlanningProblem": {
            name: getattr(problem(), name)
            for name in ("robot", "start", "target", "duration", "points", "obstacles", "objective")
        },
        "PlannerSettings": {item.name: getattr(settings, item.name) for item in fields(settings)},
        "SystemState": {item.name: getattr(start, item.name) for item in fields(start)[:6]},
        "Target": {"position": [1.7, 0.4, 0.6], "quaternion_xyzw": NO_TURN},
        "TargetBody": {
            "position": [2.0, 0.0, 0.0],
            "quaternion_xyzw": NO_TURN,
            "inertia": np.diag([1.0, 2.0, 2.0]),
            "grasp_position": [-1.0, 0.0, 0.0],
            "grasp_quaternion_xyzw": NO_TURN,
        },
        "Obstacle": {
            "id": "a",
            "shape": ff.Solid("sphere", [0.1]),
            "motion": ff.RigidMotion([2.0, 0.0, 0.0]),
        },
        "RigidMotion": {"position": NOTHING},
        "AttachedObstacle": {"id": "a", "shape": ff.Solid("box", [1, 2, 3]), "position": NOTHING},
        "Solid": {"kind": "box", "sizes": [1.0, 2.0, 3.0]},
        "Objective": {"joint_path_length": 1.0, "chaser_attitude": 0.0},
        "Limits": {},
        "DurationRange": {"minimum": 5.0, "maximum": 10.0},
        "Approach": {"direction": [0.0, 0.0, 1.0], "distance": 0.1},
        "Camera": {
            "link": "end_effector",
            "position": NOTHING,
            "axis": [0.0, 0.0, 1.0],
            "half_angle": 0.5,
        },
    }


def parameters() -> Iterator[tuple[str, inspect.Parameter]]:
    for name in sorted(PUBLIC.keys() - RESULTS - ERRORS - CHOICES):
        for parameter in inspect.signature(PUBLIC[name]).parameters.values():
            if (name, parameter.name) not in NOT_TRIED:
                yield name, parameter


EVERY = list(parameters())
every_parameter = pytest.mark.parametrize(
    ("name", "parameter"), EVERY, ids=[f"{name}-{one.name}" for name, one in EVERY]
)


def annotated(word: str) -> pytest.MarkDecorator:
    found = [(name, one.name) for name, one in EVERY if word in str(one.annotation)]
    assert found
    return pytest.mark.parametrize(("name", "parameter"), found, ids=map("-".join, found))


def called(name: str, **changes: Any) -> Any:
    return PUBLIC[name](**{**arguments()[name], **changes})


def require_readable(error: ff.FfPlannerError) -> None:
    text = str(error)
    assert len(text) < 1000
    assert "\n" not in text
    if isinstance(error, ff.InvalidInput):
        assert text.startswith(f"{' '.join(error.field.split())} is "[:100])
        assert error.allowed


def test_every_public_name_is_tried() -> None:
    assert PUBLIC.keys() == arguments().keys() | RESULTS | ERRORS | CHOICES


@every_parameter
def test_a_value_of_another_kind_is_refused_by_name(
    name: str, parameter: inspect.Parameter
) -> None:
    wrong = object()
    with pytest.raises(ff.InvalidInput) as refused:
        called(name, **{parameter.name: wrong})
    require_readable(refused.value)
    assert "<object object" in str(refused.value)


# Some are allowed somewhere; what is not is refused in the one form.
MAYBE = {
    "text": "nonsense",
    "empty text": "",
    "bytes": b"nonsense",
    "none": None,
    "not a number": float("nan"),
    "infinite": float("inf"),
    "negative": -1.0,
    "enormous": 10**400,
    "complex": 1.0 + 2.0j,
    "true": True,
    "no entries": [],
    "a mapping": {"a": 1.0},
    "a set": {1.0, 2.0, 3.0},
    "texts": ["a", "b", "c"],
    "nones": [None, None, None],
    "with a hole": [1.0, float("nan"), 3.0],
    "of two lengths": [[1.0, 2.0], [3.0]],
    "a column": np.ones((3, 1)),
    "a cube": np.ones((3, 3, 3)),
    "an array of objects": np.array([object(), object(), object()]),
    "an array of text": np.array(["a", "b", "c"]),
    "a function": len,
    "a class": ff.Target,
    "an array of one": np.array(1.0),
    "complex numbers": np.array([1.0 + 2.0j, 0.0, 0.0]),
}


@pytest.mark.parametrize("wrong", MAYBE.values(), ids=MAYBE)
def test_no_value_ends_in_another_error(wrong: Any) -> None:
    for name, parameter in EVERY:
        if name in SLOW and parameter.name == "directory":
            continue
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            try:
                called(name, **{parameter.name: wrong})
            except ff.FfPlannerError as error:
                require_readable(error)


@annotated("Array")
def test_a_vector_may_be_a_list_a_tuple_or_an_array_of_any_numbers(
    name: str, parameter: str
) -> None:
    if (given := arguments()[name].get(parameter)) is None:
        given = np.zeros(7)
        if name != "SystemState":
            given = NO_TURN if "quaternion" in parameter else [0.0, 0.0, 1.0]
    more = {"orientation": "about_axis"} if parameter == "free_axis_in_ee" else {}
    if parameter == "corners":
        given, more = np.vstack([np.eye(3), -np.eye(3)]), {"kind": "mesh", "sizes": []}
    values = np.array(given)
    wanted = getattr(called(name, **more, **{parameter: values}), parameter)
    assert not wanted.flags.writeable
    ways = [values.tolist(), tuple(values.tolist()), list(values)]
    if (values == np.rint(values)).all():
        ways += [values.astype(int), values.astype(int).tolist(), values.astype(np.float32)]
    for way in ways:
        found = getattr(called(name, **more, **{parameter: way}), parameter)
        np.testing.assert_array_equal(found, wanted)


@pytest.mark.parametrize("number", [np.float32(8.0), np.int64(8), 8])
def test_a_number_may_be_one_of_numpy(number: Any) -> None:
    assert called("PlanningProblem", duration=number, points=np.int64(8)).duration == 8.0


@pytest.mark.parametrize(
    ("name", "field", "word"),
    [
        ("PlanningProblem", "parametrisation", "joint_spline"),
        ("PlanningTask", "end_behaviour", "stop_joints"),
        ("Target", "orientation", "free"),
        ("load_robot", "base", "attitude_held"),
        ("load_robot", "geometry", "lines"),
        ("PlannerSettings", "search", "quick"),
        ("Defaults", "end_behaviour", "none"),
    ],
)
def test_a_choice_may_be_given_by_its_word(name: str, field: str, word: str) -> None:
    more = {"tail": 1.0} if field == "end_behaviour" else {}
    found = getattr(called(name, **more, **{field: word}), field)
    assert found == word
    assert isinstance(found, Enum)


# ---- paths


class OwnPath:
    """A path of another library."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def __fspath__(self) -> str:
        return str(self._path)


GOOD = {
    "load_scenario": SCENARIOS / "lemur_capture.yaml",
    "load_task": SCENARIOS / "lemur_capture.yaml",
    "load_parameters": robots.CONFIG / "planner.yaml",
    "load_robot": robots.LEMUR_URDF,
    "bag.read_plans": BAG,
}


def facts(loaded: Any) -> Any:
    return [repr(one) for one in loaded] if isinstance(loaded, list) else repr(loaded)


@pytest.mark.sampled
@annotated("AnyPath")
def test_a_path_may_be_text_or_any_path(
    name: str, parameter: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "pictures" if name == "plot_plan" else GOOD[name]
    if parameter == "srdf":
        path = tmp_path / "links.srdf"
        path.write_text('<robot name="lemur"/>')
    monkeypatch.setenv("HOME", str(path.parent))
    ways = [f"~/{path.name}", Path("~") / path.name, path, str(path), OwnPath(path)]
    if name == "plot_plan":  # which takes long
        called(name, **{parameter: ways[0]})
        assert (path / "scene.html").is_file()
        return
    assert len({str(facts(called(name, **{parameter: given}))) for given in ways}) == 1


@annotated("AnyPath")
@pytest.mark.parametrize("kind", ["missing", "directory", "empty", "binary", "of nobody"])
def test_a_path_to_nothing_of_use_is_refused_with_the_path(
    name: str, parameter: str, kind: str, tmp_path: Path
) -> None:
    path = tmp_path / "given"
    if kind == "directory":
        path.mkdir()
    elif kind in ("empty", "binary"):
        path.write_bytes(bytes(range(256)) if kind == "binary" else b"")
    if name == "plot_plan" and kind in ("missing", "directory"):
        return  # it makes what is missing
    given = "~nobody_of_this_name/given" if kind == "of nobody" else str(path)
    with pytest.raises(ff.FfPlannerError) as refused:
        called(name, **{parameter: given})
    require_readable(refused.value)
    assert given in str(refused.value)


# ---- what is shown


def test_completion_and_help_have_every_public_name_and_nothing_else() -> None:
    assert {name for name in dir(ff) if not name.startswith("_")} == set(ff.__all__)
    told = pydoc.render_doc(ff, renderer=pydoc.plaintext)
    assert not [name for name in ff.__all__ if name not in told]


@pytest.mark.parametrize("name", ff.__all__)
def test_help_says_in_its_first_lines_what_a_name_is(name: str) -> None:
    told = pydoc.render_doc(PUBLIC[name], renderer=pydoc.plaintext)
    assert inspect.getdoc(PUBLIC[name]).splitlines()[0] in told
    assert not [line for line in told.splitlines() if len(line) > 3000]


def held(value: Any, place: str = "") -> Iterator[tuple[str, Any]]:
    """Yield an object of ours, and all others that it holds."""
    if is_dataclass(value) and not isinstance(value, type):
        yield place, value
        for item in fields(value):
            yield from held(getattr(value, item.name), f"{place}.{item.name}")
    elif isinstance(value, list | tuple):
        for index, one in enumerate(value):
            yield from held(one, f"{place}[{index}]")


MADE: dict[str, Callable[[], Any]] = {
    "a problem": problem,
    "a problem with bodies": lambda: problem("lemur_capture_bodies"),
    "a capture": lambda: problem("lemur_tumbling"),
    "a problem with wheels": lambda: problem("lemur_wheels"),
    "a problem on a rail": lambda: problem("rail_capture"),
    "a payload": lambda: problem("lemur_payload"),
    "a posture": lambda: problem("stow"),
    "a name of two lines": lambda: replace(
        problem(), obstacles=[called("Obstacle", id="one\ntwo")]
    ),
    "a task": task,
    "a task of phases": lambda: task("whole_capture"),
    "a plan": plan,
    "a plan of phases": lambda: plan("whole_capture"),
    "parameters": ff.load_parameters,
    "answers of a bag": lambda: read_plans(BAG),
    "defaults": lambda: ff.Defaults(task().settings),
    "a hull": lambda: ff.Solid("mesh", corners=np.random.default_rng(1).normal(size=(40, 3))),
    **{
        name: lambda name=name: called(name)
        for name in arguments()
        if isinstance(PUBLIC[name], type)
    },
}
# Flat, but long: the ids of a study's cases are made of them.
IN_FULL = ("PlannerSettings", "Defaults", "ControllerParameters")


@pytest.mark.parametrize("made", MADE.values(), ids=MADE)
def test_an_object_is_shown_in_a_line(made: Callable[[], Any]) -> None:
    for place, one in held(made()):
        text = repr(one)
        kind = type(one).__name__
        assert text.startswith(kind), place
        assert "\n" not in text, place
        assert " at 0x" not in text, place
        assert len(text) <= (1000 if kind in IN_FULL else 330), place


def test_the_line_has_the_main_facts() -> None:
    assert repr(problem()) == (
        "PlanningProblem(robot=Robot(joints=7, base_link='chaser', tip_link='end_effector'), "
        "duration=10, points=50, obstacles=[c1, c2, c3], target=Target(position=[1.7, 0.4, 0.6], "
        "quaternion_xyzw=[0.0627921, 0.677764, -0.181849, 0.709665]))"
    )
    motion = "Trajectory(time=50 numbers, 0 to 10, joint_positions=50 x 7 numbers)"
    assert motion in repr(plan())
    length = plan().metrics.joint_path_length
    assert f"Metrics(joint_path_length={length:.6g}, " in repr(plan())
    assert repr(called("Obstacle")) == (
        "Obstacle(id='a', shape=Solid(kind='sphere', sizes=[0.1]), "
        "motion=RigidMotion(position=[2, 0, 0]))"
    )


# ---- what is kept


def same(one: Any, other: Any, place: str = "") -> None:
    """Require two objects to be equal, to the last bit."""
    assert type(one) is type(other), place
    if is_dataclass(one) and not isinstance(one, Body):
        for item in fields(one):
            same(getattr(one, item.name), getattr(other, item.name), f"{place}.{item.name}")
    elif isinstance(one, np.ndarray):
        assert one.tobytes() == other.tobytes(), place
        assert one.shape == other.shape, place
    elif isinstance(one, list | tuple):
        assert len(one) == len(other), place
        for index, pair in enumerate(zip(one, other, strict=True)):
            same(*pair, f"{place}[{index}]")
    elif isinstance(one, dict):
        same(list(one.items()), list(other.items()), place)
    elif isinstance(one, Body):
        assert repr(one) == repr(other), place
    else:
        assert one == other or one != one, place  # NaN


@pytest.mark.parametrize("again", [lambda x: pickle.loads(pickle.dumps(x)), copy.deepcopy])
@pytest.mark.parametrize("made", MADE.values(), ids=MADE)
def test_an_object_can_be_pickled_and_copied(
    made: Callable[[], Any], again: Callable[[Any], Any]
) -> None:
    same(again(made()), made())


@pytest.mark.parametrize("name", ["lemur_capture_bodies", "lemur_tumbling", "lemur_wheels"])
def test_a_pickled_task_has_the_same_digest_and_plan(name: str) -> None:
    kept = pickle.loads(pickle.dumps(task(name)))
    assert kept.digest == task(name).digest
    same(ff.perform(kept), plan(name))


def errors_made() -> Iterator[ff.FfPlannerError]:
    invalid = ff.InvalidInput(errors.Status.OUT_OF_RANGE, "duration", -1.0, "it must be positive")
    found_none = ff.NoPlanFound(errors.Status.COLLISION, "c1 is in the way", plan(), (), 7)
    found_none.found, found_none.cause, found_none.met = plan(), invalid, {"clearance": 3}
    late = errors.OutOfTime("too slow", errors.EndedBy.EFFORT)
    late.refusal, late.used_for = found_none, "the search"
    yield ff.FfPlannerError(errors.Status.INTERNAL_ERROR, "it failed")
    yield invalid
    yield errors.InvalidInputs([invalid, invalid])
    yield found_none
    yield late
    yield errors.Interrupted()
    yield errors.BagError("no bag")


ERRORS_MADE = {type(one).__name__: one for one in errors_made()}


def test_every_error_is_tried() -> None:
    every = vars(errors).values()
    kinds = [one for one in every if isinstance(one, type) and issubclass(one, ff.FfPlannerError)]
    assert {kind.__name__ for kind in kinds} == ERRORS_MADE.keys()


@pytest.mark.parametrize("error", ERRORS_MADE.values(), ids=ERRORS_MADE)
def test_an_error_can_be_pickled_with_all_that_it_knows(error: ff.FfPlannerError) -> None:
    for kept in (pickle.loads(pickle.dumps(error)), copy.copy(error)):
        assert type(kept) is type(error)
        assert (str(kept), repr(kept)) == (str(error), repr(error))
        assert vars(kept).keys() == vars(error).keys()
        assert kept.status is error.status
    if isinstance(kept, ff.NoPlanFound):
        same(kept.attempt, error.attempt)
        assert kept.met == error.met
    if isinstance(kept, ff.InvalidInput):
        assert len(kept.faults) == len(error.faults)


# ---- tables


@pytest.mark.parametrize("name", ["lemur_capture", "rail_capture"])
def test_a_trajectory_is_a_table_with_units_in_the_names_of_its_columns(name: str) -> None:
    pandas = pytest.importorskip("pandas")
    motion, robot = plan(name).trajectory, problem(name).robot
    table = pandas.DataFrame(motion.columns(robot))
    assert table.shape == (len(motion.time), 1 + 4 * robot.joints + 26)
    assert table.columns[0] == "time_s"
    for number, joint in enumerate(robot.joint_names):
        slides = robot.slides(number)
        positions = table[f"{joint}_position_{'m' if slides else 'rad'}"]
        efforts = table[f"{joint}_{'force_N' if slides else 'torque_Nm'}"]
        assert (positions == motion.joint_positions[:, number]).all()
        assert (efforts == motion.joint_torques[:, number]).all()
    assert (table["chaser_z_m"] == motion.chaser_positions[:, 2]).all()
    assert (table["ee_qw"] == motion.ee_quaternions_xyzw[:, 3]).all()
    unknown = pandas.DataFrame(motion.columns())
    assert unknown.shape == table.shape
    assert (unknown["joint_2_velocity"] == motion.joint_velocities[:, 1]).all()


def test_the_page_for_python_users_runs_as_it_stands(capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("pandas")
    page = (robots.CONFIG.parent / "docs/reference/python.md").read_text(encoding="utf-8")
    exec(page.partition("```python\n")[2].partition("```")[0], {})
    assert capsys.readouterr().out.startswith(f"{plan()!r}\n")


def test_the_columns_are_those_of_the_plans_in_a_bag() -> None:
    recorded = next(one for one in read_plans(BAG) if one.trajectory is not None)
    made = recorded.trajectory.columns(problem().robot)
    for name, column in made.items():
        np.testing.assert_array_equal(recorded.columns()[name], column)
