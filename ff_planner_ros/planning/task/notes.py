"""Notes for the user on the problem that a plan was made for."""

from __future__ import annotations

from collections.abc import Sequence

from ff_planner_ros.planning.problem.obstacles import ObstacleBody

# Of a hull's volume beyond its mesh's [%], and meshes that a note names.
_MUCH, _MOST_TOLD = 10.0, 5


def hull_notes(bodies: Sequence[ObstacleBody]) -> tuple[str, ...]:
    """Return a note on meshes whose convex hulls have over 10 % more volume; empty: none has."""
    larger = {one.id: 100.0 * (one.solid.hull_share - 1.0) for one in bodies}
    told = [f"{name} by {by:.0f} %" for name, by in larger.items() if by > _MUCH]
    if not told:
        return ()
    more = f" and {len(told) - _MOST_TOLD} more" if len(told) > _MOST_TOLD else ""
    names = ", ".join(told[:_MOST_TOLD])
    return (f"meshes count by their convex hulls, which have more volume: {names}{more}",)
