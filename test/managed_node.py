"""A planner node's lifecycle and parameters from outside, and what its process holds."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import Any, NamedTuple

from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from ros_processes import DEADLINE, Client


class Manager:
    """Drives the node through its states and sets its parameters."""

    def __init__(self, client: Client) -> None:
        create = client.node.create_client
        self._change = create(ChangeState, "ff_planner/change_state")
        self._get = create(GetState, "ff_planner/get_state")
        self._set = create(SetParameters, "ff_planner/set_parameters")
        for service in (self._change, self._get, self._set):
            assert service.wait_for_service(DEADLINE)
        # The node may find who asks before it finds the way back: a first answer can be lost.
        assert any(_asked(self._get, GetState.Request())[1].wait(1.0) for _ in range(int(DEADLINE)))

    def change(self, *transitions: int) -> list[bool]:
        """Ask for transitions; which of them succeed."""
        return [
            _answer(self._change, ChangeState.Request(transition=Transition(id=one))).success
            for one in transitions
        ]

    def state(self) -> int:
        return int(_answer(self._get, GetState.Request()).current_state.id)

    def set(self, name: str, value: object) -> Any:
        message = Parameter(name, value=value).to_parameter_msg()
        (result,) = _answer(self._set, SetParameters.Request(parameters=[message])).results
        return result

    def configure_with(self, name: str, value: object) -> None:
        """Let an active node go on with another value."""
        assert self.change(Transition.TRANSITION_DEACTIVATE, Transition.TRANSITION_CLEANUP)
        result = self.set(name, value)
        assert result.successful, result.reason
        there = (Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_ACTIVATE)
        assert self.change(*there) == [True, True]


def _answer(client: Any, request: Any) -> Any:
    future, done = _asked(client, request)
    assert done.wait(DEADLINE), "the planner did not answer"
    return future.result()


def _asked(client: Any, request: Any) -> tuple[Any, threading.Event]:
    done = threading.Event()
    future = client.call_async(request)
    future.add_done_callback(lambda _: done.set())
    return future, done


class Holdings(NamedTuple):
    """What a process holds.

    Attributes:
        memory: Resident [kB].
        threads: How many.
        files: Open descriptors.
    """

    memory: int
    threads: int
    files: int


def holdings(process: int) -> Holdings:
    """Return what a process holds by now."""
    own = Path(f"/proc/{process}")
    memory = int((own / "status").read_text().partition("VmRSS:")[2].split()[0])
    return Holdings(memory, len(list((own / "task").iterdir())), len(list((own / "fd").iterdir())))
