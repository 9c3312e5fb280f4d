"""Everything that a plan depends on."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np

from ff_planner_ros.common.arrays import Array, finite_number, frozen
from ff_planner_ros.common.declared import check_declared, declare
from ff_planner_ros.common.declared_parts import changes, part
from ff_planner_ros.common.forms import (
    a_number,
    a_vector,
    a_whole_number,
    a_word,
    each,
    or_none,
)
from ff_planner_ros.common.shown import in_a_line
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.motion.joint_motion import JointMotion
from ff_planner_ros.planning.problem.problem import PlanningProblem, Posture
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.task.controller_rules import Controller
from ff_planner_ros.planning.task.digest import digest_of
from ff_planner_ros.planning.task.phase import (
    MOST_PHASES,
    MOST_STEPS,
    Phase,
    require_mass,
)
from ff_planner_ros.planning.task.tail import (
    EndBehaviour,
    tail_intervals,
)

# A goal is at its motion's last point, but for this [s].
_ROUNDING = 1e-6


_PHASES = each(part(Phase))


@dataclass(frozen=True, eq=False)
class PlanningTask:
    """A problem with everything else that its plan depends on.

    Raises:
        InvalidInput: A value is not allowed, `running_goal` is not ahead on `running`, there are
            too many phases, the mass of a captured body is missing, or no plan can have the
            post-goal segment.
    """

    problem: PlanningProblem  # its start is the state as measured
    settings: PlannerSettings = declare(
        changes(PlannerSettings),
        "settings of the planner, as the parameters of this group",
        key="planner",
        optional=True,
    )
    ahead: float = declare(
        a_number(at_least=0.0),
        "time from the state to the first point of the plan, for which the state is carried "
        "forward",
        key="start_after",
        unit="s",
        default=0.0,
    )
    running: JointMotion | None = declare(
        changes(JointMotion),
        "motion of the joints until then; default: constant velocities",
        default=None,
    )
    # The plan begins exactly on that motion, and is searched for near its remainder
    running_goal: float | None = declare(
        a_number(),
        "time at which that motion reaches its goal: the plan takes over from it; default: a plan "
        "of its own",
        unit="s from the state",
        default=None,
    )
    end_behaviour: EndBehaviour = declare(
        a_word(EndBehaviour),
        "behaviour of the arm after the goal",
        default=EndBehaviour.NONE,
        message="end_behaviour",
    )
    tail: float = declare(  # zero for `none`
        a_number(),
        "duration of the end behaviour",
        key="post_goal_duration",
        unit="s",
        default=0.0,
    )
    controller: Controller | None = declare(
        or_none(changes(Controller)),
        "rules that the plan must keep; none: nobody's",
        default=None,
    )
    first_guess: Array | None = declare(
        a_vector(None),
        "initial guess, tried before all others: decision variables of the path family",
        default=None,
    )
    effort: int = declare(
        a_whole_number(0, MOST_STEPS),
        "step at which the search ends, from an answer; default: no limit",
        key="search.effort",
        brief=True,
        default=0,
        message="search.effort",
    )

    # What follows the goal, one after the other; the tail is behind the last
    then: tuple[Phase, ...] = ()

    FACTS = ("problem", "ahead", "end_behaviour", "tail", "then")
    __repr__ = in_a_line

    def __post_init__(self) -> None:
        """Check the times, and keep read-only copies of the arrays."""
        check_declared(self, "", problem=PlanningProblem)
        if self.end_behaviour is EndBehaviour.NONE:
            object.__setattr__(self, "tail", 0.0)
        if self.running is not None:
            motion = {item.name: getattr(self.running, item.name) for item in fields(JointMotion)}
            copy = JointMotion(**{name: frozen(rows) for name, rows in motion.items()})
            object.__setattr__(self, "running", copy)
        if self.running_goal is not None:
            self._require_remainder(self.running_goal)
        then = list[Phase]()
        for phase in _PHASES.checked("phases", self.then):
            then.append(phase.after(then[-1] if then else self.problem))
        object.__setattr__(self, "then", tuple(then))
        if self.then and self.problem.target_body is not None:
            require_mass(self.problem.target_body)
        self._require_tail(then[-1] if then else None)
        if len(self.then) > MOST_PHASES:
            told, allowed = f"{len(self.then)} phases", f"{MOST_PHASES} may follow the first"
            raise InvalidInput(Status.WRONG_SIZE, "phases", told, allowed)

    def _require_tail(self, last: Phase | None) -> None:
        """Refuse a post-goal segment that the plan of the last phase cannot have."""
        points, lasts, posture = self.problem.points, self.problem.duration, self.problem.posture
        if last is not None:
            points, lasts = last.points or points, last.longest_duration
            posture = last.target if isinstance(last.target, Posture) else None
        tail_intervals(points, lasts, self.end_behaviour, self.tail, posture is not None)

    def _require_remainder(self, goal: float) -> None:
        """Refuse to take over from a motion that does not run then, or is at its goal already."""
        if self.running is None:
            allowed = "there is no running motion to go on from"
            raise InvalidInput(Status.NO_ACTIVE_PLAN, "running_goal", goal, allowed)
        first, last = self.running.time[[0, -1]].tolist()
        if not first <= self.ahead < finite_number("running_goal", goal) <= last + _ROUNDING:
            allowed = (
                f"it must be after start_after, {self.ahead:g} s, and both within running.time, "
                f"{first:g} s to {last:g} s"
            )
            raise InvalidInput(Status.OUT_OF_RANGE, "running_goal", goal, allowed)

    def ended_at(self, *efforts: int) -> PlanningTask:
        """Return the task with the search of each phase limited to a step, as in an answer.

        Args:
            *efforts: Last step of each phase's search; zero: unchanged.
        """
        if not any(efforts):
            return self
        first, *others = efforts
        then = [
            replace(phase, effort=effort or phase.effort)
            for phase, effort in zip(self.then, others, strict=False)
        ]
        return replace(self, effort=first or self.effort, then=(*then, *self.then[len(then) :]))

    @cached_property
    def digest(self) -> str:
        """Hash of everything that the plan depends on: equal tasks have equal digests."""
        # A controller that lets joints move at the end takes every sound plan.
        strict = self.controller
        if strict is not None and strict.takes_every_end:
            strict = None
        digest = digest_of(replace(self, controller=strict))
        # A capture by itself does not depend on the mass of what is captured.
        bodies = [self.problem.target_body, *(phase.target_body for phase in self.then)]
        masses = [0.0 if body is None else body.mass for body in bodies]
        heavy = self.then or np.isfinite(self.problem.limits.capture_impulse)
        return digest_of([digest, masses]) if heavy and any(masses) else digest
