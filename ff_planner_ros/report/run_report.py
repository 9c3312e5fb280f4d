"""The content of a report: every request of a run, with plans beside measured motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ff_planner_ros.analysis.drawing.tracking import Deviations
from ff_planner_ros.analysis.json_file import read_json
from ff_planner_ros.analysis.methods import MEASURED, PLANNED, Method
from ff_planner_ros.analysis.plan_document import phases_of, plan_document
from ff_planner_ros.bag.publications import Publication
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.common.times import NANOSECONDS
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.motion.metrics import Metrics
from ff_planner_ros.planning.motion.plan import Plan, SolverReport, Trajectory, WheelMotion
from ff_planner_ros.planning.problem.problem import Obstacle, Target
from ff_planner_ros.planning.problem.scene import Scene
from ff_planner_ros.planning.task.whole import whole
from ff_planner_ros.robot.model import Robot

if TYPE_CHECKING:
    import plotly.graph_objects as go


@dataclass(frozen=True, eq=False)
class ReportedPlan:
    """A plan with the data of its plots and tables."""

    robot: Robot
    motion: Trajectory  # as planned
    obstacles: tuple[Obstacle, ...] | None  # None: not known
    scene: Scene  # as far as it is known
    measured: Trajectory | None = None  # while the plan ran; None: nothing was measured
    deviations: Deviations | None = None  # of the measured motion
    remarks: tuple[str, ...] = ()  # sentences above the plots
    # Wheel momenta at the start, shape (wheels,) [N m s]; None: there are no wheels
    stored: Array | None = None

    @property
    def goal(self) -> Target:
        """Goal of the end effector; where none is known, the end of the plan."""
        motion = self.motion
        end = Target(motion.ee_positions[-1], motion.ee_quaternions_xyzw[-1])
        return self.scene.goal or end

    @property
    def motions(self) -> dict[Method, Trajectory]:
        """Planned and measured motion."""
        measured = {} if self.measured is None else {MEASURED: self.measured}
        return {PLANNED: self.motion, **measured}


@dataclass(frozen=True, eq=False)
class ReportedRequest:
    """A request with its response; None stands for what is not known."""

    plan_id: str  # name of the request; empty if it has none
    door: str  # interface that it came in by
    asked_ns: int | None = None  # time of the request, on the node's clock [ns]
    received_ns: int | None = None  # when the node read the request [ns]
    answered_ns: int | None = None  # when the response went out [ns]
    start_ns: int | None = None  # time of the plan's first point [ns]
    code: int | None = None  # of the status; None: unanswered
    message: str = ""  # of the status
    weights: tuple[float, ...] | None = None  # fields of `Objective`, in their order
    duration: float | None = None  # to the goal, given or chosen [s]
    # Shortest and longest that the planner may choose [s]; None: the duration is given
    durations: tuple[float, float] | None = None
    points: int | None = None  # of the plan
    metrics: Metrics | None = None  # of the plan, or of the best attempt
    solver: SolverReport | None = None  # of the plan, or of the best attempt
    solve_time: float | None = None  # wall clock of the answer [s]
    guessed: bool = False  # whether a library's plan was tried first
    # Age and source of each input, in words, when the request was read
    made_from: tuple[tuple[str, str], ...] = ()
    plan: ReportedPlan | None = None  # None: there is no plan, or it is not drawn
    # Picture of the scenario, if it was refused before any search; None: not drawn
    asked: go.Figure | None = None
    # Plans of a sequence's later phases; `plan` is that of the first
    then: tuple[ReportedPlan, ...] = ()


@dataclass(frozen=True, eq=False)
class Report:
    """The content of a report's page."""

    title: str  # name of the bag or file
    facts: tuple[tuple[str, str], ...]
    notes: tuple[str, ...]  # problems of the bag, and omissions
    requests: tuple[ReportedRequest, ...]  # in order of time
    publications: tuple[Publication, ...] = ()  # in order of time

    @property
    def counts(self) -> str:
        """Number of requests, solved, refused and unanswered."""
        codes = [request.code for request in self.requests]
        solved, unanswered = codes.count(Status.SOLVED), codes.count(None)
        refused = len(codes) - solved - unanswered
        requests = "request" if len(codes) == 1 else "requests"
        return (
            f"{len(codes)} {requests}: {solved} solved, {refused} refused, {unanswered} unanswered"
        )


