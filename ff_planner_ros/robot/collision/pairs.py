"""Which bodies of a robot must not touch each other, and which links may."""

from __future__ import annotations

import itertools
from collections.abc import Collection, Iterator, Sequence
from typing import TypeAlias
from xml.etree.ElementTree import Element

import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.robot.collision.bodies import Body
from ff_planner_ros.robot.urdf.srdf import ADJACENT, ALWAYS, NEVER, Links, MayTouch
from ff_planner_ros.robot.urdf.urdf_tree import link_of

Pairs: TypeAlias = tuple[tuple[int, int], ...]  # of bodies, by index

# Links that touch in this share of random postures overlap by design; MoveIt's assistant uses the
# same share.
ALWAYS_SHARE = 0.95
# Random postures for that while a robot is loaded, and for an SRDF, as many as MoveIt's draws.
QUICK_SAMPLES, SAMPLES = 200, 10_000
# Links count as never touching only if none of those postures brings them so near [m].
NEVER_MARGIN = 0.01
_SEED = 0


def pairs_of(bodies: Sequence[Body], may_touch: Collection[Links]) -> Pairs:
    """Return the pairs of bodies that can move relative to each other and may not touch."""
    return tuple(
        (first, second)
        for first, second in itertools.combinations(range(len(bodies)), 2)
        if bodies[first].joint != bodies[second].joint
        and frozenset((bodies[first].link, bodies[second].link)) not in may_touch
    )


def neighbours(robot: Element, bodies: Sequence[Body]) -> list[MayTouch]:
    """Return pairs of links of which one carries the other, skipping links without a solid.

    Args:
        robot: `<robot>` with all links and joints.
    """
    above = {link_of(joint, "child"): link_of(joint, "parent") for joint in robot.findall("joint")}
    solid = dict.fromkeys(body.link for body in bodies)
    found = []
    for link in solid:
        carrier = above.get(link)
        while carrier is not None and carrier not in solid:
            carrier = above.get(carrier)
        if carrier is not None:
            found.append(MayTouch(carrier, link, ADJACENT))
    return found


def always_touching(
    model: pin.Model, bodies: Sequence[Body], may_touch: Collection[Links]
) -> list[MayTouch]:
    """Return further links that touch in nearly every posture: a wrist drawn with overlap, say."""
    pairs = pairs_of(bodies, may_touch)
    # Pairs that are apart in more than half of the first tenth cannot reach that share any more.
    first = touching_share(model, bodies, pairs, QUICK_SAMPLES // 10)
    pairs = tuple(pair for pair, share in zip(pairs, first, strict=True) if share >= 0.5)
    shares = touching_share(model, bodies, pairs, QUICK_SAMPLES)
    return [
        MayTouch(*links, ALWAYS)
        for links, share in _by_links(bodies, pairs, shares).items()
        if share >= ALWAYS_SHARE
    ]


def moveit_pairs(robot: Element, model: pin.Model, bodies: Sequence[Body]) -> list[MayTouch]:
    """Return the pairs that MoveIt's assistant disables: neighbours, always or never touching.

    Links that are fixed to each other count, too, as in MoveIt.

    Args:
        robot: `<robot>` with all links and joints.
    """
    adjacent = neighbours(robot, bodies)
    next_to = {pair.links for pair in adjacent}
    pairs = tuple(
        (first, second)
        for first, second in itertools.combinations(range(len(bodies)), 2)
        if bodies[first].link != bodies[second].link
        and frozenset((bodies[first].link, bodies[second].link)) not in next_to
    )
    touching = _by_links(bodies, pairs, touching_share(model, bodies, pairs, SAMPLES))
    apart = tuple(pair for pair in pairs if touching[_links(bodies, pair)] == 0.0)
    near = _by_links(bodies, apart, touching_share(model, bodies, apart, SAMPLES, NEVER_MARGIN))
    always = [MayTouch(*links, ALWAYS) for links, s in touching.items() if s >= ALWAYS_SHARE]
    never = [MayTouch(*links, NEVER) for links, share in near.items() if share == 0.0]
    return [*adjacent, *always, *never]


def touching_share(
    model: pin.Model, bodies: Sequence[Body], pairs: Pairs, samples: int, margin: float = 0.0
) -> Array:
    """Return the share of random postures in which the bodies of each pair touch. Shape (pairs,).

    Args:
        samples: Number of postures, within the limits of the joints.
        margin: Largest distance that counts as touching [m].
    """
    if not pairs:
        return np.zeros(0)
    geometry = pin.GeometryModel()
    for body in bodies:
        placed = pin.GeometryObject(body.name, body.joint, body.placement_in_joint, body.solid)
        placed.name = f"{body.name} {geometry.ngeoms}"
        geometry.addGeometryObject(placed)
    for pair in pairs:
        geometry.addCollisionPair(pin.CollisionPair(*pair))
    data, found = model.createData(), pin.GeometryData(geometry)
    for request in found.collisionRequests:
        request.security_margin = margin
    touched = np.zeros(len(pairs))
    for q in _postures(model, samples):
        pin.computeCollisions(model, data, geometry, found, q, False)
        touched += [result.isCollision() for result in found.collisionResults]
    return touched / samples


def _postures(model: pin.Model, samples: int) -> Iterator[Array]:
    """Yield random configurations with the chaser at the origin, always the same ones."""
    rng = np.random.default_rng(_SEED)
    q = pin.neutral(model)
    for _ in range(samples):
        q[7:] = rng.uniform(model.lowerPositionLimit[7:], model.upperPositionLimit[7:])
        yield q


def _by_links(bodies: Sequence[Body], pairs: Pairs, shares: Array) -> dict[tuple[str, str], float]:
    """Return the largest share of each pair of links."""
    found: dict[tuple[str, str], float] = {}
    for pair, share in zip(pairs, shares, strict=True):
        links = _links(bodies, pair)
        found[links] = max(found.get(links, 0.0), float(share))
    return found


def _links(bodies: Sequence[Body], pair: tuple[int, int]) -> tuple[str, str]:
    """Return the links of two bodies, always in the same order: a link's bodies are consecutive."""
    return bodies[pair[0]].link, bodies[pair[1]].link
