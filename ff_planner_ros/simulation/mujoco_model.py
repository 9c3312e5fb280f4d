"""MuJoCo's model of a free-floating robot, made of its URDF by MuJoCo's own code."""

from __future__ import annotations

import warnings
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator

import numpy as np
from scipy.spatial.transform import Rotation

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.common.shown import shown
from ff_planner_ros.errors import FfPlannerError, InvalidInput, Status
from ff_planner_ros.robot.model import Base
from ff_planner_ros.robot.urdf.locked_joints import mimics
from ff_planner_ros.robot.urdf.urdf_faults import InertiaChoice
from ff_planner_ros.robot.urdf.urdf_xml import INERTIA

try:
    import mujoco as mujoco  # others have it from here: what its absence means is told once
except ModuleNotFoundError:
    raise FfPlannerError(
        Status.UNSUPPORTED,
        "executing a plan needs MuJoCo: pip install 'ff_planner_ros[simulation]', or where this "
        "package came without pip, pip install mujoco-core",
    ) from None

_INERTIAL_FRAME = "world"  # to MuJoCo

# Of joints that follow others, where friction lets MuJoCo's own constraints hold them [s, 1].
_STIFF = [2e-3, 1.0]

# An inertia that nothing on a table moves [kg, kg m2].
_TABLE = 1e12


def specification(urdf: str, slides: bool = False) -> tuple[mujoco.MjSpec, dict[str, str]]:
    """Return MuJoCo's specification of a URDF with a free root link, and its names of the links.

    Args:
        slides: Whether the root link is on three prismatic joints along its axes instead.

    Raises:
        InvalidInput: MuJoCo refuses the URDF.
    """
    tree = ElementTree.fromstring(urdf)
    names = _names_of_links(tree)
    try:
        spec = mujoco.MjSpec.from_string(ElementTree.tostring(tree, encoding="unicode"))
    except ValueError as error:
        raise _refused(error) from None
    spec.comment = tree.get(INERTIA, "")
    spec.compiler.fusestatic = False  # else links fixed to others lose their names
    for name, drive in mimics(urdf).items():
        coupling = spec.add_equality(type=mujoco.mjtEq.mjEQ_JOINT)
        coupling.name1, coupling.name2, coupling.active = name, drive.of, False
        coupling.data[:2] = drive.offset, drive.multiplier
        coupling.solref, coupling.solimp = _STIFF, [0.9999, 0.9999, 1e-3, 0.5, 2.0]
    root = spec.worldbody.first_body()
    if slides:
        for axis in np.eye(3).tolist():
            root.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis)
    else:
        root.add_freejoint()
    return spec, names


def compiled(spec: mujoco.MjSpec) -> mujoco.MjModel:
    """Return the compiled model of a specification.

    Raises:
        InvalidInput: MuJoCo refuses the specification.
    """
    given = dict(_beyond_the_triangle(spec)) if spec.comment == InertiaChoice.AS_GIVEN else {}
    with warnings.catch_warnings():  # what is nearly singular is seen in the numbers
        warnings.simplefilter("ignore")
        try:
            model = spec.compile()
        except ValueError as error:
            raise _refused(error) from None
    for name, (moments, to_link) in given.items():
        model.body(name).inertia[:] = moments
        model.body(name).iquat[:] = np.roll(to_link.as_quat(), 1)
    if given:
        mujoco.mj_setConst(model, mujoco.MjData(model))
    return model


def _beyond_the_triangle(spec: mujoco.MjSpec) -> Iterator[tuple[str, tuple[Array, Rotation]]]:
    """Yield links with positive moments that no body has, and give them those of a ball.

    The compiler refuses them, and the equations of motion do not: see `robot.inertia`.
    """
    for body in spec.bodies:
        xx, yy, zz, xy, xz, yz = body.fullinertia
        if not (body.explicitinertial and np.isfinite(xx)):
            continue
        moments, axes = np.linalg.eigh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        if moments[0] > 0.0 and moments[2] > moments[0] + moments[1]:
            axes[:, 0] *= np.linalg.det(axes)  # right-handed
            in_link = Rotation.from_quat(np.roll(body.iquat, -1)) * Rotation.from_matrix(axes)
            yield body.name, (moments, in_link)
            body.fullinertia = [np.nan, 0.0, 0.0, 0.0, 0.0, 0.0]
            body.inertia = np.full(3, moments[2])


def _refused(error: ValueError) -> InvalidInput:
    reason = shown(" ".join(str(error).split()))
    return InvalidInput(Status.BAD_ROBOT, "robot.urdf", "refused", f"MuJoCo says: {reason}")


def _names_of_links(urdf: ElementTree.Element) -> dict[str, str]:
    """Return MuJoCo's names of links; rename a link `world`, which is its inertial frame."""
    names = {link.get("name", ""): link.get("name", "") for link in urdf.findall("link")}
    if _INERTIAL_FRAME in names:
        while names[_INERTIAL_FRAME] in (_INERTIAL_FRAME, *names):
            names[_INERTIAL_FRAME] += "_"
        for element in urdf.iter():
            for key in ("name", "link"):
                if element.tag in ("link", "parent", "child") and key in element.attrib:
                    element.set(key, names[element.attrib[key]])
    return names


def engine_model(spec: mujoco.MjSpec, base: Base) -> mujoco.MjModel:
    """Return MuJoCo's model of a robot without gravity, damping, friction, contacts and limits.

    A planar base has so much inertia that nothing lifts or tilts it off the table.
    """
    model = compiled(spec)
    model.opt.gravity = 0.0
    model.dof_damping = 0.0  # the planner leaves a URDF's <dynamics> aside, too
    model.dof_frictionloss = 0.0
    borne = np.setdiff1d(range(6), base.rows) if base is Base.PLANAR else np.empty(0, np.intp)
    model.dof_armature[borne] = _TABLE
    if len(borne):
        # It is measured against the mean inertia: dry friction would be lost in the table's.
        model.opt.tolerance /= _TABLE
    model.opt.disableflags = mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_LIMIT
    return model
