"""Joining ROS: what rclpy cannot do there is a refusal in plain words, not a traceback."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterator
from contextlib import contextmanager

from ff_planner_ros.errors import InvalidInput, Status

# Of the environment; rcl takes exactly these values for a demand.
_ENABLE, _STRATEGY, _KEYSTORE = (
    f"ROS_SECURITY_{name}" for name in ("ENABLE", "STRATEGY", "KEYSTORE")
)
_DEMANDED, _ENFORCED = "true", "Enforce"


@contextmanager
def joining_ros() -> Iterator[None]:
    """Refuse what rclpy raises while a process initialises ROS or creates its first node.

    Raises:
        InvalidInput: The arguments, or security is demanded that cannot be had.
    """
    try:
        with warnings.catch_warnings():
            # Of what rclpy cannot undo after it has failed.
            warnings.simplefilter("ignore", RuntimeWarning)
            yield
    except RuntimeError as error:  # what rclpy raises has no narrower public name
        reason = str(error).splitlines()[0]
        if os.environ.get(_ENABLE) != _DEMANDED:
            raise InvalidInput(Status.OUT_OF_RANGE, "ROS arguments", "refused", reason) from None
        keystore = os.environ.get(_KEYSTORE) or "not set"
        raise InvalidInput(
            Status.OUT_OF_RANGE,
            _ENABLE,
            _DEMANDED,
            f"security cannot be had: {reason}. It needs {_KEYSTORE} ({keystore}), an enclave in "
            "it, and a DDS with security, which the ROS wheels from PyPI do not have: see "
            "docs/how_to/security.md, or set it to false",
        ) from None


def security_gap() -> str:
    """Return words on security that is asked for and may silently be left out; empty: none."""
    if os.environ.get(_ENABLE) == _DEMANDED and os.environ.get(_STRATEGY) != _ENFORCED:
        return (
            f"{_ENABLE} is true, but {_STRATEGY} is not {_ENFORCED}: without keys this node runs "
            "without security"
        )
    return ""
