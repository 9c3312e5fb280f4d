"""The commands `robot` and `console`: a URDF, a scenario or a bag to look at."""

from __future__ import annotations

import time
from argparse import Namespace
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from ff_planner_ros.commands import SCENARIOS, SOLVED
from ff_planner_ros.commands.options import (
    Add,
    add_output,
    refuse_given,
    require_file,
    require_picture,
)
from ff_planner_ros.commands.printed import print_notes, print_table, write_json
from ff_planner_ros.errors import FfPlannerError, InvalidInput, Status
from ff_planner_ros.robot.collision.geometry import Geometry

if TYPE_CHECKING:
    from ff_planner_ros.console.entries import Entry
    from ff_planner_ros.console.serve import Served
    from ff_planner_ros.robot.model import Robot

_DAY = 86_400.0
_PORTS = 65_535
_PATIENCE = 10.0  # [s]
_COLUMNS = 80  # of the page of a robot


def add_robot(add: Add) -> None:
    """Add `robot`."""
    robot = add(
        "robot",
        show_robot,
        "show what the planner makes of a URDF",
    )
    robot.add_argument("urdf", type=Path, metavar="URDF")
    xacro_help = "arguments of a URDF that ends in .xacro, as there: 'side:=left'"
    robot.add_argument("--xacro-arguments", default="", metavar="NAME:=VALUE ..", help=xacro_help)
    inertia_help = "inertias that no body has: refused by default (possible), or loaded"
    robot.add_argument(
        "--inertia",
        choices=["possible", "as_given", "nearest_possible"],
        default="possible",
        help=inertia_help,
    )
    robot.add_argument("--base-link", metavar="LINK", help="default: the root")
    tip_help = "default: the only link that moves and carries no other"
    robot.add_argument("--tip-link", metavar="LINK", help=tip_help)
    locked_help = "joints to lock, and where [rad, m]: 'rail: 0.2, hand: -1.0'; as a scenario's"
    robot.add_argument("--locked-joints", default="", metavar="JOINT: AT,..", help=locked_help)
    robot.add_argument(
        "--geometry",
        choices=[one.value for one in Geometry],
        help="default: shapes where the arm has any <collision>",
    )
    add_output(robot, "--json", "FILE", "write what it shows, in SI units", require_file)
    picture_help = "draw it from three sides: links, joints with their axes, centre of mass, tip"
    add_output(robot, "--picture", "FILE.svg|png", picture_help, require_picture)
    draw_help = "draw it, bodies and lines, as a page for a browser"
    add_output(robot, "--draw", "FILE.html", draw_help, require_file)
    srdf_help = (
        "write an SRDF of links that may touch: neighbours, and those that always or never touch "
        "in 10,000 random postures"
    )
    add_output(robot, "--srdf", "FILE", srdf_help, require_file)


def show_robot(options: Namespace) -> int:
    """Print a robot as the planner reads it from a URDF; draw it and write an SRDF if asked."""
    from ff_planner_ros.analysis.plan_json import refusal_dictionary
    from ff_planner_ros.analysis.robot_page import robot_facts, robot_rows

    try:
        robot = _robot_of(options)
    except FfPlannerError as error:
        write_json(options.json, refusal_dictionary(error, 0.0))
        raise
    facts = robot_facts(robot)
    print_table(list(robot_rows(facts)), _COLUMNS)
    write_json(options.json, facts)
    if options.picture is not None:
        from ff_planner_ros.analysis.drawing.robot_picture import save_picture

        save_picture(robot, options.picture)
    if options.draw is not None:
        from ff_planner_ros.analysis.drawing.robot_view import save_robot

        save_robot(robot, options.draw)
        print(f"\n{options.draw}  {options.draw.stat().st_size / 1e6:.1f} MB")
    if options.srdf is not None:
        _write_srdf(options.srdf, robot)
    return SOLVED


def _robot_of(options: Namespace) -> Robot:
    from ff_planner_ros.parameters.robot import locked_joints_of, xacro_arguments_of
    from ff_planner_ros.robot.model import read_urdf, robot_from_urdf_text
    from ff_planner_ros.robot.urdf.urdf_faults import InertiaChoice

    arguments = xacro_arguments_of(options.xacro_arguments)
    return robot_from_urdf_text(
        read_urdf(options.urdf, xacro_arguments=arguments),
        options.base_link,
        options.tip_link,
        held_at=locked_joints_of(options.locked_joints),
        geometry=None if options.geometry is None else Geometry(options.geometry),
        directory=options.urdf.resolve().parent,
        inertia=InertiaChoice(options.inertia),
    )


