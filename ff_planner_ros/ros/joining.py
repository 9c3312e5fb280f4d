"""Initialisation of ROS, with errors that say what to change instead of tracebacks."""

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
    """Turn rclpy's errors into `InvalidInput` while ROS is initialised or a first node created.

    Raises:
        InvalidInput: rclpy refuses the arguments, or security is enabled but not available.
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
    """Return a warning if ROS security is enabled but not enforced, else an empty string."""
    if os.environ.get(_ENABLE) == _DEMANDED and os.environ.get(_STRATEGY) != _ENFORCED:
        return (
            f"{_ENABLE} is true, but {_STRATEGY} is not {_ENFORCED}: without keys this node runs "
            "without security"
        )
    return ""
