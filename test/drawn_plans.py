"""Plans drawn by hand, for what shows plans: no two of their arrays are alike."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from paper_equations import PaperTerms, paper_terms
from robots import LEMUR_URDF
from scipy.spatial.transform import Rotation

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.motion.metrics import Metrics
from ff_planner_ros.planning.motion.plan import Plan, SolverReport, Trajectory
from ff_planner_ros.robot.model import Robot

POINTS, DURATION = 40, 10.0
SOUND = Metrics(
    joint_path_length=1.5,
    max_chaser_euler=np.deg2rad(12.0),
    max_chaser_rotation=np.deg2rad(14.0),
    min_clearance=0.0123,
    min_joint_margin=0.5,
    min_velocity_margin=0.1,
    peak_joint_torques=(0.5, 2.25, 1.0, 0.0, 0.1, 0.2, 0.3),
    torque_error=0.0,
    penalty=0.0,
    final_position_error=0.0004,
    final_orientation_error=np.deg2rad(0.02),
    momentum_error=0.0,
    min_singular_value=0.2,
    start_velocity_jump=0.0,
)


def drawn_plan(robot: Robot, seed: int, chaser_euler_deg: Array | None = None) -> Plan:
    """All joints swing while the chaser drifts and turns, by default to and fro.

    Args:
        robot: The robot.
        seed: Another one draws another plan.
        chaser_euler_deg: phi, theta, psi of the chaser. Shape (POINTS, 3).
    """
    rng = np.random.default_rng(seed)
    s = np.linspace(0.0, 1.0, POINTS)[:, None]

    def wave(columns: int, size: float) -> Array:
        curve: Array = size * np.sin(s * rng.uniform(1.0, 4.0, columns) + rng.uniform(-1, 1))
        return curve

    if chaser_euler_deg is None:
        chaser_euler_deg = wave(3, 20.0)
    return Plan(
        joint_names=robot.joint_names,
        trajectory=Trajectory(
            time=DURATION * s[:, 0],
            joint_positions=np.linspace(0.2, -2.2, robot.joints) + wave(robot.joints, 0.4),
            joint_velocities=wave(robot.joints, 0.1),
            joint_accelerations=wave(robot.joints, 0.1),
            joint_torques=wave(robot.joints, 2.0),
            chaser_positions=wave(3, 0.3),
            chaser_quaternions_xyzw=quaternions(chaser_euler_deg),
            chaser_linear_velocities=wave(3, 0.02),
            chaser_angular_velocities=wave(3, 0.05),
            ee_positions=wave(3, 1.0),
            ee_quaternions_xyzw=quaternions(wave(3, 40.0)),
            ee_linear_velocities=wave(3, 0.1),
            ee_angular_velocities=wave(3, 0.1),
        ),
        xi=np.zeros(18),
        orientation_reading="",
        metrics=SOUND,
        solver=SolverReport(
            starts=1, iterations=1, rollouts=1, optimality=0.0, stop_reason="drawn by hand"
        ),
    )


def quaternions(euler_deg: Array) -> Array:
    """Rz(psi) Ry(theta) Rx(phi) of angles phi, theta, psi. Shapes (points, 3) to (points, 4)."""
    return np.asarray(Rotation.from_euler("ZYX", euler_deg[:, ::-1], degrees=True).as_quat())


def paper_terms_at(plan: Plan, point: int) -> PaperTerms:
    """Where the LEMUR's links are at a point of a plan, by the paper's own kinematics."""
    trajectory = plan.trajectory
    return paper_terms(
        LEMUR_URDF.read_text(),
        "chaser",
        "end_effector",
        r_ch=trajectory.chaser_positions[point],
        rotation_ch=Rotation.from_quat(trajectory.chaser_quaternions_xyzw[point]).as_matrix(),
        theta=trajectory.joint_positions[point],
    )


def distance_to_arm(plan: Plan, point: int, center: Array) -> float:
    """From a sphere's centre to the nearest of many places on the LEMUR's links."""
    terms = paper_terms_at(plan, point)
    corners = np.vstack([terms.r_joint, terms.r_ee])
    along = np.linspace(0.0, 1.0, 2001)[:, None]
    places = [a + along * (b - a) for a, b in pairwise(corners)]
    return float(np.linalg.norm(np.concatenate(places) - center, axis=1).min())