def _write_srdf(file: Path, robot: Robot) -> None:
    """Write an SRDF of the links that may touch, as MoveIt's assistant does."""
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


def add_console(add: Add) -> None:
    """Add `console`."""
    console = add(
        "console",
        open_console,
        "see, change and plan a scenario, see a bag, or release plans of a node, in the browser",
        description="Serve a page for the browser: the scene over time, what can be changed in "
        "it, and a table of plans. Nothing is fetched from the network.",
        epilog="With --node, what follows --ros-args goes to ROS.",
    )
    console.add_argument(
        "source",
        type=Path,
        nargs="?",
        metavar="SCENARIO|BAG",
        help="a scenario (.yaml) or a bag (a directory or .mcap; needs ROS); with --node, a "
        "scenario whose goal is asked for first",
    )
    node_help = "a running node, for instance ff_planner: it plans, and publishes what is released"
    console.add_argument("--node", metavar="NAME", help=node_help)
    timeout_help = "how long to look for the node (default: %(default)g)"
    console.add_argument(
        "--timeout", type=float, default=_PATIENCE, metavar="SECONDS", help=timeout_help
    )
    host_help = "where others can come to (default: this machine only)"
    console.add_argument("--host", default="127.0.0.1", metavar="ADDRESS", help=host_help)
    console.add_argument("--port", type=int, default=8321, metavar="N", help="default: 8321")


def open_console(options: Namespace) -> int:
    """Serve the page of the console until interrupted."""
    if find_spec("viser") is None:
        raise FfPlannerError(
            Status.UNSUPPORTED,
            "the console needs viser: pip install 'ff_planner_ros[console]', or where this "
            "package came without pip, pip install viser",
        )
    if not 0 < options.port <= _PORTS:
        allowed = f"it must be from 1 to {_PORTS}"
        raise InvalidInput(Status.OUT_OF_RANGE, "--port", options.port, allowed)
    if options.node is not None:
        return _open_live(options)
    refuse_given(options, {"timeout": _PATIENCE}, "it counts beside --node alone")
    if options.source is None:
        allowed = "it must be given, or --node"
        raise InvalidInput(Status.UNSUPPORTED, "SCENARIO|BAG", "missing", allowed)
    entries = _entries(options.source)
    from ff_planner_ros.console.page import Page
    from ff_planner_ros.console.serve import serve

    _until_interrupted(serve(lambda server: Page(server, entries), options.host, options.port))
    return SOLVED


def _open_live(options: Namespace) -> int:
    """Serve the page of a running node."""
    from ff_planner_ros.common.arrays import finite_number
    from ff_planner_ros.console.live.open import live_page
    from ff_planner_ros.console.serve import serve

    patience = finite_number("--timeout", options.timeout, above=0.0)
    page = live_page(options.node, options.source, patience, options.rest)
    try:
        _until_interrupted(serve(page.page_on, options.host, options.port))
    finally:
        page.close()
    return SOLVED


def _until_interrupted(served: Served) -> None:
    print(served.address, flush=True)
    print("Open it in a browser; Ctrl+C ends it.", flush=True)
    try:
        while True:
            time.sleep(_DAY)
    except KeyboardInterrupt:
        served.server.stop()


def _entries(source: Path) -> list[Entry]:
    """Return the page's first entries: an unplanned scenario, or the plans of a bag."""
    if source.suffix in SCENARIOS:
        from ff_planner_ros.console.entries import Entry
        from ff_planner_ros.parameters import load_parameters
        from ff_planner_ros.planning.scenario.scenario import Defaults, load_task
        from ff_planner_ros.planning.task.notes import notes_on_files

        task = load_task(source, Defaults(load_parameters().planner))
        print_notes(notes_on_files(task))
        return [Entry(source.stem, task, status="not planned")]
    from ff_planner_ros.console.from_bag import entries_of_bag

    entries, notes = entries_of_bag(source)
    print_notes(notes)
    return entries
