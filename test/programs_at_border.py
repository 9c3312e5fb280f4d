"""The programs of paths that the core offers, with arguments that it takes; all are evaluated."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
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
    robot: Robot, of_paths: Arguments, of_splines: Arguments, obstacles: Arguments
) -> dict[str, tuple[Callable[..., Any], Arguments]]:
    """Return what makes programs, and arguments.

    Args:
        of_paths: Of `end_effector_paths` but for points and damping.
        of_splines: Of `joint_splines` but for the matrices.
        obstacles: Three of them, by their name.
    """
    paths = compiled.end_effector_paths(**of_paths, points=POINTS, damping=0.3)
    joints, size, half = robot.joints, 6 + robot.joints, 2 * POINTS - 1
    wheels = {"shares": np.eye(3), "stored": np.full(3, 0.1)}
    asked = {
        "joint_path": 1.0,
        "slow": 0.01,
        "smoothing": 0.1,
        "shares": np.ones(size),
        "attitude": 1.0,
        "rotation_chaser_to_base": np.eye(3),
        "attitude_norm": 2.0,
        "wheel_momentum": 0.5,
        "wheels": compiled.Wheels(**wheels),
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

    def corrected(**steps: Any) -> Any:
        return evaluated(paths, limited, correction=compiled.Correction(**steps))

    rng = np.random.default_rng(1)
    rows = {"free": rng.normal(scale=0.1, size=(half, 2)), "known": np.full((half, joints), 0.1)}
    names = "positions", "rates", "accelerations", "position_hull", "rate_hull"
    moving = {name: compiled.SplineRows(**rows, moved=rows["known"]) for name in names}
    path = {"duration": 2.0, "quintic": np.eye(6), "rotation_outer": np.eye(3)}
    lasting = compiled.EndEffectorPolynomial(**path, quintic_by_duration=np.full((6, 6), 0.1))
    loads = {"margin": 1e-3, "interest": 3.0}
    within = {"excess": 1e-4, "margin": 1e-3, "interest": 3.0}
    positions = within | {"lower": np.full(joints, -3.0), "upper": np.full(joints, 3.0)}
    positions |= {"stop_interest": 3.0, "jerk": 10.0}
    rates = within | {"limits": np.full(joints, 3.0)}
    limited = [compiled.positions_within(**positions), compiled.rates_within(**rates)]
    program = compiled.PathProgram(paths, STEP, objective, list(enumerate(limited)))
    times = 2 * POINTS - 2
    grasp = {
        "positions": rng.normal(size=(times, 3)),
        "rotations": np.tile(np.eye(3), (times, 1, 1)),
        "counts": np.ones(3),
        "twists": rng.normal(size=(times, 6)),
        "moves_with_goal": True,
    }
    cone = {"half_angle": 0.3, "margin": 0.01, "interest": 30.0}
    corridor = cone | {"direction": np.eye(3)[2], "distance": 1.0, "radius": 0.01, "back_off": 0.0}
    view = cone | {"carrier": 2, "rotation": np.eye(3), "position": np.full(3, 0.1)}
    view |= {"axis": np.eye(3)[0], "until": 0.1}
    seen = compiled.GraspSeen(**grasp)

    def looked_at_from(**grasp: Any) -> Any:
        seen = compiled.GraspSeen(**grasp)
        asked = compiled.in_corridor(seen, **corridor), compiled.goal_in_view(seen, **view)
        return evaluated(paths, asked)

    return {
        "end_effector_paths": (
            end_effector_paths,
            of_paths
            | {"path": lasting, "points": POINTS, "damping": 0.3, "goal_by_duration": np.ones(6)},
        ),
        "joint_splines": (
            joint_splines,
            of_splines | moving | {"target_by_duration": np.ones((3, 6))},
        ),
        "PathObjective": (
            lambda **changed: evaluated(paths, objective=compiled.PathObjective(**changed)),
            asked,
        ),
        "SplineRows": (compiled.SplineRows, rows | {"moved": rows["known"]}),
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
        "positions_within": (required(compiled.positions_within), positions),
        "rates_within": (required(compiled.rates_within), rates),
        "attitude_within": (
            required(compiled.attitude_within),
            {"rotation_chaser_to_base": np.eye(3), "limit": 0.3, "interest": 3.0},
        ),
        "accelerations_within": (
            required(compiled.accelerations_within),
            loads | {"parts": np.full(joints, 9.0), "between": True},
        ),
        "torques_within": (
            required(compiled.torques_within),
            loads | {"base": "free_flyer", "parts": np.full(joints, 0.1)},
        ),
        "grasp_wrench_within": (
            required(compiled.grasp_wrench_within),
            loads
            | {"base": "planar", "link": joints, "position": np.full(3, 0.1)}
            | {"rotation": np.eye(3), "mass": 40.0, "center": np.full(3, 0.2)}
            | {"inertia": np.eye(3), "parts": np.array([0.1, 1.0])},
        ),
        "Wheels": (compiled.Wheels, wheels),
        "wheels_within": (
            required(compiled.wheels_within),
            loads
            | {"wheels": compiled.Wheels(**wheels), "excess": 1e-4, "between": False}
            | {"momenta": np.full(3, 2.0), "torques": np.array([10.0, 0.0, 10.0])},
        ),
        "rotation_within": (
            required(compiled.rotation_within),
            {"limit": 0.3, "knee": 0.15, "interest": 3.0},
        ),
        "chaser_at_goal": (
            required(compiled.chaser_at_goal),
            {"rotation": np.eye(3), "limit": 0.3, "knee": 0.15},
        ),
        "follows_path": (
            required(compiled.follows_path),
            {"positions": grasp["positions"], "rotations": np.tile(np.eye(3), (times, 1))}
            | {"counts": [0, 1, 2, 3, 4, 5], "position": 0.1, "orientation": 0.2},
        ),
        "GraspSeen": (looked_at_from, grasp),
        "in_corridor": (required(partial(compiled.in_corridor, seen)), corridor),
        "goal_in_view": (required(partial(compiled.goal_in_view, seen)), view),
        "singular_value_above": (
            required(compiled.singular_value_above),
            {"rows": [0, 1, 2, 3, 4, 5], "margin": 0.1, "interest": 9.0},
        ),
    } | distances(robot, obstacles, lambda one: evaluated(paths, [one]))


def distances(
    robot: Robot,
    obstacles: Arguments,
    evaluated: Callable[[compiled.PathRequirement], tuple[Any, ...]],
) -> dict[str, tuple[Callable[..., Any], Arguments]]:
    """Return what makes requirements of distances, and arguments.

    Args:
        obstacles: Three of them, by their name.
        evaluated: Returns what a program with one requirement finds.
    """

    def allowing(**contacts: Any) -> Any:
        allowed = compiled.AllowedContacts(**contacts)
        return evaluated(compiled.pairs_apart(**apart, allowed=allowed))

    def touching(**at_start: Any) -> Any:
        return allowing(**contacts | {"at_start": [compiled.ContactsAtStart(**at_start)]})

    times = np.arange(4.0 * POINTS - 6.0)
    places = np.tile([0.2, 0.1, 0.3], (len(times), 1))
    at_start = {"pairs": np.arange(1), "places": places, "seen_from_base": True}
    contacts = {"pairs": np.arange(1, 3), "goal": 2.0 * places, "distance": 0.5}
    contacts |= {"at_start": [compiled.ContactsAtStart(**at_start)]}
    asked = {"bodies": bodies_of(robot), "interest": 3.0, "quarter_way": True}
    allowed = {"allowed": compiled.AllowedContacts(**contacts)}
    clear = asked | obstacles | {"margin": 0.01, "times": times}
    clear |= {"room": np.ones(3 * len(robot.bodies))}
    apart = asked | {"margins": np.full(len(robot.pairs), 0.01)}
    return {
        "AllowedContacts": (allowing, contacts),
        "ContactsAtStart": (touching, at_start),
        "bodies_clear": (
            lambda **arguments: evaluated(compiled.bodies_clear(**arguments)),
            clear | allowed,
        ),
        "pairs_apart": (
            lambda **arguments: evaluated(compiled.pairs_apart(**arguments)),
            apart | allowed,
        ),
    }
