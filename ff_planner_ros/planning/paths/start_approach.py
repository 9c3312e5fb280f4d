"""A start that moves towards an obstacle: any plan comes nearer before it can stop."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.distance.allowed_contact import may_touch, split_obstacles
from ff_planner_ros.planning.distance.bodies import placed_bodies
from ff_planner_ros.planning.distance.body_distances import obstacle_bounds, obstacle_distances
from ff_planner_ros.planning.distance.surroundings import surroundings
from ff_planner_ros.planning.motion.forward import carried_base
from ff_planner_ros.planning.motion.joint_motion import JointMotion
from ff_planner_ros.planning.paths.start_motion import FASTEST_CHANGE
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.robot.collision.lines import in_words, with_bodies
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.momentum import base_twist, total_momentum

# Largest distance at the start [m] that is examined, and the time after it [s], in so many samples;
# beyond these a plan can turn any start round.
NEAR, _SECONDS, _TIMES = 0.01, 0.2, 41
# Rotation of a joint in the difference quotient of a distance [rad].
_TURN = 1e-6
# A joint's effect on a distance changes as the arm moves: by less than this factor.
_SPARE = 1.5
# Plans that are shorter than this [s] change accelerations faster, by the cube of the ratio.
_CALM = 2.0
# Joint accelerations that a start may have without giving them, in squares of its largest rate.
_UNTOLD = 2.0

# Returns the distances of all pairs for configurations at times: (configurations, pairs) [m].
Distances = Callable[[Array, Array], Array]


class Approached(NamedTuple):
    """A pair that collides soon after the start, whatever the plan is."""

    pair: int  # index in the distances
    clearance: float  # at the start [m]
    needed: float  # clearance at the start with which a plan could stop in time [m]
    speed: float  # of approach at the start [m/s]


def approached(problem: PlanningProblem, distances: Distances) -> Approached | None:
    """Return the pair that collides worst soon after the start in any plan; None: there is none.

    Joints continue with their start motion, apart from the largest effect of `FASTEST_CHANGE`.
    """
    robot, start = problem.robot, problem.start
    q_start, v_start = configuration(robot, start)
    clear = distances(q_start[None], np.zeros(1))[0]
    near = np.flatnonzero(clear < NEAR)
    if not near.size:
        return None
    rates, known = start.joint_velocities, start.joint_accelerations
    accelerations = np.zeros_like(rates) if known is None else known
    times = np.linspace(0.0, min(_SECONDS, problem.duration), _TIMES)
    t = times[:, None]
    motion = JointMotion(
        times,
        start.joint_positions + t * rates + t**2 / 2 * accelerations,
        rates + t * accelerations,
        np.broadcast_to(accelerations, (len(times), robot.joints)).copy(),
    )
    data, none = robot.model.createData(), np.zeros(6)
    momentum = total_momentum(robot, data, q_start, v_start)
    q, _ = carried_base(robot, q_start, momentum, motion, times)
    going_on = distances(q, times)[:, near]
    turned = np.array(
        [
            pin.integrate(
                robot.model,
                q_start,
                _TURN * np.concatenate([base_twist(robot, data, q_start, none, one), one]),
            )
            for one in np.eye(robot.joints)
        ]
    )
    by_joints = (distances(turned, np.zeros(len(turned)))[:, near] - clear[near]) / _TURN
    most = np.abs(by_joints).sum(axis=0)
    window = problem.duration_range
    shortest = problem.duration if window is None else window.minimum
    changed = FASTEST_CHANGE * max(1.0, (_CALM / shortest) ** 3) * t**3 / 6
    if known is None:
        changed = changed + _UNTOLD * float(np.abs(rates).max()) ** 2 * t**2 / 2
    at_most = (going_on + _SPARE * most * changed).min(axis=0)
    worst = int(at_most.argmin())
    if at_most[worst] >= 0.0:
        return None
    speed = (going_on[0, worst] - going_on[1, worst]) / (times[1] - times[0])
    found = float(clear[near[worst]])
    return Approached(int(near[worst]), found, found - float(at_most[worst]), float(speed))


def refuse_approached(problem: PlanningProblem, q_start: Array) -> None:
    """Refuse a start with a body, or centre line, that moves into an obstacle in any plan.

    Args:
        q_start: Configuration at the start. Shape (7 + joints,).

    Raises:
        InvalidInput: Such a collision is certain (START_IN_COLLISION).
    """
    robot, around, now = with_bodies(problem.robot), surroundings(problem.obstacles), np.zeros(1)
    if not problem.obstacles:
        return
    placed = placed_bodies(robot, q_start[None, 7:])
    near = obstacle_bounds(robot, placed, q_start[None], now, around)[0] < NEAR
    near.reshape(-1)[may_touch(problem, split_obstacles(problem), q_start, 0.0)] = False
    bodies, numbers = np.nonzero(near)
    if not bodies.size:
        return

    def distances(q: Array, times: Array) -> Array:
        at = np.repeat(np.arange(len(q)), len(bodies))
        rows = at, np.tile(bodies, len(q)), np.tile(numbers, len(q))
        there = around.seen_from_base(q, times, rows[0], rows[2])
        found = obstacle_distances(robot, placed_bodies(robot, q[:, 7:]), there, around, rows)
        return found.distance.reshape(len(q), -1)

    found = approached(problem, distances)
    if found is None:
        return
    body = in_words(problem.robot, int(bodies[found.pair]))
    raise InvalidInput(
        Status.START_IN_COLLISION,
        f"obstacles[{problem.obstacles[numbers[found.pair]].id}]",
        f"{found.clearance * 1e3:.3f} mm from {body}, which nears it by {found.speed:.3g} m/s",
        f"at this speed {found.needed * 1e3:.3f} mm are needed at the start, or else no plan stops "
        "it before they touch; start further away, or slower",
    )
