"""The lifecycle node `ff_planner`: what each transition creates and destroys."""

from __future__ import annotations

import traceback
from collections.abc import Callable

from lifecycle_msgs.srv import ChangeState
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn

from ff_planner_ros.common.shown import in_log
from ff_planner_ros.errors import FfPlannerError, Status
from ff_planner_ros.ros.parameters import ParameterServer
from ff_planner_ros.ros.requests.solver import Solver
from ff_planner_ros.ros.session import Session


class PlannerNode(LifecycleNode):
    """The planner as a lifecycle node; inactive, it refuses requests with NOT_ACTIVE."""

    def __init__(self, solver: Solver) -> None:
        """Declare the parameters; the solver, which plans, outlives the node.

        Raises:
            InvalidInput: A parameter is refused.
        """
        super().__init__("ff_planner")
        self._answer_illegal_transitions()
        self.parameters = ParameterServer(self)
        self.refusal: FfPlannerError | None = None  # why the last transition failed
        self._solver = solver
        self._session: Session | None = None

    def on_configure(self, _: LifecycleState) -> TransitionCallbackReturn:
        """Load the robot, start to record, and connect."""

        def configure() -> None:
            try:
                self._session = Session(self, self.parameters.fix(), self._solver)
            except BaseException:
                self.parameters.release()
                raise

        return self._attempt(configure)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Wait until the solver is loaded, then open the publishers and accept requests."""

        def activate() -> None:
            self._solver.wait_until_warm()
            super(PlannerNode, self).on_activate(state)  # opens the publishers
            if self._session is not None:
                self._session.activate()

        return self._attempt(activate)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Refuse requests, give up the current one, and close the publishers."""

        def deactivate() -> None:
            self.stop_planning(Status.NOT_ACTIVE, "the planner is not active any more")
            super(PlannerNode, self).on_deactivate(state)  # closes the publishers

        return self._attempt(deactivate)

    def on_cleanup(self, _: LifecycleState) -> TransitionCallbackReturn:
        """Disconnect and close the bag; requests that arrive meanwhile get NOT_ACTIVE."""
        return self._attempt(self._clean_up)

    def on_shutdown(self, _: LifecycleState) -> TransitionCallbackReturn:
        """Disconnect and close the bag, from any state."""
        return self._attempt(self.close)

    def on_error(self, _: LifecycleState) -> TransitionCallbackReturn:
        """Clean up, so that the node is unconfigured."""
        return self._attempt(self._clean_up)

    def stop_planning(self, status: Status, message: str) -> None:
        """Refuse new requests and give up the current one, with this status and message."""
        if self._session is not None:
            self._session.stop_planning(status, message)

    def close(
        self, status: Status = Status.SHUT_DOWN, message: str = "the planner was shut down"
    ) -> None:
        """Disconnect and close the bag, whatever state the node is in and without a transition.

        Args:
            status: Status of answers to requests that are given up or still arrive.
            message: Message of these answers.
        """
        self.stop_planning(status, message)
        session, self._session = self._session, None
        if session is not None:
            session.close()
        self.parameters.release()

    def _clean_up(self) -> None:
        self.close(Status.NOT_ACTIVE, "the planner was cleaned up: configure and activate it")

    def _attempt(self, action: Callable[[], None]) -> TransitionCallbackReturn:
        """Do one part of a transition; rclpy itself would swallow what goes wrong."""
        self.refusal = None
        try:
            action()
        except FfPlannerError as error:
            self.refusal = error
            self.get_logger().error(in_log(str(error)))
        except Exception as error:
            self.refusal = FfPlannerError(Status.INTERNAL_ERROR, f"{type(error).__name__}: {error}")
            self.get_logger().error(in_log(traceback.format_exc()))
        return (
            TransitionCallbackReturn.SUCCESS
            if self.refusal is None
            else TransitionCallbackReturn.FAILURE
        )

    def _answer_illegal_transitions(self) -> None:
        """Answer them with success=False; in rclpy 7.1 they raise out of the executor."""
        service = self._service_change_state
        change_state = service.callback

        def guarded(
            request: ChangeState.Request, response: ChangeState.Response
        ) -> ChangeState.Response:
            try:
                return change_state(request, response)
            except rclpy_implementation.RCLError as error:
                reason = str(error).splitlines()[0]
                self.get_logger().warning(f"lifecycle transition refused: {reason}")
                response.success = False
                return response

        service.callback = guarded
