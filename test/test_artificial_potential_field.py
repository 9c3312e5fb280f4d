"""The artificial potential field: the paper's capture, and every way in which it can fail."""

from dataclasses import replace

import numpy as np
import pytest
from judging import require_sound
from robots import CONFIG

from ff_planner_ros.baselines.artificial_potential_field import artificial_potential_field
from ff_planner_ros.baselines.potential_field import load_parameters as load_field
from ff_planner_ros.baselines.straight_line import straight_line
from ff_planner_ros.errors import InvalidInput, NoPlanFound, Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.problem.problem import Obstacle

SETTINGS = load_parameters().planner
FIELD = load_field(CONFIG / "baselines.yaml")


def led_by_field(problem, field=FIELD):
    return artificial_potential_field(problem, SETTINGS, field)


@pytest.fixture(scope="module")
def led(lemur_capture):
    return led_by_field(lemur_capture)


@pytest.fixture(scope="module")
def led_in_free_space(lemur_capture):
    return led_by_field(replace(lemur_capture, obstacles=()))


def wall(rows):
    """Spheres straight in the way, symmetric about the straight path, 15 cm apart."""
    ticks = 0.15 * (np.arange(rows) - (rows - 1) / 2)
    return tuple(
        Obstacle.sphere(f"w{i}{j}", np.array([1.2, 0.4 + y, 0.6 + z]), 0.1)
        for i, y in enumerate(ticks)
        for j, z in enumerate(ticks)
    )


def test_it_solves_the_papers_capture_as_the_paper_tells(lemur_capture, led):
    """Collision-free, further from the obstacles than an optimum, longest and least steady.

    The paper's two ratios: its path is 2.78 times that of min(L), here 1.1072 rad; the attitude
    of min(Theta) is 0.2937 of its and 0.6654 of the straight line's.
    """
    require_sound(lemur_capture, led, SETTINGS)
    assert led.solver.stop_reason == "artificial potential field: the goal is reached"
    assert led.metrics.min_clearance > 0.03
    assert led.metrics.joint_path_length / 1.1072 == pytest.approx(2.78, rel=0.03)
    straight = straight_line(lemur_capture, SETTINGS).metrics
    ratio = led.metrics.max_chaser_euler / straight.max_chaser_euler
    assert ratio == pytest.approx(0.6654 / 0.2937, rel=0.03)


def test_a_goal_with_nothing_in_the_way_is_reached_on_the_straight_line(
    lemur_capture, led_in_free_space
):
    free = replace(lemur_capture, obstacles=())
    require_sound(free, led_in_free_space, SETTINGS)
    assert led_in_free_space.solver.stop_reason.endswith("the goal is reached")
    positions = led_in_free_space.trajectory.ee_positions
    along = free.target.position - positions[0]
    off_line = np.cross(positions - positions[0], along) / np.linalg.norm(along)
    assert np.abs(off_line).max() < 1e-6


def test_the_end_effector_cruises_at_attraction_over_damping(led_in_free_space):
    """Constant attraction against damping: v = a / c (1 - exp(-c t)) until near the goal."""
    motion = led_in_free_space.trajectory
    early = motion.time < 3.0
    speed = np.linalg.norm(motion.ee_linear_velocities, axis=1)
    cruise = FIELD.attraction / FIELD.damping
    expected = cruise * (1.0 - np.exp(-FIELD.damping * motion.time))
    assert speed[early] == pytest.approx(expected[early], abs=1e-6)
    assert speed.max() <= cruise


def test_the_last_bit_of_the_way_is_critically_damped(led_in_free_space, lemur_capture):
    """With w = damping / 2: e = (A + B t) exp(-w t), so (e + e_dot / w) decays like exp(-w t)."""
    motion, w = led_in_free_space.trajectory, FIELD.damping / 2
    error = motion.ee_positions[:, 0] - lemur_capture.target.position[0]
    mode = error + motion.ee_linear_velocities[:, 0] / w
    late = np.abs(error) < 0.5 * FIELD.attraction / w**2
    assert late.sum() > 10
    decay = mode[late] / mode[late][0]
    assert decay == pytest.approx(np.exp(-w * (motion.time[late] - motion.time[late][0])), abs=1e-5)


