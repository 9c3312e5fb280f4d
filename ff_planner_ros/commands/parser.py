"""Every command of `ff-planner`, in the order of its help."""

from __future__ import annotations

from argparse import SUPPRESS, Action, ArgumentParser, Namespace
from collections.abc import Callable
from typing import Any

from ff_planner_ros.commands import bags, campaigns, doctor, files, planning, robot, ros

ADDERS = (
    ros.add_ask,
    campaigns.add_campaign,
    files.add_check,
    planning.add_compare,
    robot.add_console,
    ros.add_demo,
    doctor.add_doctor,
    bags.add_export,
    bags.add_info,
    bags.add_recover,
    planning.add_plan,
    bags.add_replay,
    bags.add_report,
    robot.add_robot,
    planning.add_verify,
)


def command_parser() -> ArgumentParser:
    """Return the parser; the options that it reads hold `verb`, and the `function` that runs it."""
    parser = ArgumentParser(
        prog="ff-planner",
        description="Trajectory planning for free-floating space manipulators.",
        epilog="Exit code: 0 done, 2 bad input, 3 no plan found, or one that was not reproduced, "
        "130 interrupted.",
    )
    parser.add_argument(
        "--version", action=_Version, nargs=0, dest=SUPPRESS, help="print the version and end"
    )
    commands = parser.add_subparsers(metavar="COMMAND", dest="verb", required=True)

    def add(
        verb: str, function: Callable[[Namespace], int], summary: str, **more: Any
    ) -> ArgumentParser:
        command = commands.add_parser(verb, help=summary, **more)
        command.set_defaults(function=function)
        return command

    for adder in ADDERS:
        adder(add)
    return parser


class _Version(Action):
    """Prints the version, which no other command has to look up."""

    def __call__(self, parser: ArgumentParser, *_: Any) -> None:
        from importlib.metadata import version

        print(f"{parser.prog} {version('ff_planner_ros')}")
        parser.exit()
