"""The problems that others publish, and the pages that tell what became of them."""

from __future__ import annotations

import doc_figures
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ff_planner_benchmark.bench import published
from ff_planner_benchmark.problems.classes import CLASSES


def test_every_class_is_in_the_tables_of_the_pages() -> None:
    for of, classes in (("comparisons", published.CLASSES), ("engines", flown_classes())):
        (table,) = (one for one in doc_figures.FIGURES["tables"] if one["of"] == of)
        assert [row[0] for row in table["rows"]] == list(classes)


def flown_classes() -> list[str]:
    return [one.name for one in CLASSES]


def test_a_random_start_with_momentum_is_the_same_but_for_that() -> None:
    for number in range(3):
        held, free, moving = (
            getattr(published, name)(number) for name in ("held", "free", "moving")
        )
        assert held.robot.base == "attitude_held"
        assert free.robot.base == moving.robot.base == "free_flyer"
        assert held.start is free.start
        velocities = [
            (one.start.linear_velocity_chaser_in_inertial**2).sum() ** 0.5 for one in (free, moving)
        ]
        assert velocities == pytest.approx([0.0, 0.01])
        spin = np.linalg.norm(moving.start.angular_velocity_chaser_in_inertial)
        assert np.rad2deg(spin) == pytest.approx(0.5)
        assert moving.target is held.target
        for one, other in zip(moving.obstacles, held.obstacles, strict=True):
            assert one.center.tolist() == other.center.tolist()


def test_the_camera_looks_where_the_grasp_is_at_the_start() -> None:
    for number in range(2):
        problem = published.tumbling_in_view(number)
        body, camera, start = problem.target_body, problem.camera, problem.start
        assert body is not None
        assert camera is not None
        attitude = Rotation.from_quat(body.quaternion_xyzw.copy())
        grasp = body.position + attitude.apply(np.array(body.grasp_position))
        chaser = Rotation.from_quat(start.quaternion_chaser_to_inertial_xyzw.copy())
        base = chaser * Rotation.from_matrix(problem.robot.rotation_chaser_to_base.copy()).inv()
        looks = base.apply(np.array(camera.axis)) / np.linalg.norm(camera.axis)
        way = grasp - start.position_chaser_in_inertial
        assert looks @ way == pytest.approx(np.linalg.norm(way))
