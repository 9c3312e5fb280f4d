"""Pictures of one plan."""

from __future__ import annotations

from pathlib import Path

from ff_planner_ros.analysis.figures import save_figures
from ff_planner_ros.analysis.methods import PLANNED
from ff_planner_ros.analysis.scene import save_scene
from ff_planner_ros.planning.plan import Plan
from ff_planner_ros.planning.problem import PlanningProblem


def draw(problem: PlanningProblem, plan: Plan, directory: Path) -> list[Path]:
    """Draw a plan: figures over time, each as PNG and PDF, and a scene that turns in a browser.

    Args:
        directory: Made if it is not there; files of the same name in it are replaced.

    Returns:
        The PNG files and the scene, `scene.html`.
    """
    motions, scene = {PLANNED: plan.trajectory}, directory / "scene.html"
    pictures = save_figures(problem, motions, directory)
    save_scene(problem, motions, motions, scene)
    return [*pictures, scene]
