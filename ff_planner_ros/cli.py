"""The command `ff-planner`."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from ff_planner_ros.commands.parser import command_parser
from ff_planner_ros.commands.planning import BAD_INPUT, NO_PLAN, run_node
from ff_planner_ros.errors import FfPlannerError, NoPlanFound


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code.

    0: done; 2: bad input; 3: no plan found, or one that does not come true.
    """
    parser = command_parser()
    options, rest = parser.parse_known_args(arguments)
    if rest and options.command is not run_node:
        parser.error(f"unrecognized arguments: {' '.join(rest)}")
    options.rest = rest
    try:
        return int(options.command(options))
    except NoPlanFound as error:
        return _fail(error, NO_PLAN)
    except (FfPlannerError, OSError) as error:
        return _fail(error, BAD_INPUT)
    except ModuleNotFoundError as error:
        missing = str(error.name)
        if missing.startswith(__package__):
            raise
        return _fail(
            f"this command needs ROS 2, and there is no module {missing}: "
            "`pip install ./msg_defs '.[ros]'` brings it along, or source a ROS workspace",
            BAD_INPUT,
        )


def _fail(error: Exception | str, code: int) -> int:
    print(f"ff-planner: {error}", file=sys.stderr)
    return code


if __name__ == "__main__":
    sys.exit(main())
