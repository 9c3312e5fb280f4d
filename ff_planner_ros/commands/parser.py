"""Every command of `ff-planner`, in the order of its help."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from collections.abc import Callable
from typing import Any

from ff_planner_ros.commands.verbs import bags, planning, studies

ADDERS = (
    studies.add_bench,
    studies.add_campaign,
    planning.add_compare,
    planning.add_demo,
    studies.add_doctor,
    bags.add_export,
    bags.add_info,
    bags.add_recover,
    planning.add_node,
    planning.add_plan,
    bags.add_replay,
    bags.add_report,
    planning.add_robot,
    planning.add_verify,
)


def command_parser() -> ArgumentParser:
    """Return the parser; what it reads holds the function of the command as `command`."""
    parser = ArgumentParser(
        prog="ff-planner",
        description="Trajectory planning for free-floating space manipulators.",
        epilog="Exit code: 0 done, 2 bad input, 3 no plan found, or one that does not come true.",
    )
    commands = parser.add_subparsers(metavar="COMMAND", required=True)

    def add(
        name: str, function: Callable[[Namespace], int], summary: str, **more: Any
    ) -> ArgumentParser:
        command = commands.add_parser(name, help=summary, **more)
        command.set_defaults(command=function)
        return command

    for adder in ADDERS:
        adder(add)
    return parser
