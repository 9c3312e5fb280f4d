"""The table of lines and shapes: what it counts, and that its problems can be planned."""

from __future__ import annotations

from ff_planner_benchmark.bench.geometries import (
    _HEADER,
    GeometryAttempt,
    crowded_problems,
    crowds,
    geometry_attempt,
    geometry_rows,
)
from ff_planner_ros.errors import Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.robot.collision.geometry import Geometry

SETTINGS = load_parameters().planner


def made(number: int, geometry: Geometry, seconds: float, *touches: str) -> GeometryAttempt:
    status = Status.SOLVED if seconds else Status.COLLISION
    outcome = {"status": status, "message": "", "seconds": seconds}
    return GeometryAttempt("arm6", number, "min(L)", geometry, touches, **outcome)


def test_the_table_counts_what_is_solved_what_touches_and_how_long_it_takes() -> None:
    lines = [made(0, Geometry.LINES, 1.0, "a/b"), made(1, Geometry.LINES, 2.0)]
    lines += [made(2, Geometry.LINES, 1.0, "a/b", "a/c"), made(3, Geometry.LINES, 0.0)]
    shapes = [made(0, Geometry.SHAPES, 1.5), made(1, Geometry.SHAPES, 2.0)]
    shapes += [made(2, Geometry.SHAPES, 0.0), made(3, Geometry.SHAPES, 9.0)]
    both, of_robot = geometry_rows([*lines, *shapes])
    assert dict(zip(_HEADER, both, strict=True)) == {
        "objective": "min(L)",
        "robot": "all",
        "problems": "4",
        "lines: solved": "75.0%",
        "lines: touch": "66.7%",
        "shapes: solved": "75.0%",
        "shapes: touch": "0.0%",
        "time, shapes / lines": "1.25",
    }
    assert of_robot[1:] == ("arm6", *both[2:])


def test_a_problem_is_planned_with_lines_and_with_shapes() -> None:
    lines, shapes = (
        geometry_attempt("arm6", 0, "min(L)", geometry, SETTINGS)
        for geometry in (Geometry.LINES, Geometry.SHAPES)
    )
    assert lines.solved
    assert shapes.solved
    assert lines.touches  # seen from outside by test_whole_bodies, too
    assert shapes.touches == ()


def test_crowds_are_planned_among_as_many_spheres_as_asked_for() -> None:
    problem = crowded_problems()["arm6"]
    (few, many) = crowds({"arm6": problem}, SETTINGS, (3, 8), runs=1)
    assert (few.spheres, many.spheres) == (3, 8)
    assert min(few.lines, few.shapes, many.lines, many.shapes) > 0.0
    assert all(len(one.obstacles) == 3 for one in crowded_problems().values())
