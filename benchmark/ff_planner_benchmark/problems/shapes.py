"""Problems among convex obstacles: a motion was drawn first, then obstacles around it.

The motion, the witness, is a quintic of each joint to a state in which the end effector rests in
its goal. Obstacles are pushed from outside until they are near it; all distances are Coal's. They
rest, move, rotate, form a slot around the forearm, sweep through the workspace, or are fixed to a
tumbling target.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import cast

import numpy as np
import pinocchio as pin

from ff_planner_benchmark.problems.placing import (
    KINDS,
    THICKNESS,
    Track,
    beside,
    drawn_solid,
    free_body,
    gap_of,
    random_turn,
)
from ff_planner_benchmark.problems.tumbling_witness import (
    Grip,
    Witness,
    witness_to_grip,
)
from ff_planner_benchmark.problems.witnessed import random_state
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import NoPlanFound
from ff_planner_ros.planning.distance.clearance import arm_points, segments
from ff_planner_ros.planning.motion.forward import carried_base
from ff_planner_ros.planning.motion.joint_motion import JointMotion
from ff_planner_ros.planning.problem.problem import (
    Obstacle,
    PlanningProblem,
    with_capture_target,
)
from ff_planner_ros.planning.problem.target_body import AttachedObstacle, TargetBody
from ff_planner_ros.problems.bodies import APART, Swept, own_gap
from ff_planner_ros.problems.drawn import Drawn, asked, first_sound
from ff_planner_ros.problems.paths import STRAIGHT, roll_out
from ff_planner_ros.problems.robots import bench_robot
from ff_planner_ros.problems.scenarios import stretched_length
from ff_planner_ros.robot.collision.geometry import Geometry
from ff_planner_ros.robot.collision.lines import with_bodies
from ff_planner_ros.robot.collision.solids import Solid
from ff_planner_ros.robot.configuration import configuration, eigen_quaternion
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.momentum import total_momentum
from ff_planner_ros.robot.state import SystemState

ROBOTS = ("lemur", "arm6", "arm7", "canadarm2", "arm10")
SITUATIONS = ("at rest", "moving", "turning", "slot", "sweeping panel", "capture")
# In every seventh problem the robot has centre lines instead of collision bodies.
LINES_EVERY = 7

# Clearance of bodies from the witness [m], and of a slot's plates on either side.
CLEAR, SLOT = 0.02, 0.03
# Allowance on these at the witness's points [m]; they are checked again at so many times as many.
_ALLOWANCE, _FINER = 3e-3, 5
# How far each joint turns at most [rad], and how fast it and the chaser begin [rad/s, m/s, rad/s].
_TURN, _MOVING, _DRIFT, _SPIN = 0.9, 0.03, 0.01, 0.01
# Joints of this rate are quick enough for the durations that are drawn [rad/s].
_QUICK = 0.2
# Bodies move and turn so fast [m/s, rad/s], each way; of a panel that sweeps [rad] in all.
_SPEED, _RATE, _SWEEP = 0.02, 0.1, (1.0, 3.0)
_FEWEST, _MOST, _PARTS = 3, 6, (6, 10)  # bodies, and those of a target
_CANDIDATES = 60
_AWAY = 0.5  # bodies come from so far, in lengths of the stretched arm
# A slot's plates, in lengths of the forearm, along it and across; a link is a forearm from this
# length on, in lengths of the arm. At some time both plates are so near to it [m].
_ALONG, _ACROSS, _FOREARM, _TIGHT = 0.4, 0.2, 0.15, 0.05
_SLOTS = 8  # so many are tried
# A panel's edges, in lengths of the arm.
_PANEL = (0.5, 0.2)
# Of a target: where its grasp is [m] and how fast it turns [rad/s].
_LEVER, _TUMBLING = (0.3, 0.8), (0.02, 0.09)
_COME = 2.0  # its parts come from so far [m]


@cache
def problem(number: int) -> Drawn[Witness]:
    """Return a problem by its number, which seeds the draw; robots and situations in turn."""
    name, situation = ROBOTS[number % len(ROBOTS)], SITUATIONS[number % len(SITUATIONS)]
    lines = number % LINES_EVERY == LINES_EVERY - 1
    robot = bench_robot(name, Geometry.LINES if lines else Geometry.SHAPES)
    rng = np.random.default_rng([*b"shapes", number])
    return first_sound(situation, name, lambda: _Draw(robot, situation, rng).drawn())


class _Draw:
    """One try to draw a problem."""

    def __init__(self, robot: Robot, situation: str, rng: np.random.Generator) -> None:
        self.robot, self.situation, self.rng = robot, situation, rng
        self.reach = stretched_length(robot)
        self.slower = max(1.0, _QUICK / float(robot.velocity_limits.min()))
        self.bodies = list[Obstacle]()

    def drawn(self) -> Drawn[Witness] | None:
        """Return a problem and its witness; None: what was drawn is not sound."""
        robot, rng = self.robot, self.rng
        drift = _DRIFT / self.slower * rng.normal(size=3)
        spin = _SPIN / self.slower * rng.normal(size=3)
        start = random_state(robot, drift, spin, _MOVING / self.slower, rng)
        duration = float(self.slower * rng.uniform(8.0, 15.0))
        end = start.joint_positions + rng.uniform(-_TURN, _TURN, robot.joints)
        witness = witness_to_grip(robot, start, end, self._grip(), duration)
        if witness is None:
            return None
        swept = Swept(with_bodies(robot), witness.way)
        if robot.bodies and own_gap(swept, APART) < APART:
            return None
        self._look_closer(start, witness)
        problem = asked(robot, start, witness.body.target(duration), duration)
        if self.situation == "capture":
            parts = self._parts(witness, swept)
            if len(parts) < _PARTS[0]:
                return None
            whole = with_capture_target(replace(witness.body, obstacles=parts), problem)
            return Drawn(whole, witness)
        if not self._lay(problem, witness, swept):
            return None
        return Drawn(replace(problem, obstacles=tuple(self.bodies)), witness)

    def _look_closer(self, start: SystemState, witness: Witness) -> None:
        """Compute the poses of the robot's bodies along the witness at finer times."""
        robot, times = self.robot, witness.times
        joints = cast(JointMotion, witness.joints)  # of `witness_to_grip`, which always says it
        q, v = configuration(robot, start)
        momentum = total_momentum(robot, robot.model.createData(), q, v)
        self.times = np.linspace(0.0, times[-1], _FINER * (len(times) - 1) + 1)
        way, _ = carried_base(robot, q, momentum, joints, self.times)
        self.closely = Swept(with_bodies(robot), way)

    def _grip(self) -> Grip:
        """Draw a tumbling target body; in other situations than a capture, a body at rest."""
        rng = self.rng
        out, turn = rng.normal(size=3), rng.normal(size=3)
        a, b, c = rng.uniform(0.2, 1.2, 3)
        turning = self.situation == "capture"
        rate = float(rng.uniform(*_TUMBLING)) / self.slower if turning else 0.0
        return Grip(
            to_ee=random_turn(rng),
            center=float(rng.uniform(*_LEVER)) * out / np.linalg.norm(out),
            inertia=np.diag([b + c, a + c, a + b]),
            rate=rate * turn / np.linalg.norm(turn),
            drift=_DRIFT / self.slower * rng.normal(size=3) * turning,
        )

    def _lay(self, problem: PlanningProblem, witness: Witness, swept: Swept) -> bool:
        """Place obstacles around the witness; tell whether the situation's are among them.

        The straight path hits the first one, except in the situation "slot".
        """
        situation, times = self.situation, witness.times
        if situation == "slot":
            if not any(self._slot(witness, swept) for _ in range(_SLOTS)):
                return False
        else:
            try:
                straight = Swept(swept.robot, roll_out(problem, STRAIGHT, len(times)).q)
            except NoPlanFound:  # it meets a singularity
                return False
            sweeps = situation == "sweeping panel"
            for _ in range(_CANDIDATES // 2):
                body = self._panel(problem.duration) if sweeps else self._candidate(0)
                laid = self._near(body, straight, swept, times)
                if laid is not None and gap_of(straight, times, laid) < 0.0:
                    self.bodies.append(laid)
                    break
            else:
                return False
        wanted = int(self.rng.integers(_FEWEST, _MOST, endpoint=True))
        for number in range(1, _CANDIDATES):
            if len(self.bodies) == wanted:
                break
            body = self._candidate(number)
            laid = self._near(body, swept, swept, times)
            if laid is not None:
                self.bodies.append(laid)
        return len(self.bodies) >= _FEWEST

    def _candidate(self, number: int) -> tuple[Solid, Array]:
        """Return a solid, its kind in turn, and its twist."""
        rng = self.rng
        kind = KINDS[(number + int(rng.integers(len(KINDS)))) % len(KINDS)]
        moves = self.situation in ("moving", "turning")
        turns = self.situation == "turning"
        twist = np.concatenate(
            [
                moves * _SPEED / self.slower * rng.normal(size=3),
                turns * _RATE / self.slower * rng.normal(size=3),
            ]
        )
        return drawn_solid(kind, self.reach, rng), twist

    def _panel(self, duration: float) -> tuple[Solid, Array]:
        """Return a panel, and the twist with which it sweeps; about an axis in its plane or not."""
        rng = self.rng
        edges = self.reach * np.array(_PANEL) * rng.uniform(0.7, 1.3, 2)
        axis = rng.normal(size=3)
        rate = float(rng.uniform(*_SWEEP)) / duration * axis / np.linalg.norm(axis)
        speed = _SPEED / self.slower * rng.normal(size=3)
        return Solid("box", np.array([*edges, THICKNESS])), np.concatenate([speed, rate])

    def _near(
        self,
        drawn: tuple[Solid, Array],
        around: Swept,
        swept: Swept,
        times: Array,
    ) -> Obstacle | None:
        """Push a body towards a point of the arm along `around` until it is near the witness."""
        rng, (solid, twist) = self.rng, drawn
        points = arm_points(self.robot, around.way)
        time, link = int(rng.integers(len(times))), int(rng.choice(segments(points)))
        along, out = rng.uniform(), rng.normal(size=3)
        out /= np.linalg.norm(out)
        at = (1.0 - along) * points[time, link] + along * points[time, link + 1]
        far = _AWAY * self.reach
        pose = pin.SE3(random_turn(rng), at + far * out)
        name = f"b{len(self.bodies) + 1}"
        body = free_body(name, solid, pose, twist, float(times[time]))
        laid = beside(swept, times, body, -out, CLEAR + _ALLOWANCE, far)
        return laid if laid and gap_of(self.closely, self.times, laid) > CLEAR else None

    def _slot(self, witness: Witness, swept: Swept) -> bool:
        """Place two plates on either side of the forearm's path; tell whether they form a slot."""
        points = arm_points(self.robot, witness.way)
        long = [
            link
            for link in segments(points)
            if np.linalg.norm(points[0, link + 1] - points[0, link]) > _FOREARM * self.reach
        ]
        link, still = int(long[-1]), np.zeros(6)
        middles = (points[:, link] + points[:, link + 1]) / 2.0
        time = int(self.rng.integers(len(points) // 4, 3 * len(points) // 4))
        along = points[time, link + 1] - points[time, link]
        length = float(np.linalg.norm(along))
        normal = np.cross(along, middles[time + 1] - middles[time - 1])
        if np.linalg.norm(normal) < 1e-6 * length:
            return False
        normal /= np.linalg.norm(normal)
        axes = np.column_stack([along / length, np.cross(normal, along / length), normal])
        solid = Solid("box", np.array([_ALONG * length, _ACROSS * length, THICKNESS]))
        plates = list[Obstacle]()
        for side in (1.0, -1.0):
            pose = pin.SE3(axes, middles[time] + side * length * normal)
            plate = free_body(f"b{len(plates) + 1}", solid, pose, still, 0.0)
            laid = beside(swept, witness.times, plate, -side * normal, SLOT + _ALLOWANCE, length)
            if laid is None or gap_of(self.closely, self.times, laid) < SLOT:
                return False
            now = Swept(swept.robot, witness.way[time : time + 1])
            if gap_of(now, witness.times[:1], laid) > _TIGHT:
                return False
            plates.append(laid)
        self.bodies = plates
        return True

    def _parts(self, witness: Witness, swept: Swept) -> tuple[AttachedObstacle, ...]:
        """Draw the parts of a target body: each is pushed into the body from outside."""
        rng, (_, times, body, *_) = self.rng, witness
        points = arm_points(self.robot, witness.way)
        motion = body.motion(np.zeros(3), times)
        seen = ((points - motion.positions[:, None]) @ motion.rotations)[:, segments(points) + 1]
        near = seen[np.linalg.norm(seen, axis=-1) < 2.0 * _LEVER[1]]
        wanted, chosen = int(rng.integers(*_PARTS, endpoint=True)), list[AttachedObstacle]()
        for number in range(_CANDIDATES):
            if len(chosen) == wanted:
                break
            kind = KINDS[number % len(KINDS)]
            solid = drawn_solid(kind, min(self.reach, 3.0), rng)
            to = rng.uniform(-0.5, 0.5, 3)
            if number % 2 and len(near):
                to = near[rng.integers(len(near))]
            out, turn = rng.normal(size=3), random_turn(rng)
            out /= np.linalg.norm(out)
            far = _track(body, solid, turn, to + _COME * out, -out, times).come(
                swept, CLEAR + _ALLOWANCE, _COME
            )
            if far is None or far < _COME / 2:
                continue
            place = to + (_COME - far) * out
            closely = _track(body, solid, turn, place, -out, self.times)
            if closely.gap(self.closely) > CLEAR:
                quaternion = pin.Quaternion(eigen_quaternion(turn)).normalized().coeffs()
                chosen.append(AttachedObstacle(f"part_{len(chosen) + 1}", solid, place, quaternion))
        return tuple(chosen)


def _track(
    body: TargetBody, solid: Solid, turn: Array, place: Array, way: Array, times: Array
) -> Track:
    """Return the poses of a solid that is fixed to a body, and a direction in body axes."""
    motion = body.motion(place, times)
    return Track(solid, motion.rotations @ turn, motion.positions, motion.rotations @ way)