def test_it_starts_as_the_start_does_and_its_accelerations_are_those_of_its_rates(lemur_capture):
    fine = led_by_field(replace(lemur_capture, points=500)).trajectory
    start = lemur_capture.start
    assert fine.joint_positions[0] == pytest.approx(start.joint_positions, abs=1e-12)
    assert fine.joint_velocities[0] == pytest.approx(start.joint_velocities, abs=1e-12)
    step = fine.time[1]
    for rates, values in (
        (fine.joint_velocities, fine.joint_positions),
        (fine.joint_accelerations, fine.joint_velocities),
    ):
        differences = (values[2:] - values[:-2]) / (2 * step)
        assert rates[1:-1] == pytest.approx(differences, abs=1e-2 * np.abs(rates).max())


def test_a_moving_target_is_met_with_its_twist(lemur_capture):
    target = replace(
        lemur_capture.target,
        linear_velocity=np.array([0.02, 0.0, 0.03]),
        angular_velocity=np.array([0.0, 0.02, -0.01]),
    )
    led = led_by_field(replace(lemur_capture, obstacles=(), target=target))
    assert led.solver.stop_reason.endswith("the goal is reached")
    motion = led.trajectory
    assert motion.ee_linear_velocities[-1] == pytest.approx(target.linear_velocity, abs=1e-3)
    assert motion.ee_angular_velocities[-1] == pytest.approx(target.angular_velocity, abs=1e-3)


def test_the_step_of_the_integration_does_not_matter(lemur_capture, led):
    fine = led_by_field(lemur_capture, replace(FIELD, longest_step=0.02))
    assert fine.trajectory.joint_positions == pytest.approx(
        led.trajectory.joint_positions, abs=1e-3
    )


def test_a_local_minimum_is_named(lemur_capture):
    stuck = replace(lemur_capture, obstacles=wall(7), duration=16.0)
    led = led_by_field(stuck)
    reason = led.solver.stop_reason
    assert "local minimum" in reason
    assert "the nearest obstacle is w33" in reason  # the middle one
    assert f"{led.metrics.final_position_error:.3g} m" in reason
    assert "collision" not in reason
    assert np.linalg.norm(led.trajectory.ee_linear_velocities[-1]) < 1e-3
    with pytest.raises(NoPlanFound, match="final_position_error"):
        require_sound(stuck, led, SETTINGS)


def test_a_time_out_is_named(lemur_capture):
    led = led_by_field(replace(lemur_capture, obstacles=(), duration=3.0))
    assert "time out: the end effector is still under way" in led.solver.stop_reason
    assert "after 3 s" in led.solver.stop_reason
    assert led.metrics.final_position_error > 0.3


def test_an_orientation_that_is_not_reached_in_time_is_a_time_out_too(lemur_capture):
    """The position rests, held a fraction of a millimetre off the goal by the repulsion."""
    slow = replace(FIELD, angular_attraction=0.06)
    led = led_by_field(replace(lemur_capture, duration=20.0), slow)
    assert "time out" in led.solver.stop_reason
    assert led.metrics.final_position_error < SETTINGS.position_tolerance
    assert led.metrics.final_orientation_error > SETTINGS.orientation_tolerance


def test_a_collision_is_a_plan_that_says_so(lemur_capture):
    """Without repulsion the end effector goes straight through the first obstacle."""
    led = led_by_field(lemur_capture, replace(FIELD, repulsion=0.0))
    assert "collision" in led.solver.stop_reason
    assert led.metrics.min_clearance == pytest.approx(-0.14, abs=0.005)
    with pytest.raises(NoPlanFound) as refusal:
        require_sound(lemur_capture, led, SETTINGS)
    assert refusal.value.status is Status.COLLISION


def test_a_dynamic_singularity_ends_it_as_a_refusal(lemur_capture):
    """A sphere straight in the way: the end effector slides round it till the arm is stretched."""
    sphere = Obstacle.sphere("s", np.array([1.25, 0.4, 0.6]), 0.35)
    with pytest.raises(NoPlanFound, match=r"dynamic singularity at t = \d\.\d\d s of 10 s") as end:
        led_by_field(replace(lemur_capture, obstacles=(sphere,)))
    assert end.value.status is Status.SINGULAR


def test_it_refuses_what_no_motion_can_start_from(lemur_capture):
    around = Obstacle.sphere("rock", np.array([0.2, 0.1, 0.5]), 0.2)
    with pytest.raises(InvalidInput, match="rock"):
        led_by_field(replace(lemur_capture, obstacles=(around,)))


def test_it_has_no_polynomial_and_no_optimality(led):
    assert led.xi.size == 0
    assert led.orientation_reading == ""
    assert led.solver.optimality == np.inf
