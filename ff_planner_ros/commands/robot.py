"""The command `robot`: what the planner makes of a URDF."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path
from typing import TYPE_CHECKING

from ff_planner_ros.commands import SOLVED
from ff_planner_ros.commands.options import Add
from ff_planner_ros.commands.printed import print_notes, print_table
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.robot.collision.geometry import Geometry

if TYPE_CHECKING:
    from ff_planner_ros.robot.model import Robot


def add_robot(add: Add) -> None:
    """Add `robot`."""
    robot = add(
        "robot",
        show_robot,
        "show what the planner makes of a URDF",
    )
    robot.add_argument("urdf", type=Path, metavar="URDF")
    robot.add_argument("--base-link", metavar="LINK", help="default: the root")
    tip_help = "default: the only link that moves and carries no other"
    robot.add_argument("--tip-link", metavar="LINK", help=tip_help)
    robot.add_argument(
        "--geometry",
        choices=[one.value for one in Geometry],
        help="default: shapes where the arm has any <collision>",
    )
    draw_help = "draw it, bodies and lines, as a page for a browser"
    robot.add_argument("--draw", type=Path, metavar="FILE.html", help=draw_help)
    robot.add_argument(
        "--srdf",
        type=Path,
        metavar="FILE",
        help="write an SRDF of links that may touch: neighbours, and those that always or never "
        "touch in 10,000 random postures",
    )


def show_robot(options: Namespace) -> int:
    """Show what the planner makes of a URDF."""
    from ff_planner_ros.analysis.summary import robot_rows
    from ff_planner_ros.robot.model import read_urdf, robot_from_urdf_text

    robot = robot_from_urdf_text(
        read_urdf(options.urdf),
        options.base_link,
        options.tip_link,
        geometry=None if options.geometry is None else Geometry(options.geometry),
        directory=options.urdf.resolve().parent,
    )
    print_notes(robot.notes)
    print_table(robot_rows(robot))
    if options.draw is not None:
        from ff_planner_ros.analysis.drawing.robot_view import save_robot

        save_robot(robot, options.draw)
        print(f"\n{options.draw}  {options.draw.stat().st_size / 1e6:.1f} MB")
    if options.srdf is not None:
        _write_srdf(options.srdf, robot)
    return SOLVED


def _write_srdf(file: Path, robot: Robot) -> None:
    """Write which links may touch, as MoveIt's assistant does."""
    from xml.etree import ElementTree

    from ff_planner_ros.robot.collision.pairs import moveit_pairs
    from ff_planner_ros.robot.urdf.srdf import srdf_text

    if robot.geometry is Geometry.LINES:
        allowed = "only links with a <collision> can touch, and this robot is planned with lines"
        raise InvalidInput(Status.UNSUPPORTED, "--srdf", file, allowed)
    if file.exists():
        allowed = "it is there: an SRDF may hold more, and is not replaced"
        raise InvalidInput(Status.UNSUPPORTED, "--srdf", file, allowed)
    tree = ElementTree.fromstring(robot.urdf)
    pairs = moveit_pairs(tree, robot.model, robot.bodies)
    file.write_text(srdf_text(tree.get("name", ""), pairs), encoding="utf-8")
    print(f"\n{file}: {len(pairs)} pairs of links that may touch")
