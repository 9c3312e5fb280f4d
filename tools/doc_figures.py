"""What README.md and docs/ say of the benchmark: its tables, and sentences with its figures.

All of it is from docs/benchmark.json, which `make figures` measures anew, and docs/engines.json.
"""

from __future__ import annotations

import json
from pathlib import Path
from textwrap import dedent

from ff_planner_ros.common.text_table import table_lines

DOCS = Path(__file__).resolve().parents[1] / "docs"
FIGURES, ENGINES = (
    json.loads((DOCS / name).read_text(encoding="utf-8"))
    for name in ("benchmark.json", "engines.json")
)
FIGURES["tables"] += ENGINES["tables"]
MACHINE = FIGURES["machine"]["machine"].partition(",")[0]


def tables(names: str) -> str:
    """Return the tables of measurements, and what they were measured on, as they are printed."""
    blocks = []
    for name in names.split(", "):
        if name == "machine":
            blocks.append("\n".join(f"{key:8}  {value}" for key, value in FIGURES[name].items()))
        for table in FIGURES["tables"]:
            if table["of"] == name:
                lines = table_lines(table["title"], table["header"], table["rows"])
                blocks.append("\n".join(lines))
    text = "\n\n".join(blocks)
    return f"```\n{text}\n```\n"


def benchmark_in_short() -> str:
    beliefs = ("zero momentum", "fixed base", "fixed base, no drift")
    misled = [(kind, belief) for kind in ("ordinary", "cluttered") for belief in beliefs]
    collide = [cell("executions", "collide", *row) for row in misled]
    missed = [number(cell("executions", "miss, median [mm]", *row)) / 10.0 for row in misled]
    inside = -number(papers("clearance [mm]", "min(Theta)"))
    assert inside > 0.0, "the paper's way ends outside every obstacle: say so"
    longer, steadier = papers("time / ours", "min(L)"), papers("value [rad]", "min(Theta)")
    rows = {
        f"a warm search on one core of an {MACHINE}, in processor time": "",
        "---": "---",
        "the paper's capture (lines), shortest joint path": f"{ours('time [s]', 'min(L)')} s",
        "the same by the paper's method (SciPy's SLSQP, finite differences)": f"{longer} times "
        "as long",
        "the paper's capture, least rotation of the chaser": f"{ours('time [s]', 'min(Theta)')} s, "
        f"{ours('value [rad]', 'min(Theta)')} rad",
        "the same by the paper's method": f"{steadier} rad, {inside:.1f} mm inside an obstacle",
        "ordinary scenarios, drawn at random": _found("ordinary"),
        "cluttered scenarios": _found("cluttered"),
        "bodies that tumble at up to 10 deg/s": f"{solved('captures')} captured",
        "1000 spheres instead of 3": f"{cell('scaling', 'time / 3', '1000')} times as long",
        "500 points instead of 50": f"{cell('scaling', 'time / 50', '500')} times as long",
        "plans for a fixed base or zero momentum, on the true system": f"{least(collide)} % to "
        f"{most(collide)} % collide, {min(missed):.0f} to {max(missed):.0f} cm off the goal "
        "(medians)",
    }
    return "".join(f"| {what} | {figure} |\n" for what, figure in rows.items())


def waiting_in_short() -> str:
    (table,) = (one for one in FIGURES["tables"] if one["of"] == "installation")
    rows = ["| a default installation, by the wall clock |  |", "| --- | --- |"]
    for asked, *_ in table["rows"]:
        median, slow, rest = (
            cell("installation", column, asked)
            for column in ("p50 [s]", "p95 [s]", "beside the search, p50 [s]")
        )
        apart = "" if rest == "-" else f"; {rest} s are not the search"
        rows.append(f"| {asked} | median {median} s, 95 % within {slow} s{apart} |")
    return "".join(f"{row}\n" for row in rows)


