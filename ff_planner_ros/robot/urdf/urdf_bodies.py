"""The rigid bodies of a URDF, of links fixed to each other, and their mass and inertia."""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection
from typing import NamedTuple, TypeAlias
from xml.etree.ElementTree import Element, SubElement

import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.robot.urdf.urdf_faults import Faults, InertiaChoice
from ff_planner_ros.robot.urdf.urdf_tree import Tree, link_of

# Inertias are written with few digits: for a thin rod, where the triangle inequality holds
# with equality, rounding must not count as a fault.
TRIANGLE_TOLERANCE = 1e-6

# Smallest mass [kg], principal moment of inertia [kg m2] and velocity limit [rad/s, m/s] of a
# robot; smaller values are rounding.
SMALLEST = 1e-12


# Part of a link, its value, what is allowed.
Fault: TypeAlias = tuple[str, object, str]

_ENTRIES = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
_ROWS_AND_COLUMNS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


class Weight(NamedTuple):
    """Mass and inertia of links, in the frame of one of them."""

    mass: float  # [kg]
    center: Array  # of mass; shape (3,) [m]
    inertia: Array  # about the centre of mass; shape (3, 3) [kg m2]


def placement(element: Element | None) -> pin.SE3:
    """Return the pose of an `<origin>` whose numbers are sound; None: identity."""
    xyz, rpy = (
        np.array((element.get(key) or "0 0 0").split() if element is not None else 3 * [0], float)
        for key in ("xyz", "rpy")
    )
    return pin.SE3(pin.rpy.rpyToMatrix(rpy), xyz)


def check_bodies(
    tree: Tree,
    placements: dict[str, pin.SE3 | None],
    base_link: str,
    faults: Faults,
    choice: InertiaChoice = InertiaChoice.POSSIBLE,
) -> list[str]:
    """Check mass and inertia of every body, and rewrite them so that every URDF reader takes them.

    The body as a whole counts: a link fixed to another may be a point mass without inertia, or have
    a small inertia that is impossible. If a body has such links, its first link gets the mass and
    inertia of all. Returns notes on impossible inertias, and on what became of them.

    Args:
        placements: Placement of each link in the frame of the one that carries it; None: faulty.
    """
    notes = list[str]()
    in_links = {
        name: _chosen(link, _weight_of_link(name, link, faults), choice, notes)
        for name, link in tree.links.items()
    }
    at_fault = _ends_of_faulty_joints(tree, base_link)
    for body, places in _bodies(tree, placements).items():
        weights = {link: _placed(in_links[link], place) for link, place in places.items()}
        # Faulty links and additional roots are faults already.
        members = {link: weight for link, weight in weights.items() if weight is not None}
        if len(members) < len(weights) or (len(tree.roots) > 1 and body in tree.roots):
            continue
        total = _sum(members.values())
        if choice is InertiaChoice.NEAREST and (no_body := _no_body(total)):
            total = _possible(body, total, no_body, notes)
        # What hangs together by a joint that is at fault may be one body when that is mended.
        hidden = total.mass < SMALLEST and at_fault & members.keys()
        fault = None if hidden else _no_body(total, choice)
        careless = {link: _no_link(weight) for link, weight in members.items()}
        for link, wrong in careless.items():
            if wrong and (fault or (link == body and choice is not InertiaChoice.AS_GIVEN)):
                faults.add("link", link, *wrong)
            elif wrong:
                part, value, _ = wrong
                notes.append(
                    f"link {link!r} {part} is {value}, which no body has: it counts as written"
                    + ("" if link == body else ", as part of what it is fixed to")
                )
        if fault and not any(careless.values()):
            faults.add("link", base_link if base_link in members else body, *fault)
        if not fault and any(_weighs(weight) and _no_body(weight) for weight in members.values()):
            for link in members:
                _write_inertia(tree.links[link], total if link == body else None)
    return notes


def _ends_of_faulty_joints(tree: Tree, base_link: str) -> set[str]:
    """Return the links at joints that cannot move, or that carry the base and do not hold it."""
    below = list(tree.upwards(base_link))
    return {
        link_of(joint, end)
        for joint in tree.above.values()
        if joint.get("type") not in ("fixed", "revolute", "prismatic")
        or (joint in below and joint.get("type") != "fixed")
        for end in ("parent", "child")
    }


