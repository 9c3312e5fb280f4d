"""The service `plan_trajectory`, and the answers to requests of service and action."""

from __future__ import annotations

import time
import traceback
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from itertools import count

from ff_planner_msgs.msg import PlanAnswer, PlanInputs, PlanRequest
from ff_planner_msgs.srv import PlanTrajectory
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node

from ff_planner_ros.common.shown import in_log
from ff_planner_ros.errors import FfPlannerError, Interrupted, InvalidInput, NoPlanFound, Status
from ff_planner_ros.messages.exchange_words import Event, Interface
from ff_planner_ros.parameters import NodeParameters
from ff_planner_ros.parameters.node import PREEMPT
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.motion.watch import Budget, Progress
from ff_planner_ros.planning.task.library import Library
from ff_planner_ros.planning.task.planning_task import PlanningTask
from ff_planner_ros.planning.task.whole import efforts_of, whole, whole_scene
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.ros.inputs.locked_joints import MeasuredRobot
from ff_planner_ros.ros.inputs.scene_input import SceneInput
from ff_planner_ros.ros.inputs.state_input import StateInput
from ff_planner_ros.ros.messages.answers import answer_of, clearances_in_words, solved_in_words
from ff_planner_ros.ros.outputs.diagnostics import LastRequest
from ff_planner_ros.ros.outputs.exchanges import Exchanges
from ff_planner_ros.ros.outputs.made_plan import MadePlan
from ff_planner_ros.ros.outputs.plan_output import PlanOutput
from ff_planner_ros.ros.qos import REQUEST_QOS
from ff_planner_ros.ros.requests.deadline import LATE_REMAINDER, Deadline, Stages, deadline_of
from ff_planner_ros.ros.requests.jobs import Job, Jobs
from ff_planner_ros.ros.requests.plan_action import PlanAction
from ff_planner_ros.ros.requests.publication import Publication
from ff_planner_ros.ros.requests.reading import Knowledge, ReadRequest, read_request
from ff_planner_ros.ros.requests.solver import Solver
from ff_planner_ros.ros.topics import ACTION, SERVICE

# Period of the check whether a request is still wanted while obstacles are waited for [s].
_POLL = 0.02
# Percentiles are those of so many plans.
_SOLVE_TIMES = 200
# Who asks, where the request does not say it.
_NAMES = {Interface.SERVICE: SERVICE.name, Interface.ACTION: ACTION.name}


