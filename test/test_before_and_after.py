"""The planner with its core and with the references in its place makes the same plans."""

from __future__ import annotations

from collections.abc import Callable

import before_and_after
import pytest
from reference_core import core_by_reference

from ff_planner_ros.core import compiled
from ff_planner_ros.planning.paths.end_effector_polynomial import EndEffectorPaths

pytestmark = pytest.mark.ci


def test_plans_made_with_the_core_are_those_of_its_references(
    times: Callable[[int, int], int],
) -> None:
    """One of each class, of lines and bodies, both path families, at rest and tumbling."""
    nearest = "lemur_capture, L + Theta, quick"
    kept = ("lemur_capture, min(L)", nearest, "planar_capture", "bodies", "tumbling")
    # Many joint paths turn the chaser equally little: rounding decides for one of them.
    asked = [
        (kind, task)
        for kind, task in before_and_after.tasks(times(1, 3))
        if (times(0, 1) or kind in kept) and "min(Theta)" not in kind
    ]
    found = [before_and_after.pair(*one, 1) for one in asked]
    for one in found:
        assert one.apart <= before_and_after.SAME, one
    rows = list(before_and_after.rows(found))
    assert {row[0] for row in rows} >= set(kept)
    assert {len(row) for row in rows} == {len(before_and_after.HEADER)}


def test_the_papers_way_is_run_on_both() -> None:
    ours = {"min(L)": 0.05, "min(Theta)": 0.5, "L + Theta": 0.5}
    rows = list(before_and_after.direct_rows(1, ours))
    assert [row[0] for row in rows] == list(ours)
    assert {len(row) for row in rows} == {len(before_and_after.DIRECT_HEADER)}


def test_nothing_of_the_core_is_left_while_the_references_are_in_its_place() -> None:
    before = compiled.velocity, EndEffectorPaths.motion
    with core_by_reference():
        for name in ("velocity", "end_effector_motion", "certified_clearance", "DrivenMotion"):
            with pytest.raises(AssertionError, match="the search asked the core"):
                getattr(compiled, name)()
    assert (compiled.velocity, EndEffectorPaths.motion) == before
