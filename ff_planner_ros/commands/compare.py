"""Every method on one scenario: tables, the figures of the paper, a scene for the browser."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from textwrap import fill

from ff_planner_ros.analysis.comparison import (
    COLUMNS,
    RATIO_COLUMNS,
    Answer,
    comparison_rows,
    findings,
    ratio_rows,
)
from ff_planner_ros.analysis.drawing.figures import save_figures
from ff_planner_ros.analysis.drawing.scene import save_scene
from ff_planner_ros.analysis.methods import (
    FIXED_BASE,
    OBJECTIVES,
    PAPERS_METHODS,
    POTENTIAL_FIELD,
    SHORTEST,
    SHORTEST_SPLINE,
    SPLINES,
    STEADIEST,
    STEADIEST_SPLINE,
    STRAIGHT_LINE,
    WEIGHTED,
    ZERO_MOMENTUM,
    Method,
)
from ff_planner_ros.baselines.artificial_potential_field import artificial_potential_field
from ff_planner_ros.baselines.beliefs import fixed_base, zero_momentum
from ff_planner_ros.baselines.potential_field import PotentialFieldParameters
from ff_planner_ros.baselines.straight_line import straight_line
from ff_planner_ros.common.text_table import print_table
from ff_planner_ros.planning.check.preconditions import require_plannable
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.motion.system_frame import in_own_frame
from ff_planner_ros.planning.problem.problem import Parametrisation, PlanningProblem, lasting
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.search.planner import plan
from ff_planner_ros.planning.task.task import Method as Solver
from ff_planner_ros.planning.task.task import (
    PlanningTask,
    attempted,
    in_frame_of_user,
    without_search,
)

_WHY_RATIOS_DIFFER = (
    "They differ at least because the inertias of the paper's arm are not public, and ours only "
    "meet its total mass and the start's joint rates; one obstacle is assumed, too, and the optima "
    "may be other local ones. The values of its potential field are not printed: ours were chosen "
    "to come near its results, so that what involves APF proves nothing."
)
_PAPERS, _SPLINES = Parametrisation.END_EFFECTOR_POLYNOMIAL, Parametrisation.JOINT_SPLINE
_WIDTH = 100  # of the text on the terminal


def compare(
    problem: PlanningProblem,
    settings: PlannerSettings,
    field: PotentialFieldParameters,
    output: Path,
    of_the_paper: bool,
) -> bool:
    """Plan with every method, print the tables, draw, and tell whether any method made a motion.

    Args:
        problem: Its objective is replaced by each method's, a range of durations by its longest.
        field: Parameters of the artificial potential field.
        output: Directory for the pictures, created if it is missing.
        of_the_paper: Whether the problem is the paper's, whose ratios are then compared.

    Raises:
        InvalidInput: The start violates what every plan must keep.
        NoPlanFound: The goal is out of reach.
    """
    problem = lasting(problem, problem.durations.maximum)
    require_plannable(in_own_frame(problem), settings)
    output.mkdir(parents=True, exist_ok=True)
    answers = {}
    # Methods without an objective of their own are compared with min(L).
    shortest = replace(problem, objective=OBJECTIVES[SHORTEST])
    for method, solve in _solvers(field, shortest).items():
        asked = replace(
            shortest,
            objective=OBJECTIVES.get(method, shortest.objective),
            parametrisation=_SPLINES if method in SPLINES else _PAPERS,
        )
        begun = time.perf_counter()
        made = attempted(PlanningTask(asked, settings), solve)
        answers[method] = Answer(*made, time.perf_counter() - begun)
    print_table("Methods", COLUMNS, comparison_rows(problem, answers))
    for finding in findings(answers):
        print(fill(finding, _WIDTH, subsequent_indent="    "))
    if of_the_paper:
        print_table("Ratios of the paper", RATIO_COLUMNS, ratio_rows(answers))
        print(fill(_WHY_RATIOS_DIFFER, _WIDTH))
    plans = {m: answer.plan for m, answer in answers.items() if isinstance(answer.plan, Plan)}
    print()
    for written in _pictures(problem, plans, output):
        print(written)
    return bool(plans)


def _solvers(field: PotentialFieldParameters, problem: PlanningProblem) -> dict[Method, Solver]:
    return {
        STRAIGHT_LINE: without_search(straight_line),
        POTENTIAL_FIELD: without_search(partial(artificial_potential_field, parameters=field)),
        **dict.fromkeys((SHORTEST, SHORTEST_SPLINE, STEADIEST, STEADIEST_SPLINE, WEIGHTED), plan),
        FIXED_BASE: in_frame_of_user(fixed_base, problem),
        ZERO_MOMENTUM: in_frame_of_user(zero_momentum, problem),
    }


def _pictures(
    problem: PlanningProblem, plans: Mapping[Method, Plan], output: Path
) -> Iterator[Path]:
    """Write the pictures; more methods than the paper's would crowd the figures."""
    motions = {method: plan.trajectory for method, plan in plans.items()}
    of_the_paper = {method: motions[method] for method in plans if method in PAPERS_METHODS}
    if of_the_paper:
        yield from save_figures(problem, of_the_paper, output)
    if motions:
        scene = output / "scene.html"
        save_scene(problem, motions, {STRAIGHT_LINE, SHORTEST} & motions.keys() or motions, scene)
        yield scene
