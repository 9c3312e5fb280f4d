"""What is drawn over time: one branch of angles for all methods, limits where they belong."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from drawn_plans import POINTS, drawn_plan
from scipy.spatial.transform import Rotation

from ff_planner_ros.analysis.drawing.panels import (
    CHASER_POSE,
    joint_angles,
    joint_rates,
    joint_torques,
    panels,
)
from ff_planner_ros.analysis.drawing.plots import clearance_plot, panel_plot
from ff_planner_ros.analysis.methods import MEASURED, PLANNED
from ff_planner_ros.common.arrays import frozen
from ff_planner_ros.planning.motion.plan import Trajectory
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.robot.model import Robot


@pytest.mark.parametrize("first", [0, POINTS // 2])
def test_what_was_measured_is_drawn_beside_what_was_planned_across_180_degrees(
    first: int, lemur: Robot
) -> None:
    """Planned beyond 180 deg, measured a little more: as angles from -180 on."""
    planned = np.linspace([0.0, 0.0, 0.0], [560.0, 20.0, 60.0], POINTS)
    motions = {
        PLANNED: drawn_plan(lemur, 0, planned).trajectory,
        MEASURED: rows_of(drawn_plan(lemur, 0, planned + 2.0).trajectory, slice(first, None)),
    }
    for k, panel in enumerate(panels(CHASER_POSE[1], motions)):
        np.testing.assert_allclose(panel.curves[PLANNED][1], planned[:, k], atol=1e-6)
        np.testing.assert_allclose(panel.curves[MEASURED][1], planned[first:, k] + 2, atol=1e-6)


def test_the_chaser_s_angles_are_those_from_the_start_of_the_plan(lemur: Robot) -> None:
    """The largest of them is J_Theta, whatever the user's axes are."""
    turn = Rotation.from_euler("xyz", [0.4, -0.9, 2.0])
    plan = drawn_plan(lemur, 0).trajectory
    attitudes = turn * Rotation.from_quat(plan.chaser_quaternions_xyzw)
    motions = {PLANNED: replace(plan, chaser_quaternions_xyzw=attitudes.as_quat())}
    motions[MEASURED] = rows_of(motions[PLANNED], slice(5, None))
    relative = (attitudes[0].inv() * attitudes).as_euler("ZYX", degrees=True)[:, ::-1]
    for k, panel in enumerate(panels(CHASER_POSE[1], motions)):
        np.testing.assert_allclose(panel.curves[PLANNED][1], relative[:, k], atol=1e-9)
        np.testing.assert_allclose(panel.curves[MEASURED][1], relative[5:, k], atol=1e-9)


def rows_of(motion: Trajectory, rows: slice) -> Trajectory:
    names = motion.__dataclass_fields__
    return Trajectory(**{name: getattr(motion, name)[rows] for name in names})


def test_joints_have_their_limits(lemur: Robot) -> None:
    robot = replace(lemur, velocity_limits=frozen(np.arange(1.0, 8.0)))
    motion = {PLANNED: drawn_plan(lemur, 1).trajectory}
    assert joint_rates(robot).title == "joint velocities"
    for k, (angle, rate) in enumerate(
        zip(panels(joint_angles(robot), motion), panels(joint_rates(robot), motion), strict=True)
    ):
        limits = [robot.lower_position_limits[k], robot.upper_position_limits[k]]
        np.testing.assert_allclose(angle.levels, np.rad2deg(limits))
        np.testing.assert_allclose(rate.levels, np.rad2deg([-(k + 1.0), k + 1.0]))


def test_a_plot_of_joints_shows_the_curves_and_keeps_the_limits_for_zooming_out(
    lemur: Robot,
) -> None:
    robot = replace(lemur, velocity_limits=frozen([np.inf, *[2.0] * 6]))
    motion = drawn_plan(lemur, 1).trajectory
    figure = panel_plot(panels(joint_rates(robot), {PLANNED: motion}))
    lines = [(line.yref, line.y0, line.y1) for line in figure.layout.shapes]
    limit = np.rad2deg(2.0)
    assert lines == [(f"y{k}", y, y) for k in range(2, 8) for y in (-limit, limit)]
    for k in range(7):
        low, high = figure.layout["yaxis" + (str(k + 1) if k else "")].range
        rates = np.rad2deg(motion.joint_velocities[:, k])
        assert -limit < low < rates.min() < rates.max() < high < limit
        assert np.ptp(rates) > 0.9 * (high - low)
    said = [(note.text, note.yref) for note in figure.layout.annotations]
    assert ("joint_7 [deg/s]", "y7 domain") in said
    assert (f"limits ±{limit:.4g}", "y7 domain") in said
    assert [words for words, _ in said].count(f"limits ±{limit:.4g}") == 6


def test_torques_have_the_limits_of_the_urdf_and_a_measured_motion_has_none(lemur: Robot) -> None:
    robot = replace(lemur, effort_limits=frozen([np.inf, *range(1, 7)]))
    planned = drawn_plan(lemur, 1).trajectory
    unknown = replace(planned, joint_torques=np.full(planned.joint_torques.shape, np.nan))
    for k, panel in enumerate(panels(joint_torques(robot), {PLANNED: planned, MEASURED: unknown})):
        assert panel.label == f"joint_{k + 1} [N m]"
        assert list(panel.curves) == [PLANNED]
        np.testing.assert_array_equal(panel.curves[PLANNED][1], planned.joint_torques[:, k])
        assert panel.note == (f"limits ±{k}" if k else "")


def test_a_plot_without_obstacles_says_so(lemur: Robot, lemur_capture: PlanningProblem) -> None:
    motions = {PLANNED: drawn_plan(lemur, 2).trajectory}
    free = clearance_plot(lemur, (), motions)
    assert "no obstacles" in [note.text for note in free.layout.annotations]
    assert not free.layout.shapes
    among = clearance_plot(lemur, lemur_capture.obstacles, motions)
    (inside,) = among.layout.shapes
    assert inside.y1 == 0.0
    bottom, top = among.layout.yaxis.range
    assert inside.y0 < bottom < 0.0 < top


def test_the_least_clearance_is_a_point_of_its_curve_with_millimetres_time_and_obstacle(
    lemur: Robot, lemur_capture: PlanningProblem
) -> None:
    motions = {
        PLANNED: drawn_plan(lemur, 2).trajectory,
        MEASURED: drawn_plan(lemur, 3).trajectory,
    }
    figure = clearance_plot(lemur, lemur_capture.obstacles, motions)
    curves = [trace for trace in figure.data if trace.mode == "lines"]
    marks = [trace for trace in figure.data if trace.mode == "markers"]
    notes = [note for note in figure.layout.annotations if " mm to " in note.text]
    for curve, mark, note in zip(curves, marks, notes, strict=True):
        least = int(np.argmin(curve.y))
        assert (mark.x[0], mark.y[0]) == (note.x, note.y) == (curve.x[least], curve.y[least])
        assert note.text.startswith(f"{note.y:.1f} mm to c")
        assert note.text.endswith(f" at {note.x:.2f} s")
