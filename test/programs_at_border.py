"""The programs of paths that the core offers, with arguments that it takes; all are evaluated."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ff_planner_ros.core import compiled
from ff_planner_ros.core.conversions import bodies_of
from ff_planner_ros.robot.model import Robot

Arguments = dict[str, Any]

POINTS, STEP = 4, 0.7
# What a path must have to be answered by numbers.
PARTS = "value", "gradient", "hessian", "constraints", "constraints_jacobian", "q", "v"


def programs(
    robot: Robot, of_paths: Arguments, of_splines: Arguments, spheres: Any, obstacles: Any
) -> dict[str, tuple[Callable[..., Any], Arguments]]:
    """Return what makes programs, and arguments.

    Args:
        of_paths: Of `end_effector_motion` but for x, points and damping.
        of_splines: Of `joint_splines` but for the matrices.
    """
    paths = compiled.end_effector_paths(**of_paths, points=POINTS, damping=0.3)
    joints, size, half = robot.joints, 6 + robot.joints, 2 * POINTS - 1
    asked = {
        "joint_path": 1.0,
        "slow": 0.01,
        "smoothing": 0.1,
        "shares": np.ones(size),
        "attitude": 1.0,
        "rotation_chaser_to_base": np.eye(3),
        "attitude_norm": 2.0,
    }
    objective = compiled.PathObjective(**asked)

    def evaluated(
        of: compiled.PathsOnGrid,
        requirements: Sequence[Any] = (),
        objective: compiled.PathObjective = objective,
        step: float = STEP,
        correction: Any = None,
    ) -> tuple[Any, ...]:
        numbered = list(enumerate(requirements))
        program = compiled.PathProgram(of, step, objective, numbered, correction)
        return answer(program.at(np.full(18, 0.01)))

    def answer(found: compiled.EvaluatedPath) -> tuple[Any, ...]:
        return tuple(getattr(found, name) for name in PARTS) if found.is_defined else ()

    def end_effector_paths(**arguments: Any) -> tuple[Any, ...]:
        program = compiled.PathProgram(
            compiled.end_effector_paths(**arguments), STEP, objective, []
        )
        return answer(program.at(np.full(18, 0.01)))

    def joint_splines(**arguments: Any) -> tuple[Any, ...]:
        made = compiled.joint_splines(**arguments)
        found = compiled.PathProgram(made, STEP, objective, []).at(np.full(2 * joints, 0.1))
        return *answer(found), found.goal_error

    def required(make: Callable[..., compiled.PathRequirement]) -> Callable[..., Any]:
        return lambda **arguments: evaluated(paths, [make(**arguments)])

    def kept(make: Callable[..., compiled.PathRequirement]) -> Callable[..., Any]:
        def ask(**arguments: Any) -> Any:
            margins = {name: arguments.pop(name) for name in ("margin", "room", "little", "gained")}
            return evaluated(paths, [make(margins=compiled.Margins(**margins), **arguments)])

        return ask

    def corrected(**steps: Any) -> Any:
        return evaluated(paths, limited, correction=compiled.Correction(**steps))

    rng = np.random.default_rng(1)
    rows = {"free": rng.normal(scale=0.1, size=(half, 2)), "known": np.full((half, joints), 0.1)}
    names = "positions", "rates", "accelerations", "position_hull", "rate_hull"
    matrices = {name: compiled.SplineRows(**rows) for name in names}
    within = {"excess": 1e-4, "margin": 1e-3, "interest": 3.0}
    positions = within | {"lower": np.full(joints, -3.0), "upper": np.full(joints, 3.0)}
    positions |= {"stop_interest": 3.0, "jerk": 10.0, "step": STEP}
    rates = within | {"limits": np.full(joints, 3.0), "step": STEP}
    limited = [compiled.positions_within(**positions), compiled.rates_within(**rates)]
    program = compiled.PathProgram(paths, STEP, objective, list(enumerate(limited)))
    bodies = {"bodies": bodies_of(robot)}
    looked_at = {"times": np.arange(4.0 * POINTS - 6.0), "interest": 3.0, "quarter_way": True}
    margins = {"margin": 0.01, "little": 0.5, "gained": 0.25}
    each = 2 * len(robot.bodies)
    return {
        "end_effector_paths": (end_effector_paths, of_paths | {"points": POINTS, "damping": 0.3}),
        "joint_splines": (joint_splines, of_splines | matrices),
        "PathObjective": (
            lambda **changed: evaluated(paths, objective=compiled.PathObjective(**changed)),
            asked,
        ),
        "SplineRows": (compiled.SplineRows, rows),
        "PathProgram": (lambda **asked: evaluated(paths, limited, **asked), {"step": STEP}),
        "Correction": (
            corrected,
            {
                "q": np.full((POINTS, size), 1e-3),
                "v": np.full((POINTS, size), 1e-3),
                "q_half_way": np.full((POINTS - 1, size), 1e-3),
            },
        ),
        "at": (lambda x: answer(program.at(x)), {"x": np.full(18, 0.01)}),
        "Margins": (compiled.Margins, margins | {"room": np.ones(3)}),
        "positions_within": (required(compiled.positions_within), positions),
        "rates_within": (required(compiled.rates_within), rates),
        "attitude_within": (
            required(compiled.attitude_within),
            {"rotation_chaser_to_base": np.eye(3), "limit": 0.3, "interest": 3.0},
        ),
        "singular_value_above": (
            required(compiled.singular_value_above),
            {"rows": [0, 1, 2, 3, 4, 5], "margin": 0.1, "interest": 9.0},
        ),
        "lines_clear_of_spheres": (
            kept(compiled.lines_clear_of_spheres),
            margins
            | looked_at
            | {"spheres": spheres, "lines": joints, "room": np.ones(2 * joints)},
        ),
        "bodies_clear_of_spheres": (
            kept(compiled.bodies_clear_of_spheres),
            margins | looked_at | bodies | {"spheres": spheres, "room": np.ones(each)},
        ),
        "bodies_clear_of_obstacles": (
            kept(compiled.bodies_clear_of_obstacles),
            margins | looked_at | bodies | {"obstacles": obstacles, "room": np.ones(each)},
        ),
        "pairs_apart": (
            required(compiled.pairs_apart),
            bodies
            | {"margins": np.full(len(robot.pairs), 0.01), "interest": 3.0, "quarter_way": True},
        ),
    }
