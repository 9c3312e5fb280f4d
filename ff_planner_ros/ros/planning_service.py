"""The service `plan_trajectory` and the topics around it."""

from __future__ import annotations

import math
import time
import traceback
from itertools import count

from ff_planner_msgs.msg import ChaserState, ObstacleSphereArray
from ff_planner_msgs.srv import PlanTrajectory
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.service_introspection import ServiceIntrospectionState
from trajectory_msgs.msg import JointTrajectory

from ff_planner_ros.arrays import finite_number
from ff_planner_ros.errors import FfPlannerError, InvalidInput, Status
from ff_planner_ros.planning.problem import Sphere
from ff_planner_ros.planning.scenario import from_urdf
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.ros.from_messages import (
    NANOSECONDS,
    nanoseconds,
    problem_from_request,
    spheres_from_message,
    state_from_message,
)
from ff_planner_ros.ros.parameters import NodeParameters
from ff_planner_ros.ros.to_messages import pose_on_path, response_from_error, response_from_plan
from ff_planner_ros.ros.worker import Worker

# Best effort hears every publisher, and only the newest state counts.
STATE_QOS = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
# Whoever comes late still gets the last one.
LATCHED_QOS = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
STREAM_QOS = QoSProfile(depth=10)
SERVICE_EVENT_QOS = QoSProfile(depth=100)


