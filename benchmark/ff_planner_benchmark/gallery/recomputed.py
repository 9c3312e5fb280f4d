"""What others published, beside the same motion on our models."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

from ff_planner_benchmark.gallery.compared import Compared
from ff_planner_benchmark.gallery.laws import (
    Reference,
    on_circle,
    resolved,
    smoothed_bang_bang,
    springs,
)
from ff_planner_benchmark.gallery.motions import (
    Moved,
    at_start,
    by_law,
    by_torques,
    driven,
    ee_pose,
    quintic,
    sampled,
)
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.robot.model import Base, Robot, load_robot
from ff_planner_ros.robot.momentum import arm_jacobian, generalised_jacobian

HERE = Path(__file__).resolve().parent
# Runge-Kutta steps of a given joint motion: more change no printed digit.
_STEPS = 400


def model(name: str, base: Base = Base.FREE_FLYER, root: str = "base") -> Robot:
    """Return a robot of the gallery."""
    return load_robot(HERE / "models" / f"{name}.urdf", root, "end_effector", base)


def as_printed(name: str) -> Robot:
    """Return a robot with its inertias as printed, also where no body can have them."""
    robot = model(name)
    changed = robot.model.copy()
    text = (HERE / "models" / f"{name}.urdf").read_text(encoding="utf-8")
    for number, values in re.findall(r'<link name="link_(\d)">\s*<!-- as printed: (.*) -->', text):
        given = dict(one.split() for one in values.split(", "))
        xx, xy, xz, yy, yz, zz = (
            float(given.get(f"i{axes}", 0.0)) for axes in ("xx", "xy", "xz", "yy", "yz", "zz")
        )
        body = changed.inertias[int(number) + 1]
        tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        changed.inertias[int(number) + 1] = pin.Inertia(body.mass, body.lever, tensor)
    return replace(robot, model=changed)


PLANAR_START = np.array([-1.0882, 0.7349, 1.9241])


def planar_testbed() -> Iterator[Compared]:
    """P1: the torques and the velocities of its files, each held for 10 ms."""
    robot = model("cbk_planar", Base.PLANAR, "satellite")
    torques, rates = np.split(np.loadtxt(HERE / "cbk_planar.txt"), 2, axis=1)

    def row(time: float) -> int:
        return min(int(time / 0.01 + 1e-9), len(torques) - 1)

    driven_by = by_torques(robot, PLANAR_START, lambda t, _q, _v: torques[row(t)], 4.99, 0.01)
    led_by = by_law(robot, PLANAR_START, lambda t, _q: rates[row(t)], 4.99, 0.001)
    own = "their dynamics freeze the pose within a Runge-Kutta step"
    yield Compared("base turn, torques", "deg", "-13.967", driven_by.turn)
    yield Compared("base turn, velocities", "deg", "-13.965", led_by.turn)
    for moved, printed in (
        (driven_by, ("0.999870", "0.000529", "1.837259")),
        (led_by, ("0.999839", "0.000544", "1.837209")),
    ):
        source = "torques" if moved is driven_by else "velocities"
        pose = moved.ee()
        heading = float(np.arctan2(pose.rotation[1, 0], pose.rotation[0, 0]))
        found = (*pose.translation[:2], heading)
        names = (("x", "m"), ("y", "m"), ("heading", "rad"))
        for (name, unit), digits, ours in zip(names, printed, found, strict=True):
            what = f"end effector {name}, {source}"
            yield Compared(what, unit, digits, float(ours), "recomputed", own, within=3.0)
    straight = driven(robot, quintic(PLANAR_START, driven_by.q[-1, 7:], 5.0), _STEPS)
    yield Compared("base turn, one quintic a joint", "deg", "-14.00", straight.turn, "recomputed")


def _line(begin: Array, attitude: Array) -> Reference:
    way = np.array([-0.20, 0.10, -0.15])

    def reference(time: float) -> tuple[Array, Array, Array, Array]:
        s = min(time / 4.0, 1.0)
        place = begin + (10 * s**3 - 15 * s**4 + 6 * s**5) * way
        velocity = (30 * s**2 - 60 * s**3 + 30 * s**4) / 4.0 * way
        return place, attitude, velocity, np.zeros(3)

    return reference


def _tumble(begin: Array, attitude: Array) -> Reference:
    axis = np.array([0.3, 1.0, 0.5])
    rate = np.deg2rad(5.0) * axis / np.linalg.norm(axis)

    def reference(time: float) -> tuple[Array, Array, Array, Array]:
        turned = Rotation.from_rotvec(rate * time).as_matrix() @ attitude
        return begin, turned, np.zeros(3), rate

    return reference


def _errors(moved: Moved, reference: Reference) -> tuple[Array, Array]:
    """Return the errors of position [mm] and attitude [deg] at all points."""
    off = list[tuple[float, float]]()
    for point, time in enumerate(moved.time.tolist()):
        place, attitude, _, _ = reference(time)
        there = moved.ee(point)
        turn = Rotation.from_matrix(attitude @ there.rotation.T).magnitude()
        off.append(
            (1e3 * float(np.linalg.norm(place - there.translation)), float(np.rad2deg(turn)))
        )
    positions, attitudes = np.array(off).T
    return positions, attitudes


def _root_mean_square(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def srs_sine() -> Iterator[Compared]:
    """P2a: sines of the joints, and the mass ratios at their start."""
    robot, start = model("srs_arm"), np.array([0.3, 0.5, -0.3, 1.0, 0.2, 0.6, 0.1])
    size = np.array([0.4, 0.3, 0.5, 0.4, 0.3, 0.2, 0.3])
    rate = np.array([1.0, 1.5, 0.8, 1.2, 2.0, 1.0, 1.5]) * np.pi / 2

    def sine(time: Array) -> tuple[Array, Array, Array]:
        angle = rate * time
        velocities, accelerations = rate * np.cos(angle), -(rate**2) * np.sin(angle)
        return start + size * np.sin(angle), size * velocities, size * accelerations

    by_euler = by_law(robot, start, lambda t, _q: size * rate * np.cos(rate * t), 2.0, 0.01)
    yield Compared("base turn, Euler steps of 10 ms", "deg", "6.94", by_euler.turn)
    exact = driven(robot, sampled(sine, np.linspace(0.0, 2.0, _STEPS + 1)), _STEPS)
    yield Compared("base turn, converged", "deg", "6.97513", exact.turn, "recomputed")
    q, data = at_start(robot, start), robot.model.createData()
    for name, jacobian, printed in (
        ("fixed base", arm_jacobian, "0.843"),
        ("free base", generalised_jacobian, "0.643"),
    ):
        speed = float(np.linalg.norm((jacobian(robot, data, q) @ (size * rate))[:3]))
        yield Compared(f"end effector's first speed, {name}", "m/s", printed, speed)
    arm = pin.computeTotalMass(robot.model) - 100.0
    for ratio, printed in ((0.5, "0.036"), (5.0, "0.351"), (10.0, "0.539"), (100.0, "0.928")):
        changed = robot.model.copy()
        body = changed.inertias[1]
        grown = ratio * arm / body.mass
        changed.inertias[1] = pin.Inertia(ratio * arm, body.lever, grown * body.inertia)
        of_ratio = replace(robot, model=changed)
        free, fixed = (
            jacobian(of_ratio, changed.createData(), q)
            for jacobian in (generalised_jacobian, arm_jacobian)
        )
        part = np.sqrt(np.linalg.det(free @ free.T) / np.linalg.det(fixed @ fixed.T))
        what = f"manipulability free / fixed, base {ratio:g} times the arm"
        yield Compared(what, "", printed, float(part))


@lru_cache(maxsize=1)
def srs_line() -> tuple[Compared, ...]:
    """P2b: a straight line by two Jacobians."""
    robot, start = model("srs_arm"), _SRS_START
    begin = ee_pose(robot, at_start(robot, start)).copy()
    reference, found = _line(begin.translation, begin.rotation), list[Compared]()
    for fixed, numbers in ((False, ("0.251", "0.242")), (True, ("26.372", None))):
        law = resolved(robot, start, reference, position_only=True, fixed_base=fixed)
        moved = by_law(robot, start, law, 4.0, 0.01)
        positions, _ = _errors(moved, reference)
        name = "fixed-base Jacobian" if fixed else "generalised Jacobian"
        if not fixed:
            found.append(Compared("base turn", "deg", "6.88", moved.turn))
        errors = (_root_mean_square(positions), float(positions[-1]))
        for what, printed, ours in zip(("RMS", "final"), numbers, errors, strict=True):
            if printed is not None:
                found.append(Compared(f"{what} error, {name}", "mm", printed, ours))
    return tuple(found)


_SRS_START = np.array([0.3, 0.4, -0.2, 0.8, 0.1, 0.5, 0.0])


def srs_hold() -> Iterator[Compared]:
    """P2c: a pose held on a target that tumbles."""
    robot, start = model("srs_arm"), _SRS_START
    begin = ee_pose(robot, at_start(robot, start)).copy()
    reference = _tumble(begin.translation, begin.rotation)
    for fixed, numbers in ((False, ("0.0084", "0.00058")), (True, ("4.267", "0.220"))):
        law = resolved(robot, start, reference, position_only=False, fixed_base=fixed)
        moved = by_law(robot, start, law, 10.0, 0.01)
        if not fixed:
            yield Compared("base turn", "deg", "2.44", moved.turn)
        name = "fixed-base" if fixed else "generalised"
        units, errors = (("position", "mm"), ("attitude", "deg")), _errors(moved, reference)
        for (what, unit), printed, off in zip(units, numbers, errors, strict=True):
            ours = _root_mean_square(off)
            yield Compared(f"RMS error of {what}, {name} Jacobian", unit, printed, ours)


BASILISK_GOALS = np.deg2rad([-30.0, 45.0, 90.0, -20.0])
BASILISK_ACCELERATIONS = np.deg2rad([0.01, 0.01, 0.02, 0.02])


def basilisk_arm() -> Iterator[Compared]:
    """P4: springs that follow the profile, in Runge-Kutta steps of 0.1 s."""
    robot = model("basilisk_arm", root="hub")
    profile = smoothed_bang_bang(BASILISK_GOALS, BASILISK_ACCELERATIONS, 10.0)
    moved = by_torques(robot, np.zeros(4), springs(profile, 500.0, 100.0), 300.0, 0.1)
    yield Compared("hub turn after 300 s", "deg", "11.746464", moved.turn, "recomputed")
    yield Compared("largest hub turn", "deg", "11.746538", moved.peak, "recomputed")
    attitude = Rotation.from_quat(moved.q[-1, 3:7]).as_mrp()
    printed = ("-0.00655848", "0.00782525", "-0.05027218")
    for axis, digits, ours in zip("xyz", printed, attitude, strict=True):
        what = f"hub attitude, MRP {axis}"
        yield Compared(what, "", digits, float(ours), "recomputed", within=1.0)
    straight = driven(robot, quintic(np.zeros(4), BASILISK_GOALS, 138.0), _STEPS)
    what = "hub turn, one quintic a joint over 138 s"
    yield Compared(what, "deg", "12.0519", straight.turn, "recomputed")


_COMPLIANCE_START = np.array([1.59, -0.3, 0.07, -1.52, 0.07, 1.42, -2.41])
# Largest and last base turn [deg], error [mm], by mass of the base and law.
_CIRCLES = {
    (30, False): ("17.895", "8.373", "0.144"),
    (30, True): ("1.939", "0.0004", "49.7"),
    (300, False): ("1.2225", "0.3761", "0.116"),
    (300, True): ("0.1981", "0.0093", "0.162"),
    (3000, False): ("0.0403", "0.0090", "0.121"),
    (3000, True): ("0.0275", "0.0050", "0.108"),
}


def compliance_circles(quick: bool = False) -> Iterator[Compared]:
    """P5: two of five laws on the circle, position only.

    Args:
        quick: Whether to integrate in steps of 2.5 ms, which have the turns to the printed digits,
            instead of theirs of 0.5 ms, and to leave out the law that runs into joint limits.
    """
    for (mass, spares), printed in _CIRCLES.items():
        hits_limits = (mass, spares) == (30, True)
        if quick and hits_limits:
            continue
        step = 0.0025 if quick else 0.0005
        found = on_circle(model(f"compliance_{mass}"), _COMPLIANCE_START, spares, step)
        law = "impedance and reaction null space" if spares else "damped least squares"
        remark = "its joints run into their limits and chatter there" if hits_limits else ""
        within = np.inf if hits_limits else 1.0 if quick else 0.5
        ours = (found.peak, found.turn, 1e3 * found.position_error)
        units = (("largest base turn", "deg"), ("last base turn", "deg"), ("RMS error", "mm"))
        for (what, unit), digits, value in zip(units, printed, ours, strict=True):
            if what == "RMS error":
                if quick:
                    continue
                within = max(within, 2.0)
                remark = remark or "differs by 1 % at most, by when the servos take the command"
            label = f"{what}, {law}, {mass} kg"
            yield Compared(label, unit, digits, value, remark=remark, within=within)


def learned_half_circle() -> Iterator[Compared]:
    """P6: one quintic a joint between the ends of the half circle."""
    robot = model("space_robot_rl", Base.PLANAR)
    end = np.deg2rad([-29.35, 93.05, -94.43, 36.60])
    moved = driven(robot, quintic(np.zeros(4), end, 8.5), _STEPS)
    remark = "the joints' last angles are printed to 0.01 deg, which leaves 0.005 deg and 0.4 mm"
    what = "base turn, one quintic a joint"
    yield Compared(what, "deg", "0.0000", moved.turn, "recomputed", remark, within=50.0)
    what = "end effector x"
    yield Compared(what, "m", "3.7", float(moved.ee().translation[0]), "recomputed")


def _given(
    robot: Robot,
    ends: tuple[Array, Array],
    duration: float,
    turn: str,
    place: tuple[str, ...],
) -> Iterator[Compared]:
    """Compare base turn and end effector of one quintic a joint."""
    moved = driven(robot, quintic(*ends, duration), _STEPS)
    yield Compared("base turn", "deg", turn, moved.turn, "recomputed")
    for axis, digits, ours in zip("xyz", place, moved.ee().translation, strict=False):
        yield Compared(f"end effector {axis}", "m", digits, float(ours), "recomputed")


def spart() -> Iterator[Compared]:
    """P8: quintics on the models of two of SPART's examples."""
    goal = np.deg2rad([60.0, 45.0, -90.0])
    place = ("-0.22572", "0.14472", "1.89777")
    yield from _given(model("spart_3dof"), (np.zeros(3), goal), 20.0, "8.3249", place)
    ends = np.deg2rad([[45.0, -45.0, -45.0, 45.0], [90.0, -45.0, -45.0, 0.0]])
    planar = model("spart_planar", Base.PLANAR)
    in_plane = ("3.43627", "-0.36692")
    yield from _given(planar, (ends[0], ends[1]), 10.0, "-36.1312", in_plane)


def ets_vii() -> Iterator[Compared]:
    """P9: a quintic, with the inertias as printed."""
    goal = np.deg2rad([60.0, -45.0, 60.0, 0.0, 45.0, 0.0])
    place = ("-0.35463", "1.13566", "2.5283")
    yield from _given(as_printed("ets_vii"), (np.zeros(6), goal), 60.0, "1.3443", place)


COMPARISONS: dict[str, Callable[[], Iterator[Compared] | tuple[Compared, ...]]] = {
    "P1": planar_testbed,
    "P2a": srs_sine,
    "P2b": srs_line,
    "P2c": srs_hold,
    "P4": basilisk_arm,
    "P5": compliance_circles,
    "P6": learned_half_circle,
    "P8": spart,
    "P9": ets_vii,
}
