"""The core's program of a path against the same by Python: the family, then each requirement."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, replace
from itertools import islice
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest

from ff_planner_ros.bench.measurement import OBJECTIVES
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.motion.system_frame import in_own_frame
from ff_planner_ros.planning.optimisation.evaluated_path import PathLinearisation, seen
from ff_planner_ros.planning.optimisation.program import PathProgram, path_program
from ff_planner_ros.planning.problem.problem import PlanningProblem, lasting
from ff_planner_ros.planning.search.families import path_families
from ff_planner_ros.planning.search.grid import grids_of
from ff_planner_ros.problems import (
    all_features,
    bodies,
    captured,
    joint_goals,
    shapes,
    tumbling,
    witnessed,
)
from ff_planner_ros.problems.robots import ROBOTS
from ff_planner_ros.problems.scenarios import scenario

SETTINGS = load_parameters().planner
GUESSES = 3


def problems() -> Iterator[tuple[str, PlanningProblem]]:
    """Draw problems with every requirement that the core knows, and some that it does not."""
    for number, robot in enumerate(ROBOTS):
        for kind in ("ordinary", "cluttered"):
            drawn = scenario(kind, robot, number, turned=True).problem
            limits = replace(drawn.limits, joint_velocities=True, chaser_attitude=0.2)
            yield f"{kind} {robot}", replace(drawn, limits=limits)
    for number, each in enumerate(bodies.problems(3)):
        yield f"bodies {number}", each.problem
    for number in range(6):
        yield f"shapes {number}", shapes.problem(number).problem
    for kind in tumbling.KINDS:
        yield f"tumbling {kind}", tumbling.problem(kind, 1)
    for kind in witnessed.KINDS:
        yield f"witnessed {kind}", witnessed.problem(kind, 1)
    for kind in joint_goals.KINDS:
        yield f"joint goal, {kind}", joint_goals.problem(kind, 1).problem
    for kind in captured.KINDS:
        yield f"captured, {kind}", captured.problem(kind, 1).problem
    for number in range(3):
        problem = all_features.problem(number).problem
        yield f"all features {number}", lasting(problem, problem.duration_range.maximum)


PROBLEMS = dict(problems())


def by_python(program: PathProgram, x: np.ndarray) -> PathLinearisation:
    """Return what Python finds, without the core's program."""
    with patch.object(type(program.family), "on_grid", lambda *_: None):
        return replace(program).linearise(x)


def programs(problem: PlanningProblem) -> Iterator[tuple[PathProgram, np.ndarray]]:
    """Yield programs on coarse and fine grids, corrected ones, too, with paths."""
    for ways in path_families(problem, SETTINGS):
        program = path_program(problem, ways[0], SETTINGS)
        program = replace(program, margins=program.margins | {"singular_values": 0.05})
        program = program.with_requirements(program.on_demand)
        for grid in grids_of(program, SETTINGS):
            for x in islice(ways[0].first_guesses(problem.obstacles, 13, 0.0), GUESSES):
                yield grid.program, x
                yield grid.with_correction(x).program, x
                yield replace(grid.program, attitude_norm=8.0), x


@pytest.mark.parametrize("name", PROBLEMS)
def test_the_core_finds_what_the_family_and_the_requirements_find(name: str) -> None:
    problem, defined = in_own_frame(PROBLEMS[name]), 0
    for number, (program, x) in enumerate(programs(problem)):
        objective = list(OBJECTIVES.values())[number % len(OBJECTIVES)]
        program = replace(program, objective=replace(objective, joint_path_length=0.7))
        assert program.in_core is not None
        found, expected = seen(program.evaluate(x)), by_python(program, x)
        assert found.is_defined == expected.is_defined
        if not found.is_defined:
            singular_at = found.motion.singular_at, expected.motion.singular_at
            assert singular_at[0] == pytest.approx(singular_at[1])
            continue
        defined += 1
        for one in fields(expected):
            if one.name != "motion":
                same(getattr(found, one.name), getattr(expected, one.name), f"{name}, {one.name}")
        for part in ("x", "q", "v", "q_half_way", "goal_error"):
            same(getattr(found.motion, part), getattr(expected.motion, part), f"{name}, {part}")
    assert defined > 0


def same(found: Any, expected: Any, what: str) -> None:
    """Names are the same, and all else to rounding, but for what bodies in parallel make of it.

    Where an edge lies along another, their nearest points, and with them the derivatives, differ
    by much more than distances do.
    """
    found, expected = np.asarray(found, np.float64), np.asarray(expected, np.float64)
    if what.endswith("equalities_jacobian") and not expected.size:
        return  # of no rows, its columns are not looked at
    assert found.shape == expected.shape, what
    apart = np.abs(found - expected) / max(1.0, float(np.abs(expected).max(initial=0.0)))
    if what.endswith("constraints_jacobian"):
        rows = apart.max(axis=1, initial=0.0) > 1e-4
        assert rows.mean() < 0.03, f"{what}: {np.flatnonzero(rows)} of {len(rows)}"
    else:
        assert apart.max(initial=0.0) < (1e-7 if what.endswith("constraints") else 1e-9), what