class PlanningService:
    """Answers planning requests; any error is an answer and never ends the node."""

    def __init__(
        self,
        node: Node,
        parameters: NodeParameters,
        robot: Robot,
        solver: Solver,
        states: StateInput,
        scenes: SceneInput,
        output: PlanOutput,
        exchanges: Exchanges,
        run_name: str,
        library: Library | None,
        robots: MeasuredRobot | None = None,
    ) -> None:
        """Open service and action; requests are answered with NOT_ACTIVE until `activate`.

        The node's executor needs four threads: to plan, to wait for room, to cancel, and to answer
        `~/publish_plan`. Plan ids begin with `run_name`; without `library` searches start cold.
        """
        self._node, self._parameters, self._robot, self._solver = node, parameters, robot, solver
        self._states, self._scenes, self._output = states, scenes, output
        self._exchanges = exchanges
        self._clock, self._logger = node.get_clock(), node.get_logger()
        self._run_name, self._numbers = run_name, count(1)
        self._library, self._robots = library, robots
        self._jobs = Jobs(solver.interrupt, preempt=parameters.when_busy == PREEMPT)
        self.last: LastRequest | None = None  # None before the first
        # From request to answer, of the last requests that were searched for [s].
        self.solve_times: deque[float] = deque(maxlen=_SOLVE_TIMES)

        group = ReentrantCallbackGroup()
        self._service = node.create_service(
            PlanTrajectory, SERVICE.name, self._serve, qos_profile=REQUEST_QOS, callback_group=group
        )
        self._action = PlanAction(
            node,
            group,
            self._jobs,
            lambda request: self._arrived(request, Interface.ACTION),
            self._answer,
        )
        self._publication = Publication(node, output, exchanges, self._knowledge)

    @property
    def is_active(self) -> bool:
        """Whether requests are accepted."""
        return self._jobs.is_open

    def activate(self) -> None:
        """Accept requests from now on."""
        self._publication.open()
        self._jobs.open()

    def deactivate(self, status: Status, message: str, patience: float) -> None:
        """Refuse requests, give up the current one, and wait `patience` [s] for its answer."""
        self._jobs.close(status, message)
        self._jobs.wait_until_idle(patience)
        self._publication.close(status, message)

    def look(self) -> None:
        """Update the display of the plan that waits for publication."""
        self._publication.look()

    def give_up(self, status: Status, message: str) -> None:
        """Give up the current request, if there is one, and forget plans that wait."""
        self._jobs.give_up_all(status, message)
        self._publication.forget()

    def close(self) -> None:
        """Close service and action."""
        self._action.destroy()
        self._node.destroy_service(self._service)
        self._publication.destroy()

    def _serve(
        self, request: PlanTrajectory.Request, response: PlanTrajectory.Response
    ) -> PlanTrajectory.Response:
        job = self._arrived(request.request, Interface.SERVICE)
        response.answer = self._answer(job, lambda _: None)
        return response

    def _arrived(self, request: PlanRequest, interface: Interface) -> Job:
        """Return the job of a request that has come, and tell of the request."""
        number = next(self._numbers)
        came_by = Interface.REPLANNING if request.replan_active else interface
        requester = request.requester or _NAMES[interface]
        job = Job(f"{self._run_name}.{number}", number, request, came_by, requester)
        self._tell(Event.RECEIVED, job)
        return job

    def _answer(self, job: Job, progressed: Callable[[Progress], None]) -> PlanAnswer:
        """Return the answer to a request: its plan, which is published or waits, or why not."""
        begun, inputs = time.perf_counter(), PlanInputs()
        asked: ReadRequest | None = None
        try:
            with self._jobs.taken_up(job):
                taken_up = time.monotonic()
                asked = self._read(job, inputs, taken_up)
                answer, task = self._planned(job, asked, progressed, begun, taken_up)
        except FfPlannerError as error:
            answer, task = self._written(job.cause or error, job, asked, begun)
            name = Status(answer.status.code).name
            self._logger.warning(f"{job.plan_id}: {name}: {in_log(str(job.cause or error))}")
        except Exception as error:
            self._logger.error(in_log(f"{job.plan_id}: INTERNAL_ERROR\n{traceback.format_exc()}"))
            unforeseen = f"{type(error).__name__}: {error}"
            cause = FfPlannerError(Status.INTERNAL_ERROR, unforeseen)
            answer, task = self._written(cause, job, asked, begun)
        answer.inputs = inputs
        status = Status(answer.status.code)
        clearances = clearances_in_words(answer) if status is Status.SOLVED else {}
        self.last = LastRequest(answer.plan_id, status, answer.status.message, clearances)
        event = Event.CANCELLED if status is Status.CANCELLED else Event.ANSWERED
        self._tell(event, job, task, answer)
        return answer

    def _written(
        self,
        outcome: Plan | FfPlannerError,
        job: Job,
        asked: ReadRequest | None,
        begun: float,
    ) -> tuple[PlanAnswer, PlanningTask | None]:
        """Return the answer, and the task as far as it was searched for; None: it was not read."""
        seconds = time.perf_counter() - begun
        if asked is None:
            return answer_of(outcome, job.plan_id, seconds), None
        task = asked.task.ended_at(*efforts_of(outcome))
        at = asked.start_ns, self._parameters.inertial_frame
        return answer_of(outcome, job.plan_id, seconds, task, *at), task

    def _tell(
        self,
        event: Event,
        job: Job,
        task: PlanningTask | None = None,
        answer: PlanAnswer | None = None,
    ) -> None:
        told = job.plan_id, job.interface, job.requester
        self._exchanges.tell(event, *told, request=job.request, task=task, answer=answer)

    def _read(self, job: Job, inputs: PlanInputs, taken_up: float) -> ReadRequest:
        """Read a request; the first one waits for what was published before the node listened."""
        budget = job.request.search.time_budget or self._parameters.time_budget
        until = taken_up + budget
        while True:
            # Asked first, so that what arrives while it reads is read, too.
            waits = self._scenes.may_come() and time.monotonic() < until
            try:
                return read_request(job.request, self._knowledge(), inputs)
            except InvalidInput as refused:
                if refused.status is not Status.NO_OBSTACLES or not waits:
                    raise
            while self._scenes.may_come() and time.monotonic() < until:
                job.check()
                time.sleep(_POLL)

    def _knowledge(self) -> Knowledge:
        return Knowledge(
            self._robot,
            self._parameters,
            self._states,
            self._scenes,
            self._output.published,
            self._clock.now().nanoseconds,
            self._library,
            self._robots,
        )

    def _planned(
        self,
        job: Job,
        asked: ReadRequest,
        progressed: Callable[[Progress], None],
        begun: float,
        taken_up: float,
    ) -> tuple[PlanAnswer, PlanningTask | None]:
        """Search, then publish the plan or let it wait; return the answer with it, and its task."""
        stages = Stages("to read the request", taken_up)
        stages.begin("to search")
        deadline = deadline_of(job.request, asked, self._parameters)
        try:
            plan = self._searched(job, asked, deadline, stages, progressed, taken_up)
        except Interrupted:
            job.check()
            raise FfPlannerError(Status.SHUT_DOWN, "the planner was shut down") from None
        finally:
            self.solve_times.append(time.perf_counter() - begun)
        stages.begin("to write the plan")
        answer, task = self._written(plan, job, asked, begun)
        job.check()
        deadline.require(self._clock.now().nanoseconds, stages, plan)
        made = MadePlan(
            job.plan_id,
            whole(plan),
            asked.start_ns,
            asked.task.end_behaviour,
            asked.task.problem.robot,
            whole_scene(asked.task, plan),
            self._parameters.inertial_frame,
            asked.inputs.previous_plan_id,
            self._clock.now().nanoseconds,
        )
        job.seal()
        if asked.plan_only:
            self._publication.keep(made)
        else:
            self._publication.publish(
                made, made.written() if plan.then else answer.plans[0], job.requester
            )
        what = "asked for" if asked.plan_only else "published"
        # Two milliseconds: the logger looks for the line of source that calls it.
        self._exchanges.afterwards(
            lambda: self._logger.info(
                f"{solved_in_words(made.plan, answer)}; {what} by {job.requester}"
            )
        )
        return answer, task

    def _searched(
        self,
        job: Job,
        asked: ReadRequest,
        deadline: Deadline,
        stages: Stages,
        progressed: Callable[[Progress], None],
        taken_up: float,
    ) -> Plan:
        """Return the plan or, too late for that, the rest of the running plan."""

        def check(plan: Plan | None = None) -> None:
            job.check()
            deadline.require(self._clock.now().nanoseconds, stages, plan)

        def solve(task: PlanningTask, budget: Budget, since: float) -> Plan:
            plan = self._solver.solve(
                task, budget, since, check, progressed, lambda: job.ends_early
            )
            check(plan)
            return plan

        def solve_in_time() -> Plan:
            budget = deadline.limited(asked.budget, self._clock, taken_up)
            try:
                return solve(asked.task, budget, taken_up)
            except NoPlanFound as refused:
                if refused.status is not Status.TIMED_OUT:
                    raise
                if job.ends_early:
                    words = f"the client of the action cancelled it: {refused}"
                    raise NoPlanFound(Status.CANCELLED, words, effort=refused.effort) from None
                if budget != asked.budget:
                    raise deadline.missed(self._clock.now().nanoseconds, stages, refused) from None
                raise

        try:
            return solve_in_time()
        except NoPlanFound as late:
            if late.status is not Status.TOO_LATE or not deadline.takes_over:
                raise
            stages.begin("to check the rest of the running plan")
            with suppress(NoPlanFound):
                return solve(asked.task.ended_at(1), Budget(LATE_REMAINDER), time.monotonic())
            raise
