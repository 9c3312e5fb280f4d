"""The page of a running node: its first entry, and the thread that keeps it up to date."""

from __future__ import annotations

import threading
import traceback
from collections.abc import Sequence
from pathlib import Path
from queue import SimpleQueue

import numpy as np
import viser
from ff_planner_msgs.msg import Exchange, Goal, PlanRequest, PublishedPlan

from ff_planner_ros.common.times import NANOSECONDS
from ff_planner_ros.console.entries import Entry
from ff_planner_ros.console.live.link import Link
from ff_planner_ros.console.live.panel import NodePanel
from ff_planner_ros.console.live.plans import Plans
from ff_planner_ros.console.live.requests import Requests
from ff_planner_ros.console.page import Page
from ff_planner_ros.errors import FfPlannerError
from ff_planner_ros.planning.problem.posture import end_effector_at
from ff_planner_ros.ros.messages.requests import request_of_nothing, request_of_scenario
from ff_planner_ros.ros.requests.reading import Knowledge, measured_state, read_request

_PERIOD = 0.25  # [s] between looks
_DURATION = 10.0  # of a plan where no scenario says [s]
_GOAL = "goal"


class LivePage:
    """A page about one running node."""

    def __init__(self, link: Link, scenario: Path | None) -> None:
        """Store the arguments; `page_on` builds the page.

        Args:
            scenario: Scenario with the first goal; None: the end effector's measured position.
        """
        self._link, self._scenario = link, scenario
        self._of_others: SimpleQueue[Exchange] = SimpleQueue()
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._run, name="console looks", daemon=True)

    def page_on(self, server: viser.ViserServer) -> Page:
        """Build the page on a server, and keep it up to date from now on."""
        link = self._link
        plans = Plans(link, lambda entry: self._page.put(entry))
        lead = link.parameters.planning_lead_time
        requests = Requests(link, plans, self._start_ns, self._of_others.put)
        self._page = Page(server, [self._first()], requests, moves_obstacles=False)
        self._panel = NodePanel(server, self._page, link, plans, lead)
        self._plans = plans
        self._thread.start()
        return self._page

    def close(self) -> None:
        """Stop the updates, and leave ROS."""
        self._stopped.set()
        self._thread.join()
        self._link.close()

    def _start_ns(self) -> int:
        lead = float(self._panel.lead.value)
        if lead == self._link.parameters.planning_lead_time:
            return 0
        return self._link.now_ns() + round(lead * NANOSECONDS)

    def _first(self) -> Entry:
        """Return the entry of the first goal, not planned yet, as the node would read it now."""
        try:
            knowledge = self._link.knowledge
            task = read_request(self._request(knowledge), knowledge).task
        except FfPlannerError as error:
            return Entry(_GOAL, None, error=error, status="not known yet", words=str(error))
        return Entry(_GOAL, task, status="not planned")

    def _request(self, knowledge: Knowledge) -> PlanRequest:
        frame = knowledge.parameters.inertial_frame
        if self._scenario is not None:
            return request_of_scenario(self._scenario, frame, ())
        place = end_effector_at(knowledge.robot, measured_state((), knowledge).state)
        request = request_of_nothing(frame)
        request.duration, request.objective.joint_path_length = _DURATION, 1.0
        request.goal.orientation = Goal.FREE
        point = request.goal.pose.pose.position
        point.x, point.y, point.z = np.asarray(place.position).tolist()
        return request

    def _run(self) -> None:
        while not self._stopped.wait(_PERIOD):
            try:
                self._look()
            except FfPlannerError as error:
                self._link.node.get_logger().warning(str(error))
            except Exception:  # of one look; the end of the thread would not be noticed
                self._link.node.get_logger().error(traceback.format_exc())

    def _look(self) -> None:
        while not self._of_others.empty():
            self._page.put(self._plans.answered(self._of_others.get(), None))
        while not self._link.happened.empty():
            message = self._link.happened.get()
            if isinstance(message, PublishedPlan):
                self._plans.published(message)
            else:
                self._plans.happened(message)
        if len(self._page.entries) == 1 and self._page.entries[0].task is None:
            first = self._first()
            if first.task is not None or first.words != self._page.entries[0].words:
                self._page.put(first)
        self._link.look()
        self._panel.look()


def live_page(
    name: str, scenario: Path | None, patience: float, ros_arguments: Sequence[str]
) -> LivePage:
    """Return the page of a running node.

    Args:
        patience: How long to wait for the node [s].

    Raises:
        InvalidInput: The scenario is invalid, there is no such node, or it is not active.
        FfPlannerError: The node does not answer.
    """
    if scenario is not None:
        request_of_scenario(scenario, "", ())  # or else whoever opens the page would be told
    return LivePage(Link(name, patience, ros_arguments), scenario)
