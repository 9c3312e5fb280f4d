"""How far a flight stays away from what is in the way, between the samples too.

A point that is so far from a sphere's centre at two samples cannot have been much nearer between
them: it came along a chord whose length is known, and left that by what its curvature allows.
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

# Between two samples nothing bends more than this many times what is seen at the samples.
_MORE_BENT = 2.0
# Pairs of solids are looked at only while the balls around them are nearer than this [m].
_NEAR = 0.05
# A step in which they could come nearer than at any moment is looked at in so many parts.
_PARTS = 16


class Obstacle(NamedTuple):
    """A sphere on its way."""

    centers: Array  # shape (times, 3) [m]
    radius: float


class Body(NamedTuple):
    """A body that moves freely, over time."""

    center: Array  # of mass; shape (times, 3)
    rotations: Array  # to the inertial frame; shape (times, 3, 3)
    rates: Array  # in the inertial frame; shape (times, 3)


def body_motion(told: dict[str, Any], times: Array) -> Body:
    """Turn a body by Euler's equations, free of torque."""
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
    """Yield the spheres that move by themselves, and those of the target body."""
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
    """Return the least distance at the samples, and a lower bound for all times [m]."""
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
    """Return the least distance from a sphere at the samples, and between them.

    Args:
        away: From the sphere's centre. Shape (times,) [m].
        seen: Points whose hull holds what moves, from the sphere's centre. (times, points, 3) [m].
    """
    chords = np.linalg.norm(np.diff(seen, axis=0), axis=2).max(axis=1)
    bends = np.linalg.norm(np.diff(seen, 2, axis=0), axis=2).max(axis=1)
    bends = np.concatenate([bends[:1], np.maximum(bends[:-1], bends[1:]), bends[-1:]])
    nearer = np.minimum(away[:-1], away[1:])
    half_way = np.sqrt(np.maximum(np.maximum(nearer, 0.0) ** 2 - (chords / 2) ** 2, 0.0))
    lowest = np.where(nearer > 0.0, half_way, nearer) - _MORE_BENT * bends / 8
    return float(away.min() - radius), float(lowest.min() - radius)


def from_lines(seen: Array) -> Array:
    """Return the distance of the lines through some points from the origin. Shape (times,)."""
    first, along = seen[:, :-1], np.diff(seen, axis=1)
    squares = np.maximum((along**2).sum(axis=2), 1e-30)
    part = np.clip(-(first * along).sum(axis=2) / squares, 0.0, 1.0)
    least: Array = np.linalg.norm(first + part[..., None] * along, axis=2).min(axis=1)
    return least


def _from_solid(solid: Solid, points: Array) -> Array:
    """Return how far points in a solid's own frame are outside it; inside it is negative."""
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
    """Yield the least distances of pairs of solids of the robot, by Coal."""
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
    """Return how far two solids are apart in each posture, and at least from one to the next."""
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
