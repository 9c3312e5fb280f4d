"""The service `plan_trajectory`, and the answers to requests of service and action."""

from __future__ import annotations

import time
import traceback
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from itertools import count

from ff_planner_msgs.msg import Plan as PlanMessage
from ff_planner_msgs.msg import PlanAnswer, PlanRequest
from ff_planner_msgs.srv import PlanTrajectory
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from trajectory_msgs.msg import JointTrajectory

from ff_planner_ros.common.shown import in_log
from ff_planner_ros.errors import FfPlannerError, Interrupted, NoPlanFound, Status
from ff_planner_ros.messages.exchange_words import Event, Interface
from ff_planner_ros.parameters import NodeParameters
from ff_planner_ros.parameters.node import PREEMPT
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.motion.watch import Progress
from ff_planner_ros.planning.task.captured import captured_in
from ff_planner_ros.planning.task.library import Library
from ff_planner_ros.planning.task.planning_task import PlanningTask
from ff_planner_ros.planning.task.whole import bodies_of, efforts_of, whole, whole_scene
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.ros.inputs.scene_input import SceneInput
from ff_planner_ros.ros.inputs.state_input import StateInput
from ff_planner_ros.ros.messages.controller_message import controller_message
from ff_planner_ros.ros.messages.interfaces import ACTION, SERVICE
from ff_planner_ros.ros.messages.phases import plan_messages, tell_found
from ff_planner_ros.ros.messages.to_messages import answer_of_error, answer_with_plan, plan_message
from ff_planner_ros.ros.outputs.diagnostics import LastRequest
from ff_planner_ros.ros.outputs.exchanges import Exchanges
from ff_planner_ros.ros.outputs.plan_output import PlanOutput
from ff_planner_ros.ros.parameters import LiveParameters
from ff_planner_ros.ros.qos import REQUEST_QOS
from ff_planner_ros.ros.requests.deadline import Deadline, Stages, deadline_of
from ff_planner_ros.ros.requests.in_words import clearances_in_words, solved_in_words
from ff_planner_ros.ros.requests.jobs import Job, Jobs
from ff_planner_ros.ros.requests.plan_action import PlanAction
from ff_planner_ros.ros.requests.publication import Publication
from ff_planner_ros.ros.requests.reading import (
    Knowledge,
    Provenance,
    ReadRequest,
    RequestRefused,
    read_request,
)
from ff_planner_ros.ros.requests.waiting_plan import MadePlan
from ff_planner_ros.ros.requests.worker import Worker

# Period of the check whether a request is still wanted, while its response is written or obstacles
# are waited for [s]; a response that is not wanted is written to its end beside the next one.
_POLL, _WRITERS = 0.02, 2
# Percentiles are those of so many plans.
_SOLVE_TIMES = 200
# Who asks, where the request does not say it.
_NAMES = {Interface.SERVICE: SERVICE, Interface.ACTION: ACTION}


