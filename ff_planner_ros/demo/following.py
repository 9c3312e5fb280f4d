"""Table and figure of the demonstration of replanning in motion."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from ff_planner_ros.analysis.methods import Method
from ff_planner_ros.errors import FfPlannerError
from ff_planner_ros.planning.motion.plan import Trajectory
from ff_planner_ros.robot.model import Robot

# Model errors of the testbed: relative excess of the arm's masses and inertias, and bias of the
# chaser's measured angular velocity about each axis [rad/s].
ARM_HEAVIER, RATE_BIAS = 0.05, float(np.deg2rad(0.01))

OPEN_LOOP = Method("open loop", "#0072b2", "solid")
REPLANNED = Method("at 5 Hz", "#d55e00", "dashed")

HEADER = (
    *("", "asked", "plans", "delay [ms]", "solve time p50 [ms]", "p99 [ms]", "iterations"),
    "deviation [mm]",
)
_STEPS = 10  # of the integration, from point to point of the plan


def miss_by_torques_alone(robot: Robot, motion: Trajectory) -> float | None:
    """Return the end effector's final position error under the plan's torques alone [m].

    The model errors are those of the demonstration's testbed. None: MuJoCo is not installed.
    """
    try:
        from ff_planner_ros.planning.motion.motion import state_at
        from ff_planner_ros.simulation.deviation import deviation
        from ff_planner_ros.simulation.engine import Engine
        from ff_planner_ros.simulation.execution import execute
        from ff_planner_ros.simulation.feed_forward import feed_forward
    except FfPlannerError:
        return None
    engine, start = Engine(robot), state_at(motion, 0)
    engine.scale_inertias(
        engine.arm_bodies, *np.full((2, len(engine.arm_bodies)), 1.0 + ARM_HEAVIER)
    )
    omega = start.angular_velocity_chaser_in_inertial - RATE_BIAS
    true = replace(start, angular_velocity_chaser_in_inertial=omega)
    executed = execute(engine, true, feed_forward(robot, motion, _STEPS))
    return deviation(executed, motion).final_position_error


def rows(
    flown: Mapping[Method, Mapping[str, Any]], torques_alone: float | None
) -> Iterator[tuple[str, ...]]:
    """Yield the cells of `HEADER`: for the plan by its torques alone, and for each flight."""
    if torques_alone is not None:
        yield ("torques alone", *["-"] * 6, f"{torques_alone * 1e3:.1f}")
    for method, report in flown.items():
        yield (
            method.name,
            f"{report['asked']}",
            f"{report['plans']}",
            *(
                f"{factor * report[name]:.0f}" if name in report else "-"
                for name, factor in (
                    ("delay", 1e3),
                    ("solve_time_p50", 1e3),
                    ("solve_time_p99", 1e3),
                    ("iterations_p50", 1.0),
                )
            ),
            f"{report['error']['position'] * 1e3:.1f}",
        )


def following_figure(flown: Mapping[Method, Mapping[str, Any]]) -> Figure:
    """Draw the measured distance of the end effector to the plan's end over time."""
    figure = Figure(figsize=(8.0, 4.0), layout="constrained")
    axes = figure.add_subplot()
    for method, report in flown.items():
        time, distance = np.array(report["way"]).T
        style: Any = {"color": method.colour, "linestyle": method.dash, "linewidth": 1.8}
        axes.plot(time, distance * 1e3, label=method.label, **style)
    axes.set_yscale("log")
    axes.set_xlabel("time [s]")
    axes.set_ylabel("end effector from its goal [mm]")
    axes.margins(x=0.0)
    axes.grid(visible=True, color="0.9")
    axes.legend(frameon=False)
    return figure
