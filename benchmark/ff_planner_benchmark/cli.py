"""The command `ff-planner-benchmark`."""

from __future__ import annotations

import sys
from argparse import ArgumentParser, Namespace
from collections.abc import Sequence
from pathlib import Path

from ff_planner_ros import cli
from ff_planner_ros.commands.options import add_output, require_file


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code, as `ff-planner` does."""
    return cli.main(arguments, command_parser)


def command_parser() -> ArgumentParser:
    """Return the parser; the options that it reads hold `verb`, and the `function` that runs it."""
    parser = ArgumentParser(
        prog="ff-planner-benchmark",
        description="Experiments with the planner, and methods compared on a data set.",
        epilog="Exit code: 0 done, 2 bad input, 3 an answer that does not solve its scenario.",
    )
    verbs = parser.add_subparsers(metavar="COMMAND", dest="verb", required=True)

    def add(verb: str, summary: str) -> ArgumentParser:
        command = verbs.add_parser(verb, help=summary)
        command.set_defaults(function=_run)
        return command

    bench = add("bench", "measure speed and success rate")
    bench.add_argument("--quick", action="store_true", help="seconds instead of minutes")
    bench_help = "of each class (default: 200; quick: 4)"
    bench.add_argument("--scenarios", type=int, metavar="N", help=bench_help)
    only_help = "run this experiment only; may be repeated"
    bench.add_argument("--only", action="append", metavar="NAME", help=only_help)

    engines = add("engines", "execute plans of every class in two engines, MuJoCo and Drake")
    engines_help = "of each class (default: %(default)s)"
    engines.add_argument("--scenarios", type=int, default=2, metavar="N", help=engines_help)
    engines.set_defaults(quick=False)
    for command in (bench, engines):
        add_output(command, "--json", "FILE", "write all figures", require_file)

    published = add("published", "plan problems that others published, beside their numbers")
    problem_help = "this problem only, P1 to P16; may be repeated"
    published.add_argument("--only", action="append", metavar="NAME", help=problem_help)
    goals_help = "drawn for P16 (default: %(default)s)"
    published.add_argument("--goals", type=int, default=1000, metavar="N", help=goals_help)
    figures_help = "keep all figures; those of other problems in it stay"
    published.add_argument("--json", type=Path, metavar="FILE", help=figures_help)
    page_help = "write the page (default: print it)"
    published.add_argument("--page", type=Path, metavar="FILE", help=page_help)

    contest = add(
        "contest", "let methods plan the scenarios of a data set, and judge their answers"
    )
    contest.add_argument("directory", type=Path, metavar="DIR", help="of the data set")
    method_help = (
        "all, or ours, rrt_connect, FILE.py, a command (docs/how_to/dataset.md); may be repeated"
    )
    contest.add_argument(
        "--method", action="append", required=True, metavar="METHOD", help=method_help
    )
    each_help = "the first N of each class (default: %(default)s)"
    contest.add_argument("--scenarios", type=int, default=40, metavar="N", help=each_help)
    seconds_help = "processor time for each answer (default: %(default)g)"
    contest.add_argument("--seconds", type=float, default=10.0, metavar="S", help=seconds_help)
    json_help = "keep all figures; a run that was stopped goes on with what the file has"
    contest.add_argument("--json", type=Path, metavar="FILE", help=json_help)

    dataset = add("dataset", "write the data set unless it is there, and compare its hash")
    dataset.add_argument("directory", type=Path, metavar="DIR", help="new, or a data set")
    dataset.add_argument("--seeds", metavar="WHICH", help="public (default), hidden, or a number")
    of_class_help = "of each class (default: all 1,000 of six classes)"
    dataset.add_argument("--scenarios", type=int, metavar="N", help=of_class_help)

    score = add("score", "judge one answer to a scenario of the data set")
    score.add_argument("scenario", type=Path, metavar="SCENARIO.yaml")
    score.add_argument("answer", type=Path, metavar="ANSWER.json")

    reach = add("reach", "how far the arm of P5 reaches in 98 directions, by the chaser's turn")
    reach_help = "figures of the gallery, to which these are added"
    reach.add_argument("--json", type=Path, required=True, metavar="FILE", help=reach_help)
    directions_help = "so many of them, spread evenly (default: %(default)s)"
    reach.add_argument("--directions", type=int, default=98, metavar="N", help=directions_help)

    for command in (contest, dataset):
        workers_help = "processes at a time (default: %(default)s)"
        command.add_argument("--workers", type=int, default=2, metavar="N", help=workers_help)
    return parser


def _run(options: Namespace) -> int:
    from ff_planner_benchmark import commands

    return int(getattr(commands, options.verb)(options))


if __name__ == "__main__":
    sys.exit(main())