def _found(kind: str) -> str:
    """Return how many scenarios of a kind are solved, and in what time."""
    median, slow = (cell("scenarios", f"{one} [s]", kind, "all") for one in ("median", "95 %"))
    return f"{solved('scenarios', kind=kind)} solved, median {median} s, 95 % within {slow} s"


def capture_times() -> str:
    shortest, steadiest = (ours("time [s]", objective) for objective in ("min(L)", "min(Theta)"))
    return (
        f"{shortest} s of CPU for the shortest joint path and {steadiest} s for the least attitude"
    )


def quick_search() -> str:
    return _search("quick")


def normal_search() -> str:
    return _search("normal")


def thorough_search() -> str:
    return _search("thorough")


def _search(depth: str) -> str:
    seconds, nearness, worst = (
        cell("steadiness", column, depth)
        for column in ("processor time, median [s]", "attitude / best, median", "worst")
    )
    return f"{seconds} s | {nearness} and {worst}"


def captures_in_short() -> str:
    far, turned, fast = (
        most(cells("captures", column))
        for column in ("apart in MuJoCo [mm]", "[deg]", "moving apart [mm/s]")
    )
    medians, slow = (cells("captures", column) for column in ("median [s]", "95 % [s]"))
    return dedent(
        f"""\
        `ff-planner-benchmark bench` captures {cell("captures", "problems", "tumbling")} bodies
        of each of {len(medians)}
        [classes](../explanation/benchmark.md#captures-of-bodies-that-tumble). It finds a plan for
        {solved("captures")}, in {least(medians)} s to {most(medians)} s of processor time (medians
        of the classes), and in {least(slow)} s to {most(slow)} s for 95 %,
        on one core of an {MACHINE}. Executed in MuJoCo, end effector and grasp are at most {far} mm
        and {turned} deg apart at the capture, and move apart at {fast} mm/s at most.
        """
    )


def random_starts() -> str:
    kind = "random start"
    iterations = [one["iterations"] for one in FIGURES["joint goals"] if one["kind"] == kind]
    solved_ones = [count for count in iterations if count]
    median, slow = (cell("joint goals", column, kind) for column in ("median [s]", "95 % [s]"))
    return dedent(
        f"""\
        | | Misra and Bai (2017) | here |
        | --- | --- | --- |
        | random starts with a plan | 92 % | {solved("joint goals", kind=kind)} |
        | convex programs, in the mean | 17.2 | {sum(solved_ones) / len(solved_ones):.1f} |
        | time | about 12 s | {median} s in the median, {slow} s for 95 % |
        | terminal error | 1e-4 | {cell("joint goals", "largest error [m, rad]", kind)} |
        """
    )


def cells(of: str, column: str, *row: str) -> list[str]:
    """Return the cells of a measurement's column, in the rows that begin with some cells."""
    return [
        cells[table["header"].index(column)]
        for table in FIGURES["tables"]
        if table["of"] == of and column in table["header"]
        for cells in table["rows"]
        if cells[: len(row)] == list(row)
    ]


def cell(of: str, column: str, *row: str) -> str:
    """Return the cell of a column in the only row that begins with some cells."""
    (found,) = cells(of, column, *row)
    return found


def ours(column: str, objective: str) -> str:
    """Return a cell of the planner's row in the table of methods."""
    return cell("methods", column, objective, "ff_planner")


def papers(column: str, objective: str) -> str:
    """Return a cell of the row of the paper's method."""
    return cell("methods", column, objective, "direct (paper)")


def solved(of: str, **where: str) -> str:
    """Return how many attempts of a measurement found a plan."""
    results = [one for one in FIGURES[of] if where.items() <= one.items()]
    return f"{sum(one['status'] == 'SOLVED' for one in results)} of {len(results)}"


def number(text: str) -> float:
    return float(text.rstrip("%"))


def least(values: list[str]) -> str:
    return min(values, key=number).rstrip("%")


def most(values: list[str]) -> str:
    return max(values, key=number).rstrip("%")


def above(ratio: str) -> str:
    """Return by how much a ratio exceeds one."""
    return f"{100.0 * number(ratio) - 100.0:.0f} %"
