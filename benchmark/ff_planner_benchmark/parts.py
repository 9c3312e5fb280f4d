"""The parts of a plan, in which engines execute it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, replace
from itertools import pairwise

import numpy as np

from ff_planner_ros.planning.motion.plan import Trajectory


def parts_of(trajectory: Trajectory, parts: int) -> Iterator[tuple[float, Trajectory]]:
    """Yield the parts of a plan, each from time zero on, and when each begins [s]."""
    times = trajectory.time - trajectory.time[0]
    ends = np.linspace(0, len(times) - 1, parts + 1).astype(int)
    for begin, end in pairwise(ends):
        rows = {
            one.name: getattr(trajectory, one.name)[begin : end + 1] for one in fields(trajectory)
        }
        part = replace(trajectory, **rows | {"time": times[begin : end + 1] - times[begin]})
        yield float(times[begin]), part
