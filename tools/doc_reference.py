"""Pages of the reference that code or messages say whole: messages, command line, bag, statuses."""

from __future__ import annotations

import re
from argparse import SUPPRESS, Action, ArgumentParser, HelpFormatter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from doc_advice import ADVICE
from security_policy import INTERFACES

from ff_planner_ros.commands.parser import command_parser
from ff_planner_ros.errors import REMEDIES, Status
from ff_planner_ros.parameters.node import STATE_SOURCES
from ff_planner_ros.ros.messages.interfaces import type_name
from ff_planner_ros.ros.recorder.recording import recorded
from ff_planner_ros.ros.topics import INPUTS, OUTPUTS

DEFINITIONS = Path(__file__).resolve().parents[1] / "msg_defs"
MESSAGES = DEFINITIONS / "msg"
# In the order in which a client meets them; what is in none of these follows by name.
FIRST = ("PlanTrajectory", "PlanRequest", "Goal", "Objective", "Limits", "PlanAnswer", "PlanStatus")

# Where an answer may say something else than its code.
RETRY_OTHERWISE = {
    Status.STATE_TOO_OLD: ". Of a state or scene in the request `retry` is `RETRY_CHANGED`: it "
    "only ages",
    Status.TARGET_TOO_OLD: ". Of a target body in the request `retry` is `RETRY_CHANGED`: it only "
    "ages",
    Status.NO_ACTIVE_PLAN: ". Of a plan that has yet to begin `retry` is `RETRY_LATER`",
    Status.TOO_LATE: ". Of a `start_time` in the request, and at `~/publish_plan`, `retry` is "
    "`RETRY_CHANGED`: it is only further over",
}


def codes() -> str:
    """Return a section for each status: its cause, what to do, and what a program learns."""
    text = (MESSAGES / "PlanStatus.msg").read_text(encoding="utf-8")
    classes = dict(re.findall(r"^#   (\d)xx +(.*)$", text, re.MULTILINE))
    retries = dict(re.findall(r"^uint8 (\w+)=(\d+)", text, re.MULTILINE))
    constants = {int(number): name for name, number in retries.items()}
    causes = re.findall(r"^uint16 (\w+)=(\d+) *(?:# (.*))?$", text, re.MULTILINE)
    parts = []
    for name, number, cause in causes:
        status = Status(int(number))
        if status is Status.SOLVED:
            continue
        if of_class := classes.pop(number[0], ""):
            parts.append(f"## {number[0]}xx: {of_class}\n")
        retry, field, _, _ = REMEDIES[status]
        told = f"`field` is `{field}`" if field else "`field` names the value at fault"
        told += RETRY_OTHERWISE.get(status, "")
        parts.append(
            f"### {number} {name}\n\n{_sentence(cause)} `retry` is `{constants[retry]}`; {told}."
            f"\n\n**What to do:** {ADVICE[status]}\n"
        )
    return "\n" + "\n".join(parts) + "\n"


def _sentence(text: str) -> str:
    return f"{text[:1].upper()}{text[1:]}." if text else ""


def messages() -> str:
    """Return a section for each message, service and action: what its fields mean."""
    paths = sorted(
        (path for path in DEFINITIONS.glob("*/*.*") if path.suffix in SUFFIXES), key=_place
    )
    return "\n" + "\n".join(_definition(path) for path in paths)


SUFFIXES = (".msg", ".srv", ".action")


def _place(path: Path) -> tuple[int, str, str]:
    order = FIRST.index(path.stem) if path.stem in FIRST else len(FIRST)
    return order, path.stem, path.suffix


def _definition(path: Path) -> str:
    """Return what a file of messages says, as a section with tables."""
    parts = path.read_text(encoding="utf-8").split("\n---\n")
    names = {1: [""], 2: ["Request", "Response"], 3: ["Goal", "Result", "Feedback"]}[len(parts)]
    section = [f"## {path.stem}{'' if path.suffix == '.msg' else path.suffix}\n"]
    about, parts[0] = _about(parts[0].removesuffix("---\n"))
    section += [f"{about}\n"] if about else []
    for name, part in zip(names, parts, strict=True):
        section += [f"**{name}**\n"] if name else []
        section.append(_fields(part) or "Empty.\n")
    return "\n".join(section)


def _about(text: str) -> tuple[str, str]:
    """Return the comment on top of a file as a paragraph, lists kept, and the rest."""
    lines = text.splitlines()
    end = next((at for at, line in enumerate(lines) if not line.startswith("#")), len(lines))
    told = [line.removeprefix("#").removeprefix(" ") for line in lines[:end]]
    words = "\n".join(re.sub(r"^  +(\S+) +", r"- `\1`: ", line) for line in told)
    words = re.sub(r"(^|\n)(?=- )(?<!\n\n)", r"\n\n", words, count=1)
    words = re.sub(r"(\n- .*\n)(?=[^-])", r"\1\n", words)
    return words.strip(), "\n".join(lines[end:])


