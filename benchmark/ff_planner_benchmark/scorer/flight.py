"""Motion of the free-floating system for a motion of its joints, by conservation of momentum.

The system's linear momentum and its angular momentum about the inertial origin are those of the
start. Each posture then gives the base's twist; a Runge-Kutta method of order four gives its pose.
The joints follow the smooth spline through an answer's positions at 1,001 moments, so that the
integration misses nothing between them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.interpolate import BPoly, CubicSpline
from scipy.spatial.transform import Rotation

from ff_planner_benchmark.scorer.chain import Array, Chain, Placement, Posture

# The pose is integrated in so many steps.
STEPS = 1000


@dataclass(frozen=True, eq=False)
class Flight:
    """The motion of the system, a row per time; poses and twists are inertial."""

    times: Array  # [s]
    angles: Array  # shape (times, joints) [rad]
    rates: Array  # shape (times, joints) [rad/s]
    base: Placement  # of the base link's frame
    posture: Posture  # in the base link's frame
    twists: Array  # of the base link's origin, linear and angular; shape (times, 6)
    link_twists: list[Array]  # of the links' centres of mass; each (times, 6)

    def of(self, place: Placement) -> Placement:
        """Return the inertial pose of a frame that is given in the base link's frame."""
        return self.base.then(place)

    def twist_at(self, link: int, chain: Chain) -> Array:
        """Return the twist of a link's origin in the inertial frame. Shape (times, 6)."""
        twist, offset = self.link_twists[link], chain.links[link].center
        rotation = self.of(self.posture.links[link]).rotation
        linear = twist[:, :3] - np.cross(twist[:, 3:], rotation @ offset)
        return np.concatenate([linear, twist[:, 3:]], axis=1)


def joint_motion(answer: dict[str, Any]) -> BPoly:
    """Return the joint motion of an answer: quintics, or cubics if it has no accelerations."""
    known = ["joint_positions", "joint_velocities", "joint_accelerations"]
    rows = [np.asarray(answer[name], float) for name in known if name in answer]
    return BPoly.from_derivatives(np.asarray(answer["time"], float), np.stack(rows, axis=1))


def at_moments(motion: BPoly, duration: float, steps: int = STEPS) -> CubicSpline:
    """Return the smooth motion through the positions at equal steps, its first and last rates."""
    ends = [(1, motion(time, 1)) for time in (0.0, duration)]
    moments = np.linspace(0.0, duration, steps + 1)
    return CubicSpline(moments, motion(moments), bc_type=tuple(ends))


def flown(chain: Chain, scenario: dict[str, Any], motion: BPoly, steps: int = STEPS) -> Flight:
    """Return the motion of the system whose joints follow a motion, from a scenario's start."""
    duration = float(scenario["duration"])
    halves = np.linspace(0.0, duration, 2 * steps + 1)
    smooth = at_moments(motion, duration, steps)
    angles, rates = smooth(halves), smooth(halves, 1)
    posture = chain.posture(angles)
    inertia, moved = momenta(chain, posture)
    inverse = np.linalg.inv(inertia)
    by_joints = (moved @ rates[..., None])[..., 0]
    start, twist = start_of_base(chain, scenario)
    first = inertia[0] @ twist + (moved[0] @ np.asarray(scenario["joints"]["velocity"], float))
    linear = start.rotation[0] @ first[:3]
    angular = start.rotation[0] @ first[3:] + np.cross(start.position[0], linear)

    def base_twist(at: int, place: Array, turn: Array) -> Array:
        """Return the twist of the base in its own axes."""
        held = np.concatenate([turn.T @ linear, turn.T @ (angular - _cross(place, linear))])
        rate: Array = inverse[at] @ (held - by_joints[at])
        return rate

    step = duration / steps
    places, turns = [start.position[0]], [start.rotation[0]]
    for at in range(0, 2 * steps, 2):
        place, turn = places[-1], turns[-1]
        moves, spins = list[Array](), list[Array]()
        for stage, (later, part) in enumerate(((0, 0.0), (1, 0.5), (1, 0.5), (2, 1.0))):
            here, there = place, turn
            if stage:
                here = place + part * step * moves[-1]
                there = turn + part * step * spins[-1]
            v = base_twist(at + later, here, there)
            moves.append(there @ v[:3])
            spins.append(there @ _skew(v[3:]))
        sums = (1.0, 2.0, 2.0, 1.0)
        places.append(place + step / 6 * sum(w * m for w, m in zip(sums, moves, strict=True)))
        turned = turn + step / 6 * sum(w * s for w, s in zip(sums, spins, strict=True))
        turns.append(turned @ (1.5 * np.eye(3) - 0.5 * turned.T @ turned))  # orthogonal again
    base = Placement(np.array(turns), np.array(places))
    whole = Posture(
        [Placement(place.rotation[::2], place.position[::2]) for place in posture.links],
        [(a[::2], b[::2]) for a, b in posture.jacobians],
    )
    own = [base_twist(2 * i, places[i], turns[i]) for i in range(steps + 1)]
    twists = np.einsum("tij,tkj->tki", base.rotation, np.reshape(own, (-1, 2, 3))).reshape(-1, 6)
    links = _link_twists(chain, whole, base, twists, rates[::2])
    return Flight(halves[::2], angles[::2], rates[::2], base, whole, twists, links)


