"""The picture with light: no triangle is lost, none is long, and light comes from one side."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

from ff_planner_ros.analysis.drawing.figures import plot_plan
from ff_planner_ros.analysis.drawing.lit_scene import _LIGHT, _LONGEST, _SHADE, _lit, _small
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.problems import bodies


def areas(triangles: Array) -> Array:
    a, b, c = np.moveaxis(triangles, 1, 0)
    return np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2


def test_long_triangles_are_halved_until_none_is_long_and_cover_what_they_did() -> None:
    long = np.random.default_rng(1).normal(size=(20, 3, 3))
    small = _small(long)
    edges = np.linalg.norm(small - np.roll(small, -1, axis=1), axis=2)
    assert edges.max() <= _LONGEST
    assert areas(small).sum() == pytest.approx(areas(long).sum(), rel=1e-9)
    tiny = 0.01 * long
    np.testing.assert_array_equal(_small(tiny), tiny)


def test_what_faces_the_light_is_bright_from_either_side_and_what_is_along_it_dark() -> None:
    light = _LIGHT / np.linalg.norm(_LIGHT)
    across = np.cross(light, [0.0, 0.0, 1.0])
    across /= np.linalg.norm(across)
    other = np.cross(light, across)
    facing, along = [np.zeros(3), across, other], [np.zeros(3), across, light]
    _, colours = _lit(np.array([facing, facing[::-1], along]), "white")
    np.testing.assert_allclose(colours, np.outer([1.0, 1.0, _SHADE], np.ones(3)), atol=1e-12)


@pytest.mark.ci
def test_a_robot_with_bodies_has_a_picture_of_its_scene(tmp_path: Path) -> None:
    problem = bodies.problem("arm6", 0).problem
    plan = perform(PlanningTask(problem, load_parameters().planner))
    made = plot_plan(problem, plan, tmp_path)
    assert tmp_path / "scene.png" in made
    assert tmp_path / "scene.html" == made[-1]
    picture = imread(tmp_path / "scene.png")[..., :3]
    blue = (picture[..., 2] > picture[..., 0] + 0.1).mean()
    golden = (picture[..., 0] > picture[..., 2] + 0.1).mean()
    assert blue > 0.01
    assert golden > 0.001
