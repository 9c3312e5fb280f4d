"""An answer of the planner as a dictionary that JSON can hold."""

from __future__ import annotations

import math
from dataclasses import asdict, fields
from typing import Any

from ff_planner_ros.errors import FfPlannerError, NoPlanFound, Status
from ff_planner_ros.planning.plan import Plan


def plan_dictionary(plan: Plan, solve_time: float) -> dict[str, Any]:
    """Return a plan: SI units, radians, a row per point.

    Args:
        plan: The plan.
        solve_time: Wall clock of the answer [s].
    """
    motion = plan.trajectory
    return {
        "status": Status.SOLVED.name.lower(),
        "message": plan.solver.stop_reason,
        "joint_names": list(plan.joint_names),
        **{item.name: getattr(motion, item.name).tolist() for item in fields(motion)},
        "xi": plan.xi.tolist(),
        "orientation_reading": plan.orientation_reading,
        **_how_good(plan, solve_time),
    }


def refusal_dictionary(error: FfPlannerError, solve_time: float) -> dict[str, Any]:
    """Return a refusal: its cause, and how near the best attempt came; never a trajectory.

    Args:
        error: Why there is no plan.
        solve_time: Wall clock of the answer [s].
    """
    refusal = {"status": error.status.name.lower(), "message": str(error)}
    if isinstance(error, NoPlanFound) and isinstance(error.attempt, Plan):
        refusal |= _how_good(error.attempt, solve_time)
    return refusal


def _how_good(plan: Plan, solve_time: float) -> dict[str, Any]:
    # JSON knows no infinity: without obstacles there is no clearance to tell.
    metrics = {k: v if math.isfinite(v) else None for k, v in asdict(plan.metrics).items()}
    return {"metrics": metrics, "solver": {"solve_time": solve_time, **asdict(plan.solver)}}