def momenta(chain: Chain, posture: Posture) -> tuple[Array, Array]:
    """Return the matrices from base twist and from joint velocities to the momentum.

    The momentum is linear and angular about the base's origin, in base axes, as is the twist.
    Shapes (times, 6, 6) and (times, 6, joints).
    """
    count = len(posture.links[0].position)
    of_base, of_joints = np.zeros((count, 6, 6)), np.zeros((count, 6, chain.joints))
    for link, place, (linear, turning) in zip(
        chain.links, posture.links, posture.jacobians, strict=True
    ):
        center = place.then(Placement(np.eye(3), link.center)).position
        inertia = place.rotation @ link.inertia @ place.rotation.swapaxes(1, 2)
        lever = _skew(center)
        of_base[:, :3, :3] += link.mass * np.eye(3)
        of_base[:, :3, 3:] -= link.mass * lever
        of_base[:, 3:, :3] += link.mass * lever
        of_base[:, 3:, 3:] += inertia - link.mass * lever @ lever
        of_joints[:, :3] += link.mass * linear
        of_joints[:, 3:] += inertia @ turning + link.mass * lever @ linear
    return of_base, of_joints


def start_of_base(chain: Chain, scenario: dict[str, Any]) -> tuple[Placement, Array]:
    """Return the base link's pose at the start, one row, and its twist in its own axes.

    A scenario has pose and velocity of the chaser's centre of mass, with the base link's axes.
    """
    told = scenario["chaser"]
    turn = Rotation.from_quat(told["quaternion_xyzw"]).as_matrix()
    rate = np.asarray(told["angular_velocity"], float)
    lever = turn @ chain.center
    place = np.asarray(told["position"], float) - lever
    velocity = np.asarray(told["linear_velocity"], float) - np.cross(rate, lever)
    twist = np.concatenate([turn.T @ velocity, turn.T @ rate])
    return Placement(turn[None], place[None]), twist


def torques(chain: Chain, flight: Flight) -> Array:
    """Return the joint torques, by Newton and Euler. Shape (times, joints) [N m].

    Accelerations are differences of the velocities.
    """
    found = np.zeros_like(flight.rates)
    below = [_carried_by(chain, joint) for joint in chain.moved]
    for index, link in enumerate(chain.links):
        if link.mass == 0.0:
            continue
        place = flight.of(flight.posture.links[index])
        twist = flight.link_twists[index]
        inertia = place.rotation @ link.inertia @ place.rotation.swapaxes(1, 2)
        spin = (inertia @ twist[:, 3:, None])[..., 0]
        force, moment = (
            np.gradient(value, flight.times, axis=0, edge_order=2)
            for value in (link.mass * twist[:, :3], spin)
        )
        center = place.then(Placement(np.eye(3), link.center)).position
        for joint, carrier in enumerate(chain.moved):
            if index in below[joint]:
                hinge = flight.of(flight.posture.links[carrier])
                axis = hinge.rotation @ chain.links[carrier].axis
                about = np.cross(center - hinge.position, force) + moment
                found[:, joint] += np.einsum("ti,ti->t", axis, about)
    return found


def _carried_by(chain: Chain, link: int) -> set[int]:
    carried = {link}
    for index, other in enumerate(chain.links):
        if other.parent in carried:
            carried.add(index)
    return carried


def _link_twists(
    chain: Chain, posture: Posture, base: Placement, twists: Array, rates: Array
) -> list[Array]:
    found = []
    for link, place, (linear, turning) in zip(
        chain.links, posture.links, posture.jacobians, strict=True
    ):
        center = place.then(Placement(np.eye(3), link.center)).position
        lever = (base.rotation @ center[..., None])[..., 0]
        moved = (base.rotation @ (linear @ rates[..., None]))[..., 0]
        turned = (base.rotation @ (turning @ rates[..., None]))[..., 0]
        velocity = twists[:, :3] + np.cross(twists[:, 3:], lever) + moved
        found.append(np.concatenate([velocity, twists[:, 3:] + turned], axis=1))
    return found


def _cross(a: Array, b: Array) -> Array:
    return np.array(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    )


def _skew(vectors: Array) -> Array:
    """Return matrices that multiply as the cross product does. Shape (..., 3, 3)."""
    x, y, z = np.moveaxis(vectors, -1, 0)
    zero = np.zeros_like(x)
    rows = [[zero, -z, y], [z, zero, -x], [-y, x, zero]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def tip_map(chain: Chain, flight: Flight) -> tuple[Array, Array]:
    """Return J_D at the end of a flight, and the tip's twist there, both in the inertial frame.

    J_D maps changes of the joint velocities to changes of the twist at constant momentum. Shapes
    (6, joints) and (6,). A method may use it to aim; the scorer does not.
    """
    last = chain.posture(flight.angles[-1:])
    of_base, of_joints = (rows[0] for rows in momenta(chain, last))
    reaction = -np.linalg.solve(of_base, of_joints)
    point = last.links[chain.tip].position[0]
    moved = reaction.copy()
    moved[:3] -= _skew(point) @ reaction[3:]
    for joint, link in enumerate(chain.moved):
        axis = last.links[link].rotation[0] @ chain.links[link].axis
        moved[:3, joint] += np.cross(axis, point - last.links[link].position[0])
        moved[3:, joint] += axis
    turn = flight.base.rotation[-1]
    jacobian = np.concatenate([turn @ moved[:3], turn @ moved[3:]])
    return jacobian, flight.twist_at(chain.tip, chain)[-1]
