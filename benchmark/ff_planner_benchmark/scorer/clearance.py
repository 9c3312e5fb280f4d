"""Clearance of a flight to obstacles and between the robot's bodies, also between samples.

Between two samples a point cannot come much nearer to a sphere's centre than at the samples: it
moves along a chord of known length, and leaves the chord by no more than its curvature allows.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from ff_planner_benchmark.scorer.chain import Array, Chain, Posture, Solid
from ff_planner_benchmark.scorer.flight import Flight

# Between two samples the curvature is at most this many times that of the samples.
_MORE_BENT = 2.0
# Pairs of solids are measured only while their bounding balls are nearer than this [m].
_NEAR = 0.05
# A step in which a pair could come nearer than at any sample is divided into so many parts.
_PARTS = 16


class Obstacle(NamedTuple):
    """A moving sphere."""

    centers: Array  # inertial; shape (times, 3) [m]
    radius: float  # [m]


class Body(NamedTuple):
    """The motion of a free body, in the inertial frame."""

    center: Array  # of mass; shape (times, 3) [m]
    rotations: Array  # body to inertial axes; shape (times, 3, 3)
    rates: Array  # angular velocities; shape (times, 3) [rad/s]


def body_motion(told: dict[str, Any], times: Array) -> Body:
    """Return the torque-free motion of a scenario's target body, by Euler's equations.

    Args:
        told: The scenario's `target_body`.
        times: Since the scenario's start, ascending. Shape (times,) [s].
    """
    i = told["inertia"]
    inertia = np.array(
        [
            [i["ixx"], i["ixy"], i["ixz"]],
            [i["ixy"], i["iyy"], i["iyz"]],
            [i["ixz"], i["iyz"], i["izz"]],
        ]
    )
    first = Rotation.from_quat(told["quaternion_xyzw"])
    rate = first.inv().apply(told["angular_velocity"])

    def change(_: float, state: Array) -> Array:
        x, y, z, w = state[:4]
        a, b, c = spin = state[4:]
        turned = [w * a + y * c - z * b, w * b + z * a - x * c, w * c + x * b - y * a]
        slowed = np.linalg.solve(inertia, np.cross(inertia @ spin, spin))
        return np.array([*turned, -(x * a + y * b + z * c), *(2 * slowed)]) / 2

    begin = np.concatenate([first.as_quat(), rate])
    way = solve_ivp(change, (0.0, times[-1]), begin, "DOP853", times, rtol=1e-11, atol=1e-12).y.T
    turns = Rotation.from_quat(way[:, :4])
    drift = times[:, None] * np.asarray(told["linear_velocity"], float)
    return Body(told["position"] + drift, turns.as_matrix(), turns.apply(way[:, 4:]))


def obstacles(scenario: dict[str, Any], times: Array) -> Iterator[Obstacle]:
    """Yield a scenario's spheres over time: its own, and those of the target body."""
    for sphere in scenario["obstacles"]:
        velocity = np.asarray(sphere.get("velocity", (0.0, 0.0, 0.0)), float)
        yield Obstacle(sphere["center"] + times[:, None] * velocity, sphere["radius"])
    if "target_body" in scenario:
        body = body_motion(scenario["target_body"], times)
        for sphere in scenario["target_body"]["obstacles"]:
            yield Obstacle(body.center + body.rotations @ sphere["center"], sphere["radius"])


def clearance(
    chain: Chain, scenario: dict[str, Any], flight: Flight, must_not_touch: list[list[str]]
) -> tuple[float, float]:
    """Return the least distance at the samples, and a lower bound for all times [m].

    Infinite: there are no obstacles and no pairs.

    Args:
        must_not_touch: Pairs of links of the robot, by name.
    """
    found = [(np.inf, np.inf)]
    spheres = list(obstacles(scenario, flight.times))
    if scenario["robot"].get("geometry", "lines") == "lines":
        points = chain.points(flight.posture)
        points = np.einsum("tij,tpj->tpi", flight.base.rotation, points)
        points += flight.base.position[:, None]
        for sphere in spheres:
            seen = points - sphere.centers[:, None]
            away = from_lines(seen)
            found.append(_between(away, seen, sphere.radius))
    else:
        for solid in chain.solids:
            place = flight.of(flight.posture.links[solid.link].then(solid.at))
            for sphere in spheres:
                inside = np.einsum("tji,tj->ti", place.rotation, sphere.centers - place.position)
                # How any point of the solid moves as the sphere sees it: the corners' way
                corners = np.einsum("tij,cj->tci", place.rotation, _corners(solid))
                seen = place.position[:, None] + corners - sphere.centers[:, None]
                found.append(_between(_from_solid(solid, inside), seen, sphere.radius))
        found += _own(chain, flight, must_not_touch)
    return min(one for one, _ in found), min(bound for _, bound in found)


