"""Execute a plan open loop: its torques, without feedback."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from types import MappingProxyType

import numpy as np

from ff_planner_ros.common.arrays import Array, frozen
from ff_planner_ros.common.shown import in_a_line
from ff_planner_ros.robot.state import SystemState
from ff_planner_ros.simulation.engine import Engine
from ff_planner_ros.simulation.feed_forward import FeedForward

_NOWHERE: Mapping[int, SystemState] = MappingProxyType({})


@dataclass(frozen=True, eq=False)
class Execution:
    """The executed motion at the times of the plan's points, in the inertial frame.

    All values are NaN from where the motion has diverged.
    """

    time: Array  # from the start of the plan; shape (points,) [s]
    joint_positions: Array  # shape (points, joints) [rad]
    joint_velocities: Array  # shape (points, joints) [rad/s]
    chaser_positions: Array  # shape (points, 3) [m]
    chaser_quaternions_xyzw: Array  # shape (points, 4)
    ee_positions: Array  # shape (points, 3) [m]
    ee_quaternions_xyzw: Array  # shape (points, 4)
    momentum: Array  # P [kg m/s] and L about the inertial origin [kg m2/s]; shape (points, 6)
    ee_twists: Array  # linear, then angular; shape (points, 6) [m/s, rad/s]

    __repr__ = in_a_line

    def __post_init__(self) -> None:
        """Replace every array by a read-only copy."""
        for item in fields(self):
            object.__setattr__(self, item.name, frozen(getattr(self, item.name)))


def execute(engine: Engine, start: SystemState, command: FeedForward) -> Execution:
    """Integrate the engine's forward dynamics under commanded torques; see `states_after_steps`."""
    return execution_of(engine, states_after_steps(engine, start, command), command)


def states_after_steps(
    engine: Engine,
    start: SystemState,
    command: FeedForward,
    begins: Mapping[int, SystemState] = _NOWHERE,
) -> list[Array]:
    """Return the engine's states at the start and after every step of RK4, while they are finite.

    MuJoCo's own steps hold the torques constant and are of second order in a free body's rotation.
    Here the quaternion is integrated as four numbers, and the method keeps its fourth order.

    Args:
        begins: States from which the motion begins anew after so many steps.
    """
    state = engine.state(start)
    states = [state]
    with np.errstate(over="ignore", invalid="ignore"):
        for k in range(0, len(command.time) - 1, 2):
            if k // 2 in begins:
                state = engine.state(begins[k // 2])
            state = _step(engine, state, command.time[k : k + 3], command.torques[k : k + 3])
            if not np.isfinite(state).all():
                break
            states.append(state)
    return states


def execution_of(engine: Engine, states: Sequence[Array], command: FeedForward) -> Execution:
    """Return the motion of `states_after_steps` at the points of the plan."""
    seen = [
        (*engine.joints(state), *engine.observe(state))
        for state in states[:: command.steps_per_point]
    ]
    time = command.time[:: 2 * command.steps_per_point]
    lost = [[np.full_like(value, np.nan) for value in seen[0]]] * (len(time) - len(seen))
    return Execution(time, *(np.array(column) for column in zip(*seen, *lost, strict=True)))


def _step(engine: Engine, state: Array, time: Array, torques: Array) -> Array:
    """Return the state after one step, with times and torques of its begin, middle and end."""
    step = time[2] - time[0]
    k1 = engine.derivative(state, torques[0])
    k2 = engine.derivative(state + step / 2 * k1, torques[1])
    k3 = engine.derivative(state + step / 2 * k2, torques[1])
    k4 = engine.derivative(state + step * k3, torques[2])
    after: Array = state + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return after