FIELD = re.compile(r"^(\S+) +(\w+)(?:=(\S+))?(?: +# ?(.*))?$")


def _fields(text: str) -> str:
    """Return the constants and the fields of a part, each in a table."""
    constants, fields = [], []
    for line in re.sub(r"\n +# ?", " ", text).splitlines():
        if found := FIELD.match(line):
            kind, name, value, words = found.groups("")
            if value:
                constants.append(f"| `{name}` | {value} | {_cell(words)} |")
            else:
                fields.append(f"| `{name}` | {_type(kind)} | {_cell(words)} |")
        elif line.startswith("#"):
            fields.append(f"| | | *{_cell(line[1:].strip())}:* |")
    tables = []
    if constants:
        tables.append(
            "| constant | value | meaning |\n| --- | --- | --- |\n" + "\n".join(constants)
        )
    if fields:
        tables.append("| field | type | meaning |\n| --- | --- | --- |\n" + "\n".join(fields))
    return "\n\n".join(tables) + "\n" if tables else ""


def _type(kind: str) -> str:
    """Return a type, which leads to its section where it is one of ours."""
    name, bracket, size = kind.partition("[")
    shown = f"[`{name}`](#{name.lower()})" if (MESSAGES / f"{name}.msg").is_file() else f"`{name}`"
    return shown + (f" `{bracket}{size}`" if bracket else "")


def _cell(words: str) -> str:
    return words.replace("|", "\\|")


def command_line() -> str:
    """Return a section for each command: its arguments and options, as its parser has them."""
    parser = command_parser()
    (commands,) = (one for one in parser._actions if one.choices)
    summaries = {one.dest: one.help for one in commands._choices_actions}  # type: ignore[attr-defined]
    parts = [f"\n{parser.epilog}\n"]
    for verb, command in commands.choices.items():  # type: ignore[union-attr]
        parts.append(f"## {verb}\n\n{command.description or _sentence(summaries[verb])}\n")
        rows = [
            f"| {_option(one)} | {_cell(_help(command, one))} |"
            for one in command._actions
            if one.help != SUPPRESS and "--help" not in one.option_strings
        ]
        if rows:
            parts.append("\n".join(["| argument | meaning |", "| --- | --- |", *rows]) + "\n")
        parts += [f"{command.epilog}\n"] if command.epilog else []
    return "\n".join(parts)


def _option(action: Action) -> str:
    """Return an argument as it is written, with what it takes."""
    if action.choices is not None:
        value = "{" + ",".join(map(str, action.choices)) + "}"
    else:
        value = " ".join(
            [action.metavar] if isinstance(action.metavar, str) else action.metavar or ()
        )
    value = f"[{value}]" if action.nargs == "?" else value
    value = f"{value} ..." if action.nargs in ("+", "*") else value
    words = ", ".join(action.option_strings)
    shown = " ".join(filter(None, [words, value if action.nargs != 0 else ""]))
    return f"`{_cell(shown)}`"


def _help(parser: ArgumentParser, action: Action) -> str:
    return HelpFormatter(parser.prog)._expand_help(action) if action.help else ""


def bag_topics() -> Iterator[tuple[str, ...]]:
    """Yield what a node records with simulated time and either state."""
    yield "the planner", "topics"
    topics = {one.name: one for source in STATE_SOURCES for one in recorded(source)}
    for direction, of_table in (("subscribes", INPUTS), ("publishes", OUTPUTS)):
        names = [one.name for one in of_table if topics.pop(one.name, None)]
        yield direction, ", ".join(f"`{name}`" for name in names)
    yield "ROS itself", ", ".join(f"`{name}`" for name in topics)


def interfaces() -> Iterator[tuple[str, ...]]:
    yield "", "name", "type", "quality of service", "peer", "meaning"
    for direction, table in INTERFACES.items():
        for one in table:
            words = f"{one.qos.reliability}, {one.qos.durability}".replace("_", " ")
            qos = words if direction in ("subscribes", "publishes") else ""
            kind = type_name(one.message_type)
            yield direction, f"`{one.name}`", f"`{kind}`", qos, one.peer, one.sentence


def _name_of(kind: Any) -> str:
    """Return a message's type as ROS writes it."""
    package, folder = kind.__module__.split(".")[:2]
    return f"{package}/{folder}/{kind.__name__}"