def joint_weight(
    tree: Tree,
    places: dict[str, pin.SE3],
    faults: Faults,
    choice: InertiaChoice,
    notes: list[str],
) -> Weight:
    """Return mass and inertia of all links together, in the root's frame.

    Impossible inertias of links are faults, unless they are to count.

    Args:
        places: Placement of each link in the root's frame.
        notes: Gets those on impossible inertias.
    """
    weights = list[Weight]()
    for name in tree.order:
        link = tree.links[name]
        weight = _chosen(link, _weight_of_link(name, link, faults), choice, notes)
        weight = _placed(weight, places[name])
        wrong = None if weight is None else _no_link(weight)
        if wrong and choice is InertiaChoice.AS_GIVEN:
            notes.append(f"link {name!r} {wrong[0]} is {wrong[1]}, which no body has: it counts")
        elif wrong:
            faults.add("link", name, *wrong)
            continue
        if weight is not None:
            weights.append(weight)
    total = _sum(weights)
    if choice is InertiaChoice.NEAREST and (no_body := _no_body(total)):
        total = _possible(tree.order[0], total, no_body, notes)
    return total


def too_wide(link: Element, size: float) -> list[str]:
    """Return a note on a link whose mass is, by its inertia, further out than a length allows.

    All mass within a distance R of the centre of mass means I <= m R^2. CAD programs export g mm2.

    Args:
        link: One with an inertia that has passed the check.
        size: Of its body, or of the robot [m]: at least twice such an R.
    """
    weight = _weight_of_link("", link, Faults())
    if weight is None or not weight.mass > 0.0:
        return []
    largest = max(0.0, float(np.linalg.eigvalsh(weight.inertia)[2]))
    gyration = math.sqrt(largest / weight.mass)
    if not gyration > size:
        return []
    note = (
        f"link {link.get('name')!r} has a radius of gyration sqrt(I/m) of {gyration:.4g} m, by "
        f"{largest:.4g} kg m2 and {weight.mass:.4g} kg, and the room of {size:.3g} m: its inertia "
        "is too large, or not in kg m2"
    )
    return [note]


def _bodies(
    tree: Tree, placements: dict[str, pin.SE3 | None]
) -> dict[str, dict[str, pin.SE3 | None]]:
    """Return the links of each body, by its first link, with their placements in its frame."""
    first_link: dict[str, str] = {}
    bodies: dict[str, dict[str, pin.SE3 | None]] = {}
    for link in tree.order:
        joint = tree.above.get(link)
        if joint is None or joint.get("type") != "fixed":
            first_link[link] = link
            bodies[link] = {link: pin.SE3.Identity()}
            continue
        parent = link_of(joint, "parent")
        body = first_link[link] = first_link[parent]
        carrier, placed = bodies[body][parent], placements[link]
        bodies[body][link] = carrier * placed if carrier and placed else None
    return bodies


def _weight_of_link(name: str, link: Element, faults: Faults) -> Weight | None:
    """Return mass and inertia of a link in its own frame; None: they are faulty."""
    inertial = link.find("inertial")
    if inertial is None:
        return Weight(0.0, np.zeros(3), np.zeros((3, 3)))
    told = len(faults)
    origin, inertia = inertial.find("origin"), inertial.find("inertia")
    faults.vectors("link", name, "inertial origin", origin)
    mass = faults.number("link", name, "mass", inertial.find("mass"), "value")
    entries = 6 * [0.0]
    if inertia is not None:
        entries = [faults.number("link", name, f"inertia {key}", inertia, key) for key in _ENTRIES]
    if mass < 0.0:
        faults.add("link", name, "mass", mass, "it must not be negative")
    if len(faults) > told:
        return None
    if mass == 0.0 and not any(entries):
        link.remove(inertial)
    matrix = np.empty((3, 3))
    for entry, (row, column) in zip(entries, _ROWS_AND_COLUMNS, strict=True):
        matrix[row, column] = matrix[column, row] = entry
    return _placed(Weight(mass, np.zeros(3), matrix), placement(origin))


def _placed(weight: Weight | None, place: pin.SE3 | None) -> Weight | None:
    """Return a weight in the frame in which its own frame is placed."""
    if weight is None or place is None:
        return None
    turn = place.rotation
    return Weight(weight.mass, place.act(weight.center), turn @ weight.inertia @ turn.T)


def _sum(weights: Collection[Weight]) -> Weight:
    """Return the total weight of links that are fixed to each other, by Steiner's theorem."""
    mass = sum(weight.mass for weight in weights)
    center = sum((weight.mass * weight.center for weight in weights), np.zeros(3))
    if mass > 0.0:
        center = center / mass
    inertia = np.zeros((3, 3))
    for weight in weights:
        arm = weight.center - center
        inertia += weight.inertia + weight.mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return Weight(mass, center, inertia)


def _weighs(weight: Weight) -> bool:
    return bool(weight.mass > 0.0 or weight.inertia.any())


