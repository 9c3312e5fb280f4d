"""The command about scenario and study files: check."""

from __future__ import annotations

import json
from argparse import Namespace
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ff_planner_ros.commands import BAD_INPUT, SOLVED
from ff_planner_ros.commands.options import Add, refuse_given
from ff_planner_ros.commands.printed import print_notes
from ff_planner_ros.errors import InvalidInput

if TYPE_CHECKING:
    from ff_planner_ros.analysis.scene_distances import Gap
    from ff_planner_ros.planning.problem.problem import PlanningProblem
    from ff_planner_ros.planning.scenario.scenario import Defaults

# Distances that are printed, the smallest first.
_PRINTED = 10
_OF_STUDIES = {"scenarios", "generated", "bag"}


def add_check(add: Add) -> None:
    """Add `check`."""
    check = add(
        "check",
        check_files,
        "list everything that is wrong with scenario or study files",
        description="Read scenario and study files and list all of their faults: line, key, value "
        "and what is allowed. Of a scenario without faults, print how far robot, obstacles and "
        "target are apart at the start and, where the goal fixes the tool, at the goal. Nothing is "
        "planned.",
        epilog="Exit code: 0 nothing is wrong, 2 something is.",
    )
    what = check.add_mutually_exclusive_group(required=True)
    what.add_argument("files", type=Path, nargs="*", default=[], metavar="FILE")
    schema_help = "print the JSON Schema of such files for editors; config/schemas has it, too"
    what.add_argument("--schema", choices=("scenario", "study"), help=schema_help)
    parameters_help = "the node's parameters: they count where a scenario does not say"
    check.add_argument("--parameters", type=Path, metavar="FILE", help=parameters_help)


def check_files(options: Namespace) -> int:
    """Print every fault of scenario and study files, or that they have none, and distances."""
    from ff_planner_ros.common.yaml_file import located
    from ff_planner_ros.parameters import load_parameters
    from ff_planner_ros.planning.scenario.scenario import Defaults

    if options.schema is not None:
        refuse_given(options, {"parameters": None}, "a schema is the same for all of them")
        return _print_schema(options.schema)
    parameters = load_parameters(options.parameters)
    defaults = Defaults(parameters.planner)
    if options.parameters is not None:
        defaults = parameters.of_scenarios()
    code = SOLVED
    for path in options.files:
        try:
            problem, notes = _load(path, defaults, options.parameters)
        except InvalidInput as error:
            code = BAD_INPUT
            for one in located(path, error).faults:
                print(one)
            continue
        print_notes(notes)
        print(f"{path}: nothing is wrong with it")
        if problem is not None:
            _print_scene(problem)
    return code


def _load(
    path: Path, defaults: Defaults, parameters: Path | None
) -> tuple[PlanningProblem | None, tuple[str, ...]]:
    """Read a study, which has no robot but sources, or else a scenario, with notes on it."""
    from ff_planner_ros.common.yaml_file import read_yaml

    document = read_yaml(path)
    if isinstance(document, dict) and "robot" not in document and _OF_STUDIES & document.keys():
        from ff_planner_ros.campaign.study import load_study

        notes = load_study(path).notes
        own = f"{path} is a study, which names its own parameters"
        return None, notes if parameters is None else (*notes, own)
    from ff_planner_ros.planning.scenario.scenario import load_task
    from ff_planner_ros.planning.task.notes import notes_on_files

    task = load_task(path, defaults)
    return task.problem, notes_on_files(task)


def _print_scene(problem: PlanningProblem) -> None:
    from ff_planner_ros.analysis.scene_distances import gaps_at_goal, gaps_at_start

    _print_gaps("At the start", gaps_at_start(problem))
    goal = gaps_at_goal(problem)
    if goal is None:
        print("\nAt the goal: not known, it leaves open how the tool is turned there")
    elif problem.obstacles and not goal:
        print("\nAt the goal: not known, the tool has no shape")
    else:
        _print_gaps(f"Of the tool at the goal, after {problem.duration:g} s", goal)


def _print_gaps(title: str, gaps: Sequence[Gap]) -> None:
    from ff_planner_ros.common.text_table import print_table

    if not gaps:
        print(f"\n{title}: nothing is in the way")
        return
    rows = [
        (
            f"{gap.body}/{gap.other}",
            f"{gap.distance:.4f}",
            ("may touch near the goal" if gap.allowed else "in contact")
            if gap.allowed or gap.distance <= 0.0
            else "",
        )
        for gap in gaps[:_PRINTED]
    ]
    print_table(title, ("nearest", "distance [m]", ""), rows)
    if len(gaps) > _PRINTED:
        print(f"and {len(gaps) - _PRINTED} more, further away")


def _print_schema(kind: str) -> int:
    if kind == "study":
        from ff_planner_ros.campaign.study import study_schema as schema
    else:
        from ff_planner_ros.planning.scenario.scenario import scenario_schema as schema
    print(json.dumps(schema(), indent=1))
    return SOLVED
