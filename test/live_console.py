"""A console on a running node, and the world around the node."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

from quick_capture import resting_capture
from ros_processes import DEADLINE, Client, Scene, wait_for

from ff_planner_ros.console.entries import Entry
from ff_planner_ros.console.live.open import LivePage, live_page
from ff_planner_ros.console.serve import serve

SCENE = Scene(resting_capture())
# Of plans, and of states: no machine is too slow [s].
LEAD, AGE = 300.0, 60.0
VALUES = {"state_max_age": AGE, "planning_lead_time": LEAD, "state_future_tolerance": AGE}
VALUES |= {"time_budget": LEAD}
ARGUMENTS = [word for name, value in VALUES.items() for word in ("-p", f"{name}:={value}")]
ARGUMENTS += ["-p", "end_behaviour:=stop_joints"]


class World:
    """The chaser's state on its topic, again and again, and the obstacles."""

    def __init__(self, client: Client) -> None:
        self.client, self.aside, self.mount = client, 0.0, 0.0  # [m]; [rad] of a fixed joint
        client.publish_obstacles(SCENE.obstacles())
        client.node.create_timer(0.1, self._publish)

    def _publish(self) -> None:
        state = SCENE.state(self.client.now_ns())
        state.pose.position.x += self.aside
        state.joint_names = [*state.joint_names, "end_effector_mount"]
        state.joint_positions = [*state.joint_positions, self.mount]
        state.joint_velocities = [*state.joint_velocities, 0.0]
        self.client.publish_state(state)


class Console:
    """A console without a browser."""

    def __init__(self, live: LivePage) -> None:
        self.served = serve(live.page_on, "127.0.0.1", 8800)
        self.live, self.page, self.panel = live, self.served.page, live._panel
        wait_for(lambda: self.page.task is not None, "the goal")

    def plan(self) -> Entry:
        """Plan, and return what is shown then."""
        self.page.plan()
        while self.page.search is not None:
            self.page.search.wait()
        return self.page.chosen

    def entry(self, name: str) -> Entry | None:
        return next((one for one in self.page.entries if one.name == name), None)

    def status(self, name: str) -> str:
        found = self.entry(name)
        return "" if found is None else found.status

    def shows(self, words: str) -> bool:
        return any(
            words in one.content
            for one in (
                self.panel._state,
                self.panel._fit,
                self.panel._said,
                self.panel._deviations,
            )
        )


@contextmanager
def opened_console() -> Iterator[Console]:
    live = live_page("ff_planner", None, DEADLINE, [])
    console = Console(live)
    try:
        yield console
    finally:
        live.close()
        console.served.server.stop()


def ask_for_the_capture(console: Console) -> None:
    task = console.page.task
    assert task is not None
    target, duration = SCENE.problem.target, SCENE.problem.duration
    problem = replace(task.problem, target=target, duration=duration)
    console.page.change(replace(task, problem=problem))
