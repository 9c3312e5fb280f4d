"""Everything that exists while the node is configured, from the robot to the bag."""

from __future__ import annotations

from contextlib import ExitStack, closing
from functools import partial
from pathlib import Path

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.clock import Clock, ClockChange, JumpThreshold, TimeJump
from rclpy.clock_type import ClockType
from rclpy.duration import Duration
from rclpy.lifecycle import LifecycleNode

from ff_planner_ros.bag.writer import unique_directory
from ff_planner_ros.common.share import resolve_uri
from ff_planner_ros.common.shown import in_log
from ff_planner_ros.common.times import NANOSECONDS
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.parameters.node import ANY_AGE, NodeParameters
from ff_planner_ros.planning.scenario.library_file import load_library
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.urdf.sdf import urdf_of
from ff_planner_ros.ros.inputs.locked_joints import measured_robot
from ff_planner_ros.ros.inputs.middleware import Middleware, namesakes
from ff_planner_ros.ros.inputs.scene_input import SceneInput
from ff_planner_ros.ros.inputs.state_input import Snapshot, StateInput
from ff_planner_ros.ros.outputs.clock_health import LOG_PERIOD, ClockWatch
from ff_planner_ros.ros.outputs.diagnostics import NodeHealth, diagnostics
from ff_planner_ros.ros.outputs.exchanges import Exchanges
from ff_planner_ros.ros.outputs.plan_output import PlanOutput
from ff_planner_ros.ros.qos import create_publisher
from ff_planner_ros.ros.recorder.recording import recording
from ff_planner_ros.ros.requests.description import description_service
from ff_planner_ros.ros.requests.planning_service import PlanningService
from ff_planner_ros.ros.requests.solver import Solver
from ff_planner_ros.ros.topics import DIAGNOSTICS, OBSTACLES, PLANNED_JOINT_STATES, heard_with

# Longest wait for the answer to a request that was given up [s].
_LAST_ANSWER = 2.0


