"""Planning of cases on a worker, one after the other; it needs no ROS."""

from __future__ import annotations

import hashlib
import json
import math
import threading
import time
import traceback
import warnings
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

from ff_planner_ros.baselines import OPTIMAL
from ff_planner_ros.campaign.cases import Case, kind_of
from ff_planner_ros.campaign.environment import difference
from ff_planner_ros.campaign.methods import method_of
from ff_planner_ros.campaign.sources import task_of
from ff_planner_ros.errors import FfPlannerError, Status
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.motion.watch import Watch
from ff_planner_ros.planning.task.library import kind_and_place
from ff_planner_ros.planning.task.task import perform
from ff_planner_ros.planning.task.whole import whole

_DIGITS = 16  # of a motion's digest
# A robot's scratch space is for one thread: a worker with several plans one case at a time.
_ONE_AT_A_TIME = threading.Lock()


@dataclass(frozen=True, eq=False)
class Outcome:
    """The result of one case, as rows of the tables."""

    row: dict[str, Any]  # of the table of plans
    points: list[dict[str, Any]]  # rows of the table of trajectories; empty: not kept, or no plan


def run_cases(jobs: Sequence[Case], expected: dict[str, str]) -> list[Outcome] | str:
    """Plan cases and return their outcomes, or how this software differs from the expected."""
    if differs := difference(expected):
        return differs
    with _ONE_AT_A_TIME:
        return [run_case(case) for case in jobs]


def run_case(case: Case) -> Outcome:
    """Plan one case; but for `solve_time`, the same case gives the same row on every machine."""
    row: dict[str, Any] = {
        "id": case.id,
        "number": case.number,
        "source": case.source.name,
        "method": case.method.name,
        "planned_by": case.method.method,
        "changes": "{}",
        "settings": json.dumps({one.key: one.value for one in case.method.changes}),
        "drawn": case.is_drawn,
        "solve_time": None,
    }
    answer: Plan | Exception
    try:
        document, urdf, values = case.scenario()
        row["changes"] = json.dumps(values, sort_keys=True)
        row |= {f"change.{key}": _cell(value) for key, value in values.items()}
        task = task_of(document, urdf, case.defaults)
        row |= {"digest": task.digest, "geometry": task.problem.robot.geometry.value}
        method = method_of(case.method.method, task)
        begun = time.perf_counter()
        try:
            with warnings.catch_warnings():  # where numbers grow beyond bounds, the answer says so
                warnings.filterwarnings("ignore", r".* encountered in ", RuntimeWarning)
                answer = perform(task, Watch(), method)
        finally:
            row["solve_time"] = time.perf_counter() - begun
    except Exception as error:  # a defect of ours must not end a campaign: it is a row
        answer = error
    points: list[dict[str, Any]] = []
    if isinstance(answer, Plan):
        row |= _solved(whole(answer))
        if case.method.method == OPTIMAL:
            kind, place = kind_and_place(task)
            row |= {"kind": kind, "place": place.tolist()}
        points = _points(case.id, whole(answer)) if case.trajectory else []
    else:
        row |= _refused(answer)
    return Outcome(row, points)


def _cell(value: Any) -> Any:
    return json.dumps(value) if kind_of(value) == "text" else value


def _refused(error: Exception) -> dict[str, Any]:
    status, message = Status.INTERNAL_ERROR, str(error)
    if isinstance(error, FfPlannerError):
        status = error.status
    else:
        last = traceback.extract_tb(error.__traceback__)[-1]
        message = f"{type(error).__name__} at {Path(last.filename).name}:{last.lineno}: {error}"
    return {"status": status.name.lower(), "solved": False, "message": message}


def _solved(plan: Plan) -> dict[str, Any]:
    metrics = {name: _finite(value) for name, value in asdict(plan.metrics).items()}
    report = asdict(plan.solver)
    message = report.pop("stop_reason")
    del report["ended_by"]  # a campaign searches to the end
    return {
        "status": Status.SOLVED.name.lower(),
        "solved": True,
        "message": message,
        "parametrisation": plan.family,
        "motion_digest": motion_digest(plan),
        "coefficients": plan.coefficients.tolist(),
        **metrics,
        **{name: _finite(value) for name, value in report.items()},
    }


def _finite(value: Any) -> Any:
    """Return None for infinity: without obstacles, there is no clearance to average."""
    if isinstance(value, tuple):
        return list(value)
    return None if isinstance(value, float) and not math.isfinite(value) else value


def motion_digest(plan: Plan) -> str:
    """Return a hash of every bit of a motion."""
    rows = [getattr(plan.trajectory, item.name) for item in fields(plan.trajectory)]
    return hashlib.sha256(b"".join(r.astype("<f8").tobytes() for r in rows)).hexdigest()[:_DIGITS]


def _points(case_id: str, plan: Plan) -> list[dict[str, Any]]:
    columns = {
        item.name: getattr(plan.trajectory, item.name).tolist() for item in fields(plan.trajectory)
    }
    return [
        {"id": case_id, "point": point, **{name: rows[point] for name, rows in columns.items()}}
        for point in range(len(columns["time"]))
    ]