class PlanningService:
    """Answers planning requests; a problem of a request is an answer and never ends the node."""

    def __init__(
        self, node: Node, parameters: NodeParameters, robot: Robot, worker: Worker, run_name: str
    ) -> None:
        """Create subscriptions, publishers and the service on a node.

        Args:
            node: The node; needs an executor with at least two threads, one of them to plan.
            parameters: Of the node.
            robot: What to plan for.
            worker: Where to plan.
            run_name: Stands in front of the number in every plan id.
        """
        self._parameters = parameters
        self._robot = robot
        self._worker = worker
        self._plan_ids = (f"{run_name}.{number}" for number in count(1))
        self._clock = node.get_clock()
        self._logger = node.get_logger()

        # Kept as they come: what is wrong with them is the answer to the request that needs them.
        self._state: ChaserState | None = None
        self._obstacles: ObstacleSphereArray | None = None
        node.create_subscription(ChaserState, "chaser_state", self._keep_state, STATE_QOS)
        node.create_subscription(
            ObstacleSphereArray, "obstacles", self._keep_obstacles, LATCHED_QOS
        )

        self._path = Path()
        self._trajectory_publisher = node.create_publisher(
            JointTrajectory, "joint_trajectory", LATCHED_QOS
        )
        self._path_publisher = node.create_publisher(Path, "predicted_chaser_path", LATCHED_QOS)
        self._pose_publisher = node.create_publisher(
            PoseStamped, "predicted_chaser_pose", STREAM_QOS
        )
        node.create_timer(1.0 / parameters.predicted_pose_rate, self._stream_pose)

        service = node.create_service(
            PlanTrajectory,
            "plan_trajectory",
            self._answer,
            callback_group=MutuallyExclusiveCallbackGroup(),
        )
        service.configure_introspection(
            self._clock, SERVICE_EVENT_QOS, ServiceIntrospectionState.CONTENTS
        )

    def _keep_state(self, message: ChaserState) -> None:
        self._state = message

    def _keep_obstacles(self, message: ObstacleSphereArray) -> None:
        self._obstacles = message

    def _stream_pose(self) -> None:
        pose = pose_on_path(self._path, self._clock.now().nanoseconds)
        if pose is not None:
            self._pose_publisher.publish(pose)

    def _answer(
        self, request: PlanTrajectory.Request, _: PlanTrajectory.Response
    ) -> PlanTrajectory.Response:
        plan_id, begun = next(self._plan_ids), time.perf_counter()
        try:
            response = self._planned(request, plan_id, begun)
        except FfPlannerError as error:
            self._logger.warning(f"{plan_id}: {error.status.name}: {error}")
            return response_from_error(error, plan_id, time.perf_counter() - begun)
        except Exception as error:
            self._logger.error(f"{plan_id}: INTERNAL_ERROR\n{traceback.format_exc()}")
            unforeseen = f"{type(error).__name__}: {error}"
            cause = FfPlannerError(Status.INTERNAL_ERROR, unforeseen)
            return response_from_error(cause, plan_id, time.perf_counter() - begun)
        self._trajectory_publisher.publish(response.joint_trajectory)
        self._path_publisher.publish(response.predicted_chaser_path)
        self._path = response.predicted_chaser_path
        metrics, solver = response.metrics, response.solver
        self._logger.info(
            f"{plan_id}: SOLVED: joint path {metrics.joint_path_length:.4f} rad, "
            f"largest attitude {math.degrees(metrics.max_chaser_euler):.2f} deg, "
            f"clearance {metrics.min_clearance * 1e3:.1f} mm, "
            f"{solver.iterations} iterations, {solver.solve_time:.2f} s"
        )
        return response

    def _planned(
        self, request: PlanTrajectory.Request, plan_id: str, begun: float
    ) -> PlanTrajectory.Response:
        frame = self._parameters.inertial_frame
        message, source, start_ns = self._start_message(request)
        start = state_from_message(message, source, self._robot, frame)
        problem = problem_from_request(
            request,
            self._robot,
            start,
            start_ns,
            self._spheres(request),
            frame,
            self._parameters.points,
            from_urdf("limits.velocity", self._parameters.limits.velocity),
        )
        budget = self._time_budget(request)
        plan = self._worker.solve(problem, self._parameters.planner, budget)
        return response_from_plan(plan, plan_id, start_ns, frame, time.perf_counter() - begun)

    def _start_message(self, request: PlanTrajectory.Request) -> tuple[ChaserState, str, int]:
        """Return the state to start from, its name in errors, and its time [ns]."""
        now_ns = self._clock.now().nanoseconds
        if request.use_start_state:
            message, source = request.start_state, "start_state"
            start_ns = nanoseconds(message.header.stamp) or now_ns
        elif self._state is not None:
            message, source = self._state, "chaser_state"
            start_ns = nanoseconds(message.header.stamp)
        else:
            raise InvalidInput(
                Status.NO_STATE,
                "chaser_state",
                "missing",
                "none was received yet; publish it, or give the request a start_state",
            )
        if nanoseconds(request.start_time) not in (0, start_ns):
            raise InvalidInput(
                Status.UNSUPPORTED,
                "start_time",
                f"{nanoseconds(request.start_time)} ns",
                f"it must be zero or the stamp of the start state, {start_ns} ns; "
                "planning ahead is not supported yet",
            )
        self._check_age(f"{source}.header.stamp", (now_ns - start_ns) / NANOSECONDS)
        return message, source, start_ns

    def _time_budget(self, request: PlanTrajectory.Request) -> float:
        if request.time_budget < 0.0:
            raise InvalidInput(
                Status.OUT_OF_RANGE,
                "time_budget",
                request.time_budget,
                "it must not be negative; 0 stands for the parameter time_budget, "
                f"{self._parameters.time_budget:g} s",
            )
        return finite_number("time_budget", request.time_budget) or self._parameters.time_budget

    def _check_age(self, field: str, age: float) -> None:
        max_age, max_lead = self._parameters.state_max_age, self._parameters.state_max_lead
        if age > max_age:
            raise InvalidInput(
                Status.STATE_TOO_OLD,
                field,
                f"{age:.3f} s old",
                f"it must be at most {max_age:g} s old (parameter state_max_age)",
            )
        if -age > max_lead:
            raise InvalidInput(
                Status.STATE_IN_FUTURE,
                field,
                f"{-age:.3f} s ahead of now",
                f"it must be at most {max_lead:g} s ahead (parameter state_max_lead); "
                "do both computers have the same time?",
            )

    def _spheres(self, request: PlanTrajectory.Request) -> tuple[Sphere, ...]:
        message = request.obstacles if request.use_obstacles else self._obstacles
        if message is None:
            raise InvalidInput(
                Status.NO_OBSTACLES,
                "obstacles",
                "missing",
                "none were received yet; publish an empty array if the scene is free, "
                "or give the request its obstacles",
            )
        return spheres_from_message(message, self._parameters.inertial_frame)