def _between(away: Array, seen: Array, radius: float) -> tuple[float, float]:
    """Return the least distance from a sphere at the samples, and a lower bound between them.

    Args:
        away: Distance from the sphere's centre. Shape (times,) [m].
        seen: Points whose hull holds what moves, relative to the centre. (times, points, 3) [m].
    """
    chords = np.linalg.norm(np.diff(seen, axis=0), axis=2).max(axis=1)
    bends = np.linalg.norm(np.diff(seen, 2, axis=0), axis=2).max(axis=1)
    bends = np.concatenate([bends[:1], np.maximum(bends[:-1], bends[1:]), bends[-1:]])
    nearer = np.minimum(away[:-1], away[1:])
    half_way = np.sqrt(np.maximum(np.maximum(nearer, 0.0) ** 2 - (chords / 2) ** 2, 0.0))
    # Deep in a solid the distance, negative there, changes by as much as the points move.
    lowest = np.where(nearer > chords / 2, half_way, nearer - chords / 2) - _MORE_BENT * bends / 8
    return float(away.min() - radius), float(lowest.min() - radius)


def from_lines(seen: Array) -> Array:
    """Return the distance of polylines to the origin, (times,) [m]; seen: (times, points, 3)."""
    first, along = seen[:, :-1], np.diff(seen, axis=1)
    squares = np.maximum((along**2).sum(axis=2), 1e-30)
    part = np.clip(-(first * along).sum(axis=2) / squares, 0.0, 1.0)
    least: Array = np.linalg.norm(first + part[..., None] * along, axis=2).min(axis=1)
    return least


def _from_solid(solid: Solid, points: Array) -> Array:
    """Return the distances of points in a solid's own frame to it; negative inside."""
    if solid.kind == "sphere":
        away: Array = np.linalg.norm(points, axis=1) - solid.sizes[0]
        return away
    if solid.kind == "box":
        beyond = np.abs(points) - np.array(solid.sizes) / 2
    else:
        radius, length = solid.sizes
        across = np.hypot(points[:, 0], points[:, 1]) - radius
        beyond = np.stack([across, np.abs(points[:, 2]) - length / 2], axis=1)
    outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=1)
    signed: Array = outside + np.minimum(beyond.max(axis=1), 0.0)
    return signed


def _half_edges(solid: Solid) -> Array:
    """Return half the edges of the box around a solid."""
    if solid.kind == "box":
        return np.array(solid.sizes) / 2
    radius = solid.sizes[0]
    return np.array([radius, radius, radius if solid.kind == "sphere" else solid.sizes[1] / 2])


def _corners(solid: Solid) -> Array:
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    corners: Array = signs * _half_edges(solid)
    return corners


def _own(
    chain: Chain, flight: Flight, must_not_touch: list[list[str]]
) -> Iterator[tuple[float, float]]:
    """Yield least distance and lower bound of each pair of the robot's solids, by Coal."""
    pairs = {frozenset(pair) for pair in must_not_touch}
    ends = [(1, rates) for rates in flight.rates[[0, -1]]]
    smooth = CubicSpline(flight.times, flight.angles, bc_type=tuple(ends))
    parts = np.linspace(0.0, 1.0, _PARTS + 1)
    for number, one in enumerate(chain.solids):
        for other in chain.solids[:number]:
            if frozenset((chain.names[one.link], chain.names[other.link])) not in pairs:
                continue
            away, bounds = _apart((one, other), flight.posture)
            least, lowest = float(away.min()), float(bounds.min())
            coarse = np.flatnonzero(bounds < min(least, _NEAR))
            if coarse.size:  # there once more, in parts
                begins, step = flight.times[coarse], flight.times[1]
                fine = chain.posture(smooth((begins[:, None] + parts * step).ravel()))
                finer, between = _apart((one, other), fine)
                # The last of each row is from one step to another
                between = np.append(between, np.inf).reshape(coarse.size, -1)[:, :-1]
                bounds[coarse] = between.min(axis=1)
                least, lowest = min(least, float(finer.min())), float(bounds.min())
            yield least, lowest


def _apart(solids: tuple[Solid, Solid], posture: Posture) -> tuple[Array, Array]:
    """Return the distance of two solids in each posture, and a lower bound between postures.

    Distances of far pairs are themselves lower bounds.
    """
    import coal

    kinds = {"box": coal.Box, "cylinder": coal.Cylinder, "sphere": coal.Sphere}
    shapes = [kinds[solid.kind](*solid.sizes) for solid in solids]
    (one, other), request, result = solids, coal.DistanceRequest(), coal.DistanceResult()
    a, b = (posture.links[solid.link].then(solid.at) for solid in solids)
    # As the first solid sees the second one's corners
    corners = np.einsum("tij,cj->tci", b.rotation, _corners(other)) + b.position[:, None]
    seen = np.einsum("tji,tcj->tci", a.rotation, corners - a.position[:, None])
    chords = np.linalg.norm(np.diff(seen, axis=0), axis=2).max(axis=1)
    balls = sum(float(np.linalg.norm(_half_edges(solid))) for solid in (one, other))
    away = np.linalg.norm(a.position - b.position, axis=1) - balls
    for at in np.flatnonzero(away < _NEAR):
        first, second = (coal.Transform3s(p.rotation[at], p.position[at]) for p in (a, b))
        result.clear()
        away[at] = coal.distance(shapes[0], first, shapes[1], second, request, result)
    return away, (away[:-1] + away[1:] - chords) / 2