class Session:
    """One configured planner: inputs, outputs, service, action, recorder, timers."""

    def __init__(self, node: LifecycleNode, parameters: NodeParameters, solver: Solver) -> None:
        """Load robot and library, start to record, and connect.

        Raises:
            InvalidInput: The robot or the library is refused.
        """
        self._node, self._parameters, self._solver = node, parameters, solver
        self._namesakes: list[str] = []
        self._clock = ClockWatch(node)
        urdf = resolve_uri(parameters.robot.urdf, relative_to=Path.cwd())
        self._description = parameters.robot.description(urdf)
        robot = parameters.robot.load(self._description, urdf.parent)
        self._robot, self._urdf = robot, urdf
        for note in robot.notes:
            node.get_logger().warning(f"robot.urdf: {in_log(note)}")
        library = None
        if parameters.library:
            library = load_library(
                Path(parameters.library).expanduser().absolute(), "planner.library"
            )
            plans = len(library.plans)
            node.get_logger().info(f"planner.library: {plans} plans in {parameters.library}")
        self._bag = unique_directory(Path(parameters.bag.directory).resolve(), "ff_planner")
        with ExitStack() as stack:
            recorded = stack.enter_context(ExitStack())  # closed last: it hears all others close
            self._output = stack.enter_context(closing(PlanOutput(node, robot, parameters)))
            self._middleware = stack.enter_context(
                closing(Middleware(node, parameters.allow_several_publishers))
            )
            self._states = StateInput(robot, parameters, self._middleware)
            load = partial(parameters.robot.load, self._description, urdf.parent)
            self._robots = measured_robot(parameters.robot, robot, load, self._renewed)
            self._scenes = SceneInput(parameters.inertial_frame, self._middleware)
            exchanges = stack.enter_context(
                closing(Exchanges(node, robot.drawn_urdf, parameters.inertial_frame))
            )
            self._diagnostics = create_publisher(node, DIAGNOSTICS)
            stack.callback(node.destroy_publisher, self._diagnostics)
            self._recorder = recorded.enter_context(recording(node, parameters, robot, self._bag))
            # Nobody learns more from a preview by reading it twice.
            preview = node.resolve_topic_name(PLANNED_JOINT_STATES.name)
            self._recorder.leave_out(preview, self._output.preview.is_repeated)
            self._service = stack.enter_context(
                closing(
                    PlanningService(
                        node,
                        parameters,
                        robot,
                        solver,
                        self._states,
                        self._scenes,
                        self._output,
                        exchanges,
                        run_name=self._bag.name,
                        library=library,
                        robots=self._robots,
                    )
                )
            )
            described = robot, parameters, lambda: self._service.is_active
            stack.enter_context(description_service(node, *described))
            for rate, callback in (
                (parameters.rates.predicted_pose, self._stream),
                (parameters.rates.diagnostics, self._diagnose),
            ):
                # Each on its own: reading thousands of spheres must not hold up a pose. And apart
                # from the lifecycle's services, whose transitions may wait for an answer.
                group = MutuallyExclusiveCallbackGroup()
                # Steady: simulated time that stands still, or jumps, must not silence the node.
                clock = Clock(clock_type=ClockType.STEADY_TIME)
                timer = node.create_timer(1.0 / rate, callback, group, clock)
                stack.callback(node.destroy_timer, timer)
                if callback == self._stream:
                    self._streaming = timer
                    self._output.published_one = timer.reset
            jumps = node.get_clock().create_jump_callback(
                JumpThreshold(min_forward=None, min_backward=Duration(nanoseconds=-1)),
                post_callback=self._forget,
            )
            stack.callback(jumps.unregister)
            self._stack = stack.pop_all()

    def activate(self) -> None:
        """Publish the robot's description, and accept requests."""
        self._output.describe_robot(urdf_of(self._description))
        self._service.activate()
        recording = "not recording" if self._recorder.health.failure else "recording"
        name, joints = self._robot.model.name, ", ".join(self._robot.joint_names)
        of_robot = in_log(f"robot {name} of {self._urdf}, joints {joints}")
        self._node.get_logger().info(f"ready; {recording} to {self._bag}; {of_robot}")

    def stop_planning(self, status: Status, message: str) -> None:
        """Refuse new requests, give up the current one, and abort plans not yet handed over."""
        self._service.deactivate(status, message, _LAST_ANSWER)
        self._output.execution.withdraw(message)

    def close(self) -> None:
        """Disconnect, then close the bag."""
        self._stack.close()

    def _renewed(self, robot: Robot) -> None:
        """Take a robot whose locked joints are elsewhere, and with them the centre of mass."""
        self._output.transforms.use(robot)
        told = ", ".join(
            f"{one.name} at {one.position:g} {one.unit}" for one in robot.locked_joints
        )
        self._node.get_logger().info(in_log(f"locked where they are measured: {told}"))

    def _forget(self, jump: TimeJump) -> None:
        """Forget states and plans: the clock jumped back, or became another one."""
        self._states.clear()
        happened = f"the node's clock {_what_happened(jump)}"
        self._output.forget(happened)
        message, logger = f"{happened}: states and plans of before", self._node.get_logger()
        if jump.clock_change == ClockChange.ROS_TIME_NO_CHANGE:
            self._clock.jumped_back(-jump.delta.nanoseconds / NANOSECONDS)
            # Between two publishers of /clock it jumps a hundred times a second.
            logger.warning(f"{message} are forgotten", throttle_duration_sec=LOG_PERIOD)
        else:
            logger.warning(f"{message} are forgotten")
        self._service.give_up(Status.CLOCK_JUMPED, f"{message} are void; ask again")

    def _now_ns(self) -> int:
        return int(self._node.get_clock().now().nanoseconds)

    def _newest_state(self, *limits: float) -> Snapshot:
        return self._states.snapshot(self._now_ns(), *limits)

    def _stream(self) -> None:
        """Publish the measured chaser, and what a plan predicts for now."""
        told = self._parameters.tf.measured
        streams = self._output.is_streamed
        if not (told or streams):
            self._streaming.cancel()  # until a plan is published: nobody asks for the state
            return
        measured = self._measured()
        if told and measured is not None:
            self._output.transforms.measured(measured.state, measured.stamp_ns)
        if streams:
            self._output.stream(measured)

    def _measured(self) -> Snapshot | None:
        """Return the newest state; None: there is none that can be used."""
        now = self._parameters
        try:
            return self._newest_state(now.state_max_age, now.state_future_tolerance)
        except InvalidInput:
            return None

    def _diagnose(self) -> None:
        self._output.preview.look_for_viewers(1 if self._recorder.listens else 0)
        self._service.look()
        now, clock = self._parameters, self._node.get_clock().now()
        state_age, state_refusal = None, ""
        try:
            limits = ANY_AGE, now.state_future_tolerance, now.locked_joint_tolerance
            stamp_ns = self._newest_state(*limits).stamp_ns
            if self._robots is not None:
                self._robots.require(self._states.locked.positions())
            state_age = (clock.nanoseconds - stamp_ns) / NANOSECONDS
        except InvalidInput as error:
            if error.status is not Status.NO_STATE:
                state_age, state_refusal = 0.0, str(error)
        obstacles, bodies, obstacles_source, obstacles_refusal = None, 0, "", ""
        obstacles_age: float | None = None
        try:
            scene = self._scenes.scene()
            bodies = sum(not one.is_sphere for one in scene.obstacles)
            obstacles, obstacles_source = len(scene.obstacles) - bodies, scene.source
            if scene.stamp_ns:
                obstacles_age = (clock.nanoseconds - scene.stamp_ns) / NANOSECONDS
            self._scenes.moving_scene(
                None, clock.nanoseconds, now.state_future_tolerance, now.obstacles_max_age
            )
        except InvalidInput as error:
            if error.status is not Status.NO_OBSTACLES:
                obstacles, obstacles_refusal = obstacles or 0, str(error)
        target_age, target_refusal = None, ""
        try:
            seen = self._scenes.target_body(
                None, clock.nanoseconds, ANY_AGE, now.state_future_tolerance
            )
            target_age = (clock.nanoseconds - seen.stamp_ns) / NANOSECONDS
        except InvalidInput as error:
            if error.status is not Status.NO_TARGET_BODY:
                target_age, target_refusal = 0.0, str(error)
        health = NodeHealth(
            state_age=state_age,
            state_max_age=now.state_max_age,
            state_refusal=state_refusal,
            state_since=self._states.since,
            state_clock_offset=self._states.clock_offset,
            obstacles=obstacles,
            obstacle_bodies=bodies,
            obstacles_source=obstacles_source,
            obstacles_age=obstacles_age,
            obstacles_refusal=obstacles_refusal,
            target_age=target_age,
            target_max_age=now.target_max_age,
            target_refusal=target_refusal,
            unheard=self._unheard(),
            obstacles_are_published=bool(self._middleware.heard(OBSTACLES.name)),
            target_clock_offset=self._scenes.target_clock_offset,
            controller=self._output.execution.health(self._robot),
            last=self._service.last,
            solve_times=tuple(self._service.solve_times),
            solver_is_warm=self._solver.is_warm,
            namesakes=self._other_planners(),
            recorder=self._recorder.health,
            tracking=self._output.tracking,
            allowed=now.tracking,
            clock=self._clock.health(clock.nanoseconds),
        )
        name = self._node.get_fully_qualified_name()
        self._diagnostics.publish(diagnostics(health, name, clock.to_msg()))

    def _unheard(self) -> dict[str, list[str]]:
        """Return words on publishers that the node cannot hear, by topic."""
        topics = (topic.name for topic in heard_with(self._parameters.state_source))
        return {name: words for name in topics if (words := self._middleware.unheard(name))}

    def _other_planners(self) -> list[str]:
        """Return the nodes that serve the same requests, and tell of a change in the log."""
        found = namesakes(self._node)
        if found and found != self._namesakes:
            names = ", ".join(found)
            self._node.get_logger().error(f"the same requests are answered by {names}, too")
        self._namesakes = found
        return found


def _what_happened(jump: TimeJump) -> str:
    """Return words on what a clock has done."""
    if jump.clock_change == ClockChange.ROS_TIME_ACTIVATED:
        return "is the simulated one from now on"
    if jump.clock_change == ClockChange.ROS_TIME_DEACTIVATED:
        return "is the system's from now on"
    return f"has jumped back by {-jump.delta.nanoseconds / NANOSECONDS:.3f} s"
