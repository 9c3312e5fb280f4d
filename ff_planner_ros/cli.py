"""The command `ff-planner`."""

from __future__ import annotations

import os
import re
import select
import sys
import warnings
from argparse import ArgumentParser
from collections.abc import Callable, Sequence
from io import TextIOWrapper
from pathlib import Path
from traceback import extract_tb, walk_tb

from ff_planner_ros.commands import BAD_INPUT, INTERRUPTED, NO_PLAN
from ff_planner_ros.commands.options import require_outputs
from ff_planner_ros.commands.parser import command_parser
from ff_planner_ros.common.shown import in_log, shortened
from ff_planner_ros.errors import LONGEST_MESSAGE, FfPlannerError, InvalidInput, NoPlanFound

# Faults of one input that are printed: a screen, where thousands of obstacles may be wrong alike.
_MOST_FAULTS = 20
_OF_ROS = re.compile(r"rclpy|rpyutils|rosidl\w*|launch\w*|ament\w*|\w+_(msgs|srvs|interfaces)")
_JOINS_ROS = {"console": "node", "doctor": "controller"}  # if this option is given
DEFECT = "this is a defect of ff-planner, please report it"


def main(
    arguments: Sequence[str] | None = None,
    make_parser: Callable[[], ArgumentParser] = command_parser,
) -> int:
    """Run one command and return its exit code.

    0: done; 2: bad input; 3: no plan found, or a plan that the simulation does not reproduce; 130:
    interrupted. An unexpected exception is printed in one line and returns 2, too; `python -X dev
    -m ff_planner_ros.cli` shows its traceback.

    Args:
        arguments: Without the program's name; None: those of the process.
        make_parser: Builds the parser of the program: `ff-planner`, or another one.
    """
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # a file's name may be any bytes
    # Where numbers grow beyond all bounds, the answer says so.
    warnings.filterwarnings("ignore", r".* encountered in ", RuntimeWarning)
    warnings.showwarning = _note  # of libraries
    parser = make_parser()
    options, rest = parser.parse_known_args(arguments)
    of_ros = _JOINS_ROS.get(options.verb, "")
    joins = options.verb == "ask" or getattr(options, of_ros, None) is not None
    if rest and not (joins and rest[:1] == ["--ros-args"]):
        parser.error(f"unrecognized arguments: {' '.join(rest)}")
    options.rest = rest

    def work() -> int:
        require_outputs(options)
        return int(options.function(options))

    return _answered(parser.prog, work)


def planner_node() -> int:
    """Run the node `ff_planner` with the ROS arguments of the process; return its exit code."""

    def work() -> int:
        from ff_planner_ros.ros.node import main as run

        return run()

    return _answered("planner_node", work)


def _answered(program: str, work: Callable[[], int]) -> int:
    """Do the work of a program and return its exit code; what it raises is an answer."""
    try:
        code = work()
        sys.stdout.flush()
        return code
    except KeyboardInterrupt:
        return _fail(program, "interrupted", INTERRUPTED)
    except NoPlanFound as error:
        return _fail(program, error, NO_PLAN)
    except (FfPlannerError, OSError) as error:
        return 0 if _is_of_reader(error) else _fail(program, error, BAD_INPUT)
    except ImportError as error:
        module = _module_at_fault(error)
        if not module or module.partition(".")[0] == __package__:
            raise  # it is no file's fault
        return _fail(program, _why_not_loaded(module, error), BAD_INPUT)
    except Exception as error:  # unexpected: a script can still go on
        if sys.flags.dev_mode:
            raise
        defect = f"{DEFECT}: {type(error).__name__} {_place(error)}: {error}"
        return _fail(program, defect, BAD_INPUT)


def _module_at_fault(error: ImportError) -> str:
    """Return which module is missing, or cannot be loaded though it is there; empty: not known."""
    if isinstance(error, ModuleNotFoundError):
        return error.name or ""
    frames = walk_tb(error.__traceback__)
    modules = [str(frame.f_globals.get("__name__", "")) for frame, _ in frames]
    # What we import first that is not ours; below it, it imports its own.
    inside = [one for one in modules if one.partition(".")[0] not in (__package__, "importlib")]
    others = [one for one in inside if one not in ("__main__", "builtins")]
    return others[0].partition(".")[0] if others else error.name or ""


def _why_not_loaded(module: str, error: ImportError) -> str:
    """Return in words what to do about a module that is missing, or is there but broken."""
    first, is_missing = str(error).splitlines()[0], isinstance(error, ModuleNotFoundError)
    found = f"there is no module {module}" if is_missing else f"{module} cannot be loaded: {first}"
    if not _OF_ROS.fullmatch(module.partition(".")[0]):
        return f"this command needs {module}: {found}; `ff-planner doctor` says what brings it"
    brings = "`pip install ./msg_defs '.[ros]'` brings it along, or source a ROS workspace"
    return f"this command needs ROS 2, and {found}: {brings}"


def _is_of_reader(error: Exception) -> bool:
    """Tell whether the reader of stdout has gone, as behind `| head`; further output is dropped."""
    if not isinstance(error, BrokenPipeError):
        return False
    printed = sys.stdout.fileno()
    poll = select.poll()
    poll.register(printed, 0)  # a pipe without a reader is reported as an error
    if not poll.poll(0):
        return False
    os.dup2(os.open(os.devnull, os.O_WRONLY), printed)
    return True


def _place(error: Exception) -> str:
    """Return where in our sources an error came from."""
    ours = [at for at in extract_tb(error.__traceback__) if __package__ in at.filename]
    return f"at {Path(ours[-1].filename).name}:{ours[-1].lineno}" if ours else ""


def _note(message: Warning | str, *_: object, **__: object) -> None:
    print(f"ff-planner: note: {in_log(str(message))}", file=sys.stderr)


def _fail(program: str, error: Exception | str, code: int) -> int:
    faults = error.faults if isinstance(error, InvalidInput) else (error,)
    for one in faults[:_MOST_FAULTS]:
        print(f"{program}: {in_log(shortened(str(one), LONGEST_MESSAGE))}", file=sys.stderr)
    if more := len(faults[_MOST_FAULTS:]):
        print(f"{program}: and {more} more, which `ff-planner check` lists", file=sys.stderr)
    return code


if __name__ == "__main__":
    sys.exit(main())
