"""Plans judged apart from our code: Pinocchio reads the URDF, Coal looks 1000 times a second.

Of ours there are only the plan's samples; which links must not touch is written out here.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import coal
import numpy as np
import pinocchio as pin
from scipy.interpolate import BPoly
from scipy.spatial.transform import Rotation, RotationSpline

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.motion.plan import Trajectory
from ff_planner_ros.planning.problem.problem import Obstacle

RATE = 1000.0  # [Hz]
ROBOTS = Path(__file__).parent.parent / "config" / "robots"

# For each robot every link that has a shape, with the links that it must not touch. Left out are
# links that are fixed to each other and those that a joint joins.
Pairs = Mapping[str, Sequence[str]]
LEMUR: Pairs = {  # link_6 has no shape: link_5 and link_7 are neighbours
    "chaser": ("link_2", "link_3", "link_4", "link_5", "link_7"),
    "link_1": ("link_3", "link_4", "link_5", "link_7"),
    "link_2": ("link_4", "link_5", "link_7"),
    "link_3": ("link_5", "link_7"),
    "link_4": ("link_7",),
}
CANADARM2: Pairs = {
    "station": ("link_1", "link_2", "link_3", "link_4", "link_5", "link_6", "link_7"),
    "link_0": ("link_2", "link_3", "link_4", "link_5", "link_6", "link_7"),
    "link_1": ("link_3", "link_4", "link_5", "link_6", "link_7"),
    "link_2": ("link_4", "link_5", "link_6", "link_7"),
    "link_3": ("link_5", "link_6", "link_7"),
    "link_4": ("link_6", "link_7"),
    "link_5": ("link_7",),
}
ARM6: Pairs = {
    "chaser": ("link_2", "link_3", "link_4", "link_5", "link_6", "end_effector"),
    "panel_left": ("link_1", "link_2", "link_3", "link_4", "link_5", "link_6", "end_effector"),
    "panel_right": ("link_1", "link_2", "link_3", "link_4", "link_5", "link_6", "end_effector"),
    "link_1": ("link_3", "link_4", "link_5", "link_6", "end_effector"),
    "link_2": ("link_4", "link_5", "link_6", "end_effector"),
    "link_3": ("link_5", "link_6", "end_effector"),
    "link_4": ("link_6", "end_effector"),
    "link_5": ("end_effector",),
}


class WholeBodies:
    """A robot and obstacles as Pinocchio reads and Coal sees them."""

    def __init__(self, urdf: Path, base_link: str, pairs: Pairs, held: Sequence[str] = ()) -> None:
        """Read a URDF; `held` are joints that stay at zero."""
        model = pin.buildModelFromUrdf(str(urdf), pin.JointModelFreeFlyer())
        geometry = pin.buildGeomFromUrdf(model, str(urdf), pin.COLLISION)
        locked = [model.getJointId(joint) for joint in held]
        self.model, self.geometry = pin.buildReducedModel(
            model, geometry, locked, pin.neutral(model)
        )
        self.solids: dict[str, list[int]] = {}
        for number, found in enumerate(self.geometry.geometryObjects):
            link = self.model.frames[found.parentFrame].name
            self.solids.setdefault(link, []).append(number)
        base = self.model.frames[self.model.getFrameId(base_link)]
        self.chaser_in_base = self.model.inertias[1].lever.copy()
        self.chaser_to_base = base.placement.rotation.copy()
        self.pairs = [
            (one, other)
            for link, others in pairs.items()
            for two in others
            for one in self.solids[link]
            for other in self.solids[two]
        ]

    def touching(self, motion: Trajectory, obstacles: Sequence[Obstacle]) -> dict[str, float]:
        """Pairs of links, or link and obstacle, that touch, and when they do first."""
        geometry = self.geometry.copy()
        own = range(len(geometry.geometryObjects))
        for sphere in obstacles:
            place = pin.SE3(np.eye(3), sphere.center)
            ball = coal.Sphere(sphere.radius)
            geometry.addGeometryObject(pin.GeometryObject(f"sphere {sphere.id}", 0, place, ball))
        spheres = range(len(own), len(geometry.geometryObjects))
        for first, second in (*self.pairs, *((a, b) for a in own for b in spheres)):
            geometry.addCollisionPair(pin.CollisionPair(first, second))
        names = [self.model.frames[one.parentFrame].name for one in self.geometry.geometryObjects]
        names += [sphere.id for sphere in obstacles]
        moving = [
            pair for pair in zip(spheres, obstacles, strict=True) if pair[1].motion.velocity.any()
        ]
        data, placed = self.model.createData(), geometry.createData()
        found: dict[str, float] = {}
        for time, q in zip(*self._between(motion), strict=True):
            for number, sphere in moving:
                center = sphere.center + time * sphere.motion.velocity
                geometry.geometryObjects[number].placement = pin.SE3(np.eye(3), center)
            pin.updateGeometryPlacements(self.model, data, geometry, placed, q)
            if pin.computeCollisions(geometry, placed, False):
                for pair, result in zip(
                    geometry.collisionPairs, placed.collisionResults, strict=True
                ):
                    if result.isCollision():
                        found.setdefault(f"{names[pair.first]}/{names[pair.second]}", float(time))
        return found

    def _between(self, motion: Trajectory) -> tuple[Array, Array]:
        """Times and configurations: quintics of the joints, cubics and a spline of the chaser."""
        time = motion.time - motion.time[0]
        joints = motion.joint_positions, motion.joint_velocities, motion.joint_accelerations
        chaser = motion.chaser_positions, motion.chaser_linear_velocities
        looks = np.linspace(0.0, time[-1], int(np.ceil(time[-1] * RATE)) + 1)
        turned = RotationSpline(time, Rotation.from_quat(motion.chaser_quaternions_xyzw))(looks)
        base = turned * Rotation.from_matrix(self.chaser_to_base).inv()
        position = BPoly.from_derivatives(time, np.stack(chaser, axis=1))(looks)
        position = position - base.apply(self.chaser_in_base)
        angles = BPoly.from_derivatives(time, np.stack(joints, axis=1))(looks)
        return looks, np.hstack([position, base.as_quat(), angles])


def judge_of(robot: str, directory: Path) -> WholeBodies:
    """The judge of a robot of `problems.bodies`."""
    from ff_planner_ros.problems.robots import arm_urdf

    if robot == "arm6":
        urdf = directory / "arm6.urdf"
        urdf.write_text(arm_urdf(6, with_bodies=True))
        return WholeBodies(urdf, "chaser", ARM6)
    base_link, pairs = {"lemur": ("chaser", LEMUR), "canadarm2": ("station", CANADARM2)}[robot]
    return WholeBodies(ROBOTS / robot / f"{robot}.urdf", base_link, pairs)