def report_of_answer(file: Path) -> Report:
    """Return the report of a plan, or a refusal, in a file of `ff-planner plan --json`.

    Raises:
        InvalidInput: The file cannot be read, or is no such answer.
    """
    answer = read_json(file)
    try:
        if isinstance(answer, dict) and _refused(answer):
            request = _refusal(answer)
            return Report(file.name, (("file", str(file)),), (), (request,))
        found = [plan_document(one) for _, one in phases_of(answer, file.stem)]
    except InvalidInput as error:
        field = f"{file}: {error.field}"
        raise InvalidInput(error.status, field, error.value, error.allowed) from None
    facts = (("file", str(file)), *robot_facts(found[0].robot))
    first, *others = found
    plan = replace(first.plan, then=tuple(one.plan for one in others))
    drawn = [
        reported_plan(one.robot, one.plan.trajectory, one.obstacles, one.scene, one.plan.wheels)
        for one in found
    ]
    took = sum(one.solve_time for one in found)
    asked = ReportedRequest(file.stem, "command line", weights=first.weights, solve_time=took)
    message = str(answer.get("message", ""))
    return Report(file.name, facts, (), (solved(asked, plan, drawn, message),))


def solved(
    asked: ReportedRequest, plan: Plan, drawn: Sequence[ReportedPlan], message: str
) -> ReportedRequest:
    """Return a request with its plan; a sequence has the metrics of the whole motion.

    Args:
        drawn: The plan to draw of each phase, in order.
    """
    total = whole(plan)
    motion = total.trajectory
    return replace(
        asked,
        code=Status.SOLVED,
        message=message,
        duration=total.duration or float(motion.time[-1]),
        points=len(motion.time),
        metrics=total.metrics,
        solver=total.solver,
        plan=drawn[0],
        then=tuple(drawn[1:]),
    )


def reported_plan(
    robot: Robot,
    motion: Trajectory,
    obstacles: tuple[Obstacle, ...] | None,
    scene: Scene,
    wheels: WheelMotion | None = None,
) -> ReportedPlan:
    """Return a plan without measured motion; obstacles are None where they are not known."""
    remarks = () if obstacles is not None else ("Which obstacles it avoids is not known.",)
    stored = None if wheels is None else wheels.momenta[0]
    return ReportedPlan(robot, motion, obstacles, scene, remarks=remarks, stored=stored)


def robot_facts(robot: Robot) -> list[tuple[str, str]]:
    """Return names and values that describe a robot."""
    mass = sum(inertia.mass for inertia in robot.model.inertias)
    joints = f"{robot.joints} joints from {robot.base_link} to {robot.tip_link}"
    kept = "the arm's lines"
    if robot.bodies:
        kept = f"shapes: {len(robot.bodies)} bodies, {len(robot.pairs)} pairs must not touch"
    return [
        ("robot", f"{robot.model.name}: {joints}, {mass:.1f} kg in all"),
        ("kept clear", kept),
        *(("note on the robot", note) for note in robot.notes),
    ]


def clock_time(time_ns: int, with_date: bool = True) -> str:
    """Return a time since the epoch [ns] as UTC text."""
    try:
        moment = datetime.fromtimestamp(time_ns // NANOSECONDS, UTC)
    except (OverflowError, OSError, ValueError):
        return f"{time_ns} ns"
    day = f"{moment:%Y-%m-%d} " if with_date else ""
    clock = f"{moment:%H:%M:%S}.{time_ns % NANOSECONDS // 1_000_000:03d}"
    return f"{day}{clock} UTC" if with_date else clock


def _refused(answer: Mapping[str, Any]) -> bool:
    """Say whether a dictionary is a refusal's, as `refusal_dictionary` makes it."""
    status = Status.__members__.get(str(answer.get("status")).upper(), Status.SOLVED)
    return status is not Status.SOLVED and "message" in answer


def _refusal(answer: Mapping[str, Any]) -> ReportedRequest:
    return ReportedRequest(
        plan_id="",
        door="command line",
        code=Status[str(answer["status"]).upper()],
        message=str(answer["message"]),
    )