class PlanningService:
    """Answers planning requests; any error is an answer and never ends the node."""

    def __init__(
        self,
        node: Node,
        parameters: LiveParameters,
        robot: Robot,
        worker: Worker,
        states: StateInput,
        scenes: SceneInput,
        output: PlanOutput,
        exchanges: Exchanges,
        run_name: str,
        library: Library | None,
    ) -> None:
        """Open service and action; requests are answered with NOT_ACTIVE until `activate`.

        The node's executor needs four threads: to plan, to wait for room, to cancel, and to answer
        `~/publish_plan`. Plan ids begin with `run_name`; without `library` searches start cold.
        """
        self._node, self._parameters, self._robot, self._worker = node, parameters, robot, worker
        self._states, self._scenes, self._output = states, scenes, output
        self._exchanges = exchanges
        self._clock, self._logger = node.get_clock(), node.get_logger()
        self._run_name, self._numbers = run_name, count(1)
        self._library = library
        self._jobs = Jobs(worker.interrupt)
        self.last: LastRequest | None = None  # None before the first
        # From request to answer, of the last requests that were searched for [s].
        self.solve_times: deque[float] = deque(maxlen=_SOLVE_TIMES)
        self._writers = ThreadPoolExecutor(_WRITERS, "writer")

        group = ReentrantCallbackGroup()
        self._service = node.create_service(
            PlanTrajectory, SERVICE, self._serve, qos_profile=REQUEST_QOS, callback_group=group
        )
        self._action = PlanAction(
            node,
            group,
            self._jobs,
            lambda request: self._arrived(request, Interface.ACTION),
            self._preempts,
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
        self._writers.shutdown()

    def _serve(
        self, request: PlanTrajectory.Request, response: PlanTrajectory.Response
    ) -> PlanTrajectory.Response:
        asked = request.request
        job = self._arrived(asked, Interface.SERVICE)
        response.answer = self._answer(asked, Interface.SERVICE, job, lambda _: None)
        return response

    def _arrived(self, request: PlanRequest, interface: Interface) -> Job:
        """Return the job of a request that has come, and tell of the request."""
        number = next(self._numbers)
        job = Job(f"{self._run_name}.{number}", number)
        self._tell(Event.RECEIVED, request, interface, job)
        return job

    def _answer(
        self,
        request: PlanRequest,
        interface: Interface,
        job: Job,
        progressed: Callable[[Progress], None],
    ) -> PlanAnswer:
        begun, provenance = time.perf_counter(), Provenance()
        asked: ReadRequest | None = None
        efforts: Sequence[int] = ()
        try:
            with self._jobs.taken_up(job, preempt=self._preempts()):
                taken_up, knowledge = time.monotonic(), self._knowledge()
                provenance = Provenance(received_stamp_ns=knowledge.now_ns)
                asked, parameters = self._read(request, knowledge, job, taken_up)
                provenance = asked.provenance
                deadline = deadline_of(request, asked, parameters)
                requester = request.requester or _NAMES[interface]
                answer, efforts = self._planned(
                    asked, parameters, deadline, requester, job, progressed, begun, taken_up
                )
        except FfPlannerError as error:
            if isinstance(error, RequestRefused):
                provenance = error.provenance
            answer = self._refused(job, job.cause or error, begun)
            if asked is not None:
                efforts = efforts_of(job.cause or error)
                frame = self._parameters.current.inertial_frame
                tell_found(answer, error, asked.task, asked.start_ns, frame)
        except Exception as error:
            self._logger.error(in_log(f"{job.plan_id}: INTERNAL_ERROR\n{traceback.format_exc()}"))
            unforeseen = f"{type(error).__name__}: {error}"
            cause = FfPlannerError(Status.INTERNAL_ERROR, unforeseen)
            answer = answer_of_error(cause, job.plan_id, time.perf_counter() - begun)
        provenance.tell(answer)
        task = None if asked is None else asked.task.ended_at(*efforts)
        answer.task_digest = "" if task is None else task.digest
        status = Status(answer.status.code)
        clearances = clearances_in_words(answer) if status is Status.SOLVED else {}
        self.last = LastRequest(answer.plan_id, status, answer.status.message, clearances)
        event = Event.CANCELLED if status is Status.CANCELLED else Event.ANSWERED
        self._tell(event, request, interface, job, task, answer)
        return answer

    def _tell(
        self,
        event: Event,
        request: PlanRequest,
        interface: Interface,
        job: Job,
        task: PlanningTask | None = None,
        answer: PlanAnswer | None = None,
    ) -> None:
        came_by = Interface.REPLANNING if request.replan_active else interface
        requester = request.requester or _NAMES[interface]
        self._exchanges.tell(
            event, job.plan_id, came_by, requester, request=request, task=task, answer=answer
        )

    def _preempts(self) -> bool:
        return self._parameters.current.when_busy == PREEMPT

    def _read(
        self, request: PlanRequest, knowledge: Knowledge, job: Job, taken_up: float
    ) -> tuple[ReadRequest, NodeParameters]:
        """Read a request; the first one waits for what was published before the node listened."""
        until = taken_up + (request.search.time_budget or knowledge.parameters.time_budget)
        while True:
            # Asked first, so that what arrives while it reads is read, too.
            waits = self._scenes.may_come() and time.monotonic() < until
            try:
                return read_request(request, knowledge), knowledge.parameters
            except RequestRefused as refused:
                if refused.status is not Status.NO_OBSTACLES or not waits:
                    raise
            while self._scenes.may_come() and time.monotonic() < until:
                job.check()
                time.sleep(_POLL)
            knowledge = self._knowledge()

    def _knowledge(self) -> Knowledge:
        return Knowledge(
            self._robot,
            self._parameters.current,
            self._states,
            self._scenes,
            self._output.published,
            self._clock.now().nanoseconds,
            self._library,
        )

    def _refused(self, job: Job, cause: FfPlannerError, begun: float) -> PlanAnswer:
        # Apart from `_answer`, where a variable would hold the error whose traceback holds it.
        self._logger.warning(f"{job.plan_id}: {cause.status.name}: {in_log(str(cause))}")
        return answer_of_error(cause, job.plan_id, time.perf_counter() - begun)

    def _planned(
        self,
        asked: ReadRequest,
        parameters: NodeParameters,
        deadline: Deadline,
        requester: str,
        job: Job,
        progressed: Callable[[Progress], None],
        begun: float,
        taken_up: float,
    ) -> tuple[PlanAnswer, Sequence[int]]:
        """Return the answer with a plan, and how far the search of each phase went."""
        stages = Stages("to read the request", taken_up)
        stages.begin("to search")
        budget = deadline.limited(asked.budget, self._clock, taken_up)

        def check(plan: Plan | None = None) -> None:
            job.check()
            deadline.require(self._clock.now().nanoseconds, stages, plan)

        try:
            plan = self._worker.solve(
                asked.task, budget, taken_up, check, progressed, lambda: job.ends_early
            )
        except NoPlanFound as refused:
            if refused.status is Status.TIMED_OUT and budget != asked.budget and not job.ends_early:
                raise deadline.missed(self._clock.now().nanoseconds, stages, refused) from None
            if job.ends_early and refused.status is Status.TIMED_OUT:
                words = f"the client of the action cancelled it: {refused}"
                raise NoPlanFound(Status.CANCELLED, words, effort=refused.effort) from None
            raise
        except Interrupted:
            job.check()
            raise FfPlannerError(Status.SHUT_DOWN, "the planner was shut down") from None
        finally:
            self.solve_times.append(time.perf_counter() - begun)

        bodies, total = bodies_of(asked.task, plan), whole(plan)
        scene = whole_scene(asked.task, plan)

        def write() -> tuple[list[PlanMessage], PlanMessage, JointTrajectory]:
            told = asked.start_ns, parameters.inertial_frame
            phases = plan_messages(plan, *told, bodies)
            written = plan_message(total, *told, captured_in(scene)) if plan.then else phases[0]
            takes_torques = parameters.controller.effort_interface
            return phases, written, controller_message(written.joint_trajectory, takes_torques)

        stages.begin("to write the plan")
        # Thousands of points take a second, in which the request may be given up, too.
        writing = self._writers.submit(write)
        while not wait([writing], _POLL).done:
            check(plan)
        phases, written, for_controller = writing.result()
        answer = answer_with_plan(total, phases, job.plan_id, time.perf_counter() - begun)
        deadline.require(self._clock.now().nanoseconds, stages, plan)
        made = MadePlan(
            job.plan_id,
            total,
            asked.start_ns,
            asked.task.end_behaviour,
            asked.task.problem.robot,
            scene,
            parameters,
            asked.provenance.previous_plan_id,
            self._clock.now().nanoseconds,
        )
        job.seal()
        if asked.plan_only:
            self._publication.keep(made)
        else:
            self._publication.publish(made, written, for_controller, requester)
        what = "asked for" if asked.plan_only else "published"
        self._logger.info(f"{solved_in_words(total, answer)}; {what} by {requester}")
        return answer, efforts_of(plan)
