"""What crosses the border of the compiled core: the same numbers in any dress, and no others."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from bodied_robots import random_robot
from programs_at_border import programs

from ff_planner_ros.core import compiled
from ff_planner_ros.core.conversions import bodies_of, chain_of

Arguments = dict[str, Any]

ROBOT = random_robot(1)
JOINTS = ROBOT.joints
SIZE, POINTS, COLUMNS = 6 + JOINTS, 4, 3
RNG = np.random.default_rng(0)


FUNCTIONS = {
    "value": 1.0,
    "gradient": np.array([-3.0, -2.0, 0.0]),
    "hessian": np.eye(3),
    "max_terms": np.array([0.1]),
    "max_terms_jacobian": np.array([[1.0, 0.0, 0.0]]),
    "constraints": np.array([2.0]),
    "constraints_jacobian": np.array([[-1.0, -1.0, 0.0]]),
    "equalities": np.array([0.1]),
    "equalities_jacobian": np.array([[0.0, 0.0, 1.0]]),
    "names": np.arange(1),
}


def solve_subproblem(**arguments: Any) -> Any:
    """Give the core the functions by one name."""
    at_x = SimpleNamespace(**{name: arguments.pop(name) for name in FUNCTIONS}, is_defined=True)
    return compiled.solve_subproblem(at_x, **arguments)


def minimise(**arguments: Any) -> Any:
    """Give the core the functions by one name; wherever it asks, they are the same."""
    at_x = SimpleNamespace(**{name: arguments.pop(name) for name in FUNCTIONS}, is_defined=True)
    return compiled.minimise(lambda _: at_x, at_start=at_x, **arguments)


def sound() -> dict[str, tuple[Callable[..., Any], Arguments]]:
    """Everything that the core offers, with arguments that it takes."""
    q = np.zeros((POINTS, 7 + JOINTS))
    q[:, 6] = 1.0
    q[:, 7:] = RNG.normal(scale=0.3, size=(POINTS, JOINTS))
    by_q = RNG.normal(size=(POINTS, SIZE, COLUMNS))
    chain = {"chain": chain_of(ROBOT)}
    way = chain | {
        "q": q,
        "v": np.full((POINTS, SIZE), 1e-3),
        "times": np.arange(POINTS * 1.0),
    }
    asked = {"motion": compiled.CubicMotion(**way), "bodies": bodies_of(ROBOT)}
    asked |= {"chosen": np.arange(2), "last": POINTS - 1, "gap": 1e-3, "part": 0.02}
    start = {
        "position": np.zeros(3),
        "rotation": np.eye(3),
        "center": np.full(3, 0.1),
        "momentum": np.full(6, 0.2),
        "base": "free_flyer",
    }
    target = {
        "position": np.ones(3),
        "rotation": np.eye(3),
        "twist": np.zeros(6),
        "acceleration": np.zeros(6),
        "orientation": "fixed",
        "free_axis": np.eye(3)[0],
        "across": np.eye(3)[1:],
    }
    half = 2 * POINTS - 1
    driven = chain | {
        "start": compiled.Start(**start),
        "angles": np.linspace(0.0, 0.3, half)[:, None] * np.ones(JOINTS),
        "rates": np.full((half, JOINTS), 0.1),
        "accelerations": np.zeros((half, JOINTS)),
        "duration": 3.0,
    }
    motion, goal = compiled.DrivenMotion(**driven), compiled.Target(**target)
    rows = RNG.normal(size=(half, 2))
    tumbling = {
        "position": np.array([4.0, 0.0, 0.0]),
        "velocity": np.zeros(3),
        "begins": np.zeros(1),
        "series": np.array([[[0.0, 0.0, 0.0, 1.0], [0.0, 0.0, 0.05, 0.0]]]),
    }
    hull = {"kind": 3, "sizes": np.zeros(3), "grown": 0.01}
    hull |= {"vertices": RNG.normal(scale=0.3, size=(6, 3))}
    cone = {"kind": 4, "sizes": np.array([0.3, 0.4, 0.0]), "vertices": np.empty((0, 3))}
    ball = {"kind": 0, "sizes": np.array([0.3, 0.0, 0.0]), "vertices": np.empty((0, 3))}
    place = {"rotation": np.eye(3), "position": np.array([0.5, 0.2, 1.0])}
    around = {"center": np.zeros(3), "radius": 1.5, "solid": compiled.Solid(**hull)}
    moving = {"velocity": np.full(3, 1e-3), "rate": np.full(3, 0.1)}
    obstacle = place | around | moving | {"body": None}
    held = {"body": compiled.TumblingBody(**tumbling)}
    every = [compiled.Obstacle(**obstacle)] + [
        compiled.Obstacle(**(obstacle | held | {"solid": compiled.Solid(**one, grown=0.0)}))
        for one in (cone, ball)
    ]
    obstacles = {"obstacles": compiled.Obstacles(every)}
    body = place | around | {"link": 1, "slide": np.zeros(3)}
    links = {
        "translations": np.full((3, 3), 0.4),
        "rotations": np.tile(np.eye(3), (3, 1, 1)),
        "axes": np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 0.0]]),
        "slides": np.array([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]]),
        "weights": np.array([1.0, 1.5]),
        "masses": np.array([50.0, 3.0, 2.0]),
        "centers": np.full((3, 3), 0.1),
        "inertias": np.tile(np.eye(3), (3, 1, 1)),
        "before": [0, 1],
        "planned": [0, 1],
        "multipliers": np.ones(2),
        "offsets": np.zeros(2),
        "tip": 2,
    }
    polynomial = {"duration": 4.0, "quintic": 0.01 * RNG.normal(size=(6, 6))}
    polynomial |= {"rotation_outer": np.eye(3), "quintic_by_duration": np.full((6, 6), 1e-3)}
    fade = {name: np.full(JOINTS, 0.01) for name in ("rates", "accelerations")} | {"seconds": 1.0}
    still = compiled.EndEffectorPolynomial(
        **{name: polynomial[name] for name in ("duration", "quintic", "rotation_outer")}
    )
    of_paths = chain | {"q_start": q[0], "momentum": np.full(6, 0.3), "path": still}
    of_paths |= {"null_space": compiled.NullSpaceFade(**fade)}
    of_splines = chain | {"start": driven["start"], "target": goal, "has_goal": True}
    of_splines |= {"duration": 3.0}
    made = programs(ROBOT, of_paths, of_splines, obstacles)
    return made | {
        "Chain": (compiled.Chain, links),
        "velocity": (
            compiled.velocity,
            chain
            | {
                "q": q[0],
                "momentum": np.full(6, 0.3),
                "twist_ee_in_inertial": np.full(6, 0.01),
                "bias": np.zeros(JOINTS),
                "damping": 0.3,
            },
        ),
        "motion": (
            compiled.end_effector_paths(**of_paths, points=POINTS, damping=0.3).motion,
            {"x": np.full(18, 0.01)},
        ),
        "EndEffectorPolynomial": (compiled.EndEffectorPolynomial, polynomial),
        "NullSpaceFade": (compiled.NullSpaceFade, fade),
        "arm_points_with_derivatives": (
            compiled.arm_points_with_derivatives,
            chain | {"q": q, "q_sensitivity": by_q},
        ),
        "held_momenta": (
            compiled.held_momenta,
            chain | {"q": q, "v": q[:, 1:], "accelerations": q[:, 7:]},
        ),
        "solve_subproblem": (
            solve_subproblem,
            FUNCTIONS | {"radius": 1.0, "penalty": 10.0, "inside": 1e-6, "guess": None},
        ),
        "minimise": (
            minimise,
            FUNCTIONS
            | {"start": np.zeros(3), "curvature": np.zeros((3, 3)), "radius": 1.0, "iterations": 3}
            | {"tolerance": 1e-6, "progress": 1e-6, "tolerated": 0.0, "feasibility": 1e-6}
            | {"inside": 5e-6},
        ),
        "Deadline": (compiled.Deadline, {"seconds": 1.0}),
        "Start": (compiled.Start, start),
        "Target": (compiled.Target, target),
        "DrivenMotion": (compiled.DrivenMotion, driven),
        "goal_error": (motion.goal_error, {"target": goal}),
        "goal_error_by_x": (
            motion.goal_error_by_x,
            {"angle_rows": rows, "rate_rows": rows, "acceleration_row": rows[0], "target": goal},
        ),
        "CubicMotion": (compiled.CubicMotion, way),
        "Solid": (compiled.Solid, hull),
        "Body": (compiled.Body, body),
        "Bodies": (
            compiled.Bodies,
            {"bodies": [compiled.Body(**body)] * 2, "pairs": np.array([[0, 1]])},
        ),
        "TumblingBody": (compiled.TumblingBody, tumbling),
        "Obstacle": (compiled.Obstacle, obstacle),
        "Obstacles": (compiled.Obstacles, {"obstacles": every}),
        "certified_obstacles": (compiled.certified_obstacles, asked | obstacles),
        "certified_pairs": (compiled.certified_pairs, asked),
    }


SOUND = sound()
EVERY_BINDING = pytest.mark.parametrize("name", SOUND)


def answer(name: str, changed: Arguments) -> list[np.ndarray]:
    """Return all numbers of an answer."""
    ask, arguments = SOUND[name]
    found = ask(**(arguments | changed))
    if isinstance(found, compiled.DrivenMotion):
        found = found.q, found.v, found.q_half_way
    parts = found if isinstance(found, tuple) else (found,)
    return [np.asarray(part) for part in parts if isinstance(part, (np.ndarray, float))]


def arrays(name: str) -> Iterator[tuple[str, np.ndarray]]:
    for argument, value in SOUND[name][1].items():
        if isinstance(value, np.ndarray):
            yield argument, value


def numbers(name: str) -> Iterator[tuple[str, float]]:
    for argument, value in SOUND[name][1].items():
        if isinstance(value, float):
            yield argument, value


def refused(name: str, changed: Arguments) -> None:
    """A refusal names an argument that was changed; of another type, numpy's or pybind's says."""
    (argument,) = changed
    with pytest.raises((ValueError, TypeError)) as error:
        answer(name, changed)
    said = str(error.value)
    assert re.search(rf"\b{argument}\b", said), f"{name}, {argument}: {said}"


def test_everything_that_the_core_offers_is_tried_here() -> None:
    offered = {name for name, found in vars(compiled).items() if callable(found)}
    methods = {
        name
        for kind in vars(compiled).values()
        if inspect.isclass(kind)
        for name, found in vars(kind).items()
        if callable(found) and not name.startswith("_")
    }
    only_made_by_the_core = {"WorkingSet", "EvaluatedPath", "MotionOfPath", "DeadlineOver"}
    only_made_by_the_core |= {"PathsOnGrid", "PathRequirement"}
    assert (offered | methods) - only_made_by_the_core == set(SOUND)


@EVERY_BINDING
def test_the_same_numbers_have_the_same_answer_in_any_dress(name: str) -> None:
    expected = answer(name, {})
    for argument, value in arrays(name):
        frozen = value.copy()
        frozen.setflags(write=False)
        wide = np.zeros((*value.shape, 2), value.dtype)
        wide[..., 0] = value
        for dress in (frozen, wide[..., 0], np.asfortranarray(value), value.tolist()):
            found = answer(name, {argument: dress})
            for one, other in zip(found, expected, strict=True):
                np.testing.assert_array_equal(one, other, err_msg=f"{name}, {argument}")
        if value.dtype.kind == "f" and not value.any():
            found = answer(name, {argument: -value})
            for one, other in zip(found, expected, strict=True):
                np.testing.assert_allclose(one, other, atol=1e-12, err_msg=f"{name}, {argument}")


@EVERY_BINDING
def test_what_is_no_number_or_of_a_wrong_size_is_refused_by_name(name: str) -> None:
    for argument, value in arrays(name):
        if value.dtype.kind == "f":
            for wrong in (np.nan, np.inf, -np.inf):
                spoilt = value.copy()
                spoilt.flat[-1] = wrong
                refused(name, {argument: spoilt})
            refused(name, {argument: value * 1j})
        else:
            refused(name, {argument: value + 0.5})
            if argument != "names":  # any number is a name
                refused(name, {argument: value - 2**32})
                refused(name, {argument: value + 2**32})
        refused(name, {argument: value.astype(str)})
        refused(name, {argument: value[None]})
        refused(name, {argument: np.float64(1.0)})
        refused(name, {argument: None})
    for argument, _ in numbers(name):
        for wrong in (np.nan, np.inf, -np.inf, "one", None, [1.0]):
            refused(name, {argument: wrong})


@EVERY_BINDING
def test_one_row_or_column_more_or_fewer_is_refused_or_answered_by_numbers(name: str) -> None:
    """Where a size is free, or an empty array stands for nothing, there is an answer."""
    for argument, value in arrays(name):
        for axis in range(value.ndim):
            last = np.take(value, [-1], axis)
            for changed in (
                np.concatenate([value, last], axis),
                np.delete(value, -1, axis),
                np.delete(value, range(value.shape[axis]), axis),
            ):
                numbers_or_refusal(name, {argument: changed})


@EVERY_BINDING
@pytest.mark.parametrize("scale", [1e-320, 1e30, 1e160, 1e200, 1e308])
def test_no_number_is_so_great_or_small_that_the_answer_is_none(name: str, scale: float) -> None:
    """Squares of 1e160 are no numbers any more; ways of 1e30 m could be halved for ever."""
    for argument, value in arrays(name):
        if value.dtype.kind == "f":
            with np.errstate(over="ignore"):
                great = np.clip(scale * np.where(value, value, 1.0), -1.7e308, 1.7e308)
            first = value.copy()
            first.flat[0] = great.flat[0]
            for changed in (great, first):
                numbers_or_refusal(name, {argument: changed})
    for argument, _ in numbers(name):
        numbers_or_refusal(name, {argument: scale})
        numbers_or_refusal(name, {argument: -scale})


def numbers_or_refusal(name: str, changed: Arguments) -> None:
    """No NaN comes back; infinite is the distance of what is not there, or is not known."""
    try:
        found = answer(name, changed)
    except ValueError as error:
        refusal, found = str(error), []
        assert re.search(r" (is|are|has|have|must) ", refusal), refusal
    for part in found:
        assert not np.isnan(part).any(), f"{name} of {changed}"


@pytest.mark.parametrize(
    "argument",
    [
        "rows",
        "chosen",
        "pairs",
        "last",
        "points",
        "link",
        "before",
        "planned",
        "tip",
        "carrier",
        "kind",
        "guess",
    ],
)
def test_numbers_of_what_there_is_not_are_refused(argument: str) -> None:
    for name, (_, arguments) in SOUND.items():
        if not isinstance(arguments.get(argument), int | list | np.ndarray):
            continue
        for wrong in (-1, 2**31 - 1, 2**31, 2**32, 2**70):
            value = wrong if isinstance(arguments[argument], int) else [wrong]
            if argument == "points" and wrong == 2**31 - 1:
                continue  # nothing but memory forbids it
            with pytest.raises((ValueError, TypeError)):
                answer(name, {argument: value})