def _no_link(weight: Weight) -> Fault | None:
    """Return why a link cannot have such an inertia; it may be a mere frame or a point."""
    if weight.mass == 0.0 and weight.inertia.any():
        return "mass", weight.mass, "it must be positive: the link has an inertia"
    return _impossible(weight, least=-TRIANGLE_TOLERANCE * np.abs(weight.inertia).max())


def _no_body(weight: Weight, choice: InertiaChoice = InertiaChoice.POSSIBLE) -> Fault | None:
    """Return why a body that moves cannot have such an inertia, or may not if it is as given."""
    if weight.mass < SMALLEST:
        allowed = "a link that moves must have mass, its own or of links fixed to it"
        return "mass", weight.mass, allowed
    wrong = _impossible(weight, least=SMALLEST)
    # The equations of motion need no more than positive moments.
    borne = choice is InertiaChoice.AS_GIVEN and np.linalg.eigvalsh(weight.inertia)[0] >= SMALLEST
    return None if borne else wrong


def _impossible(weight: Weight, least: float) -> Fault | None:
    smallest, middle, largest = np.linalg.eigvalsh(weight.inertia)
    value = f"of principal moments {_moments(weight)}"
    if smallest < least:
        return (
            "inertia",
            value,
            f"all three must be positive, >= {SMALLEST:g}: see option inertia",
        )
    if largest > (smallest + middle) * (1.0 + TRIANGLE_TOLERANCE):
        return (
            "inertia",
            value,
            "the largest must not exceed the sum of the others: see option inertia",
        )
    return None


def _moments(weight: Weight) -> str:
    return ", ".join(f"{moment:.6g}" for moment in np.linalg.eigvalsh(weight.inertia))


def _chosen(
    link: Element, weight: Weight | None, choice: InertiaChoice, notes: list[str]
) -> Weight | None:
    """Return the weight of a link, in its frame, that counts, and write it if it is another."""
    wrong = None if weight is None or choice is not InertiaChoice.NEAREST else _no_link(weight)
    if weight is None or wrong is None:
        return weight
    weight = _possible(link.get("name", ""), weight, wrong, notes)
    _write_inertia(link, weight)
    return weight


def _possible(link: str, weight: Weight, wrong: Fault, notes: list[str]) -> Weight:
    """Return a weight with the nearest inertia that a body has, and add a note."""
    part, value, _ = wrong
    if part != "inertia":
        return weight  # nothing is nearest to a mass that is missing
    found = weight._replace(inertia=nearest_possible(weight.inertia))
    change = float(np.linalg.norm(found.inertia - weight.inertia))
    notes.append(
        f"link {link!r} inertia is {value}, which no body has: the nearest possible one counts, "
        f"{_moments(found)}, which is {change:.3g} kg m2 away"
    )
    return found


def nearest_possible(inertia: Array) -> Array:
    """Return the inertia of a body that is nearest in the Frobenius norm. Shape (3, 3).

    The second moments of a density are S = tr(I)/2 1 - I, which has the principal axes of I. No
    body has negative ones; these are positive, so that the body turns about every axis. So the
    principal moments are projected onto half of each sum of two less the third >= least.
    """
    moments, axes = np.linalg.eigh(inertia)
    least = max(SMALLEST, SMALLEST * float(np.abs(moments).max()))
    planes = 0.5 - np.eye(3)  # S = planes @ I, along the axes
    candidates = []
    for active in itertools.product((False, True), repeat=3):
        rows = planes[list(active)]
        candidates.append(moments + np.linalg.pinv(rows) @ (least - rows @ moments))
    # The nearest candidate that fulfils all; rounding of the largest is far below the least
    fit = [one for one in candidates if (planes @ one >= 0.5 * least).all()]
    nearest = min(fit, key=lambda one: float(np.linalg.norm(one - moments)))
    found: Array = axes @ np.diag(nearest) @ axes.T
    return found / 2.0 + found.T / 2.0


def _write_inertia(link: Element, weight: Weight | None) -> None:
    """Write the `<inertial>` of a link, in its frame; None: remove it."""
    before = link.find("inertial")
    if before is not None:
        link.remove(before)
    if weight is None:
        return
    written = SubElement(link, "inertial")
    SubElement(written, "origin", xyz=" ".join(repr(float(x)) for x in weight.center))
    SubElement(written, "mass", value=repr(float(weight.mass)))
    entries = (weight.inertia[place] for place in _ROWS_AND_COLUMNS)
    values = {key: repr(float(entry)) for key, entry in zip(_ENTRIES, entries, strict=True)}
    SubElement(written, "inertia", values)
