"""The table of lines and shapes: what it counts, and that its problems can be planned."""

from __future__ import annotations

from ff_planner_benchmark.bench.experiment import Row
from ff_planner_benchmark.bench.plans import GEOMETRIES, _geometries
from ff_planner_benchmark.bench.prices import crowds
from ff_planner_benchmark.problems.classes import BODIES
from ff_planner_ros.parameters import load_parameters

SETTINGS = load_parameters().planner


def made(number: int, geometry: str, seconds: float, *touches: str) -> Row:
    status = "SOLVED" if seconds else "COLLISION"
    row = {"robot": "arm6", "number": number, "objective": "min(L)", "geometry": geometry}
    return row | {"touches": touches, "status": status, "message": "", "seconds": seconds}


def test_the_table_counts_what_is_solved_what_touches_and_how_long_it_takes() -> None:
    lines = [made(0, "lines", 1.0, "a/b"), made(1, "lines", 2.0)]
    lines += [made(2, "lines", 1.0, "a/b", "a/c"), made(3, "lines", 0.0)]
    shapes = [made(0, "shapes", 1.5), made(1, "shapes", 2.0)]
    shapes += [made(2, "shapes", 0.0), made(3, "shapes", 9.0)]
    table = GEOMETRIES.table([*lines, *shapes])
    both, of_robot = table.rows
    assert dict(zip(table.header, both, strict=True)) == {
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
    lines, shapes, *_ = _geometries(BODIES, 1, SETTINGS)
    assert lines["status"] == shapes["status"] == "SOLVED"
    assert lines["touches"]  # seen from outside by test_whole_bodies, too
    assert shapes["touches"] == []


def test_crowds_are_planned_among_as_many_spheres_as_asked_for() -> None:
    assert BODIES.robot(1) == "arm6"
    rows = list(crowds(1, SETTINGS))
    assert [row["spheres"] for row in rows if row["problem"] == "arm6"] == [3, 30]
    assert all(min(row["seconds"], row["seconds_beside"]) > 0.0 for row in rows)
