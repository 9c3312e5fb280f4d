"""README.md, CONTRIBUTING.md and docs/ as tests read them: commands, and what is shown of them."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

SOURCE_TREE = Path(__file__).resolve().parents[1]
README = SOURCE_TREE / "README.md"
DOCS = SOURCE_TREE / "docs"
PAGES = [README, SOURCE_TREE / "CONTRIBUTING.md", *sorted(DOCS.rglob("*.md"))]
_HEADING_OR_FENCE = re.compile(r"^#+ .*?$|^ *```(\w*)\n(.*?)^ *```$", re.MULTILINE | re.DOTALL)


class Command(NamedTuple):
    """One command of a console block, its continuations included."""

    text: str

    @property
    def words(self) -> list[str]:
        return shlex.split(self.text, comments=True)

    @property
    def options(self) -> list[str] | None:
        """Arguments of `ff-planner`; None: another command."""
        words = self.words
        return words[1:] if words[0].endswith("ff-planner") else None


class Shown(NamedTuple):
    """A block without a language, and the console block above it under the same heading."""

    commands: list[Command]
    lines: list[str]


def text_of(page: Path) -> str:
    return page.read_text(encoding="utf-8")


def console(page: Path) -> list[Command]:
    """Return every command of a page, in order."""
    blocks = _HEADING_OR_FENCE.findall(text_of(page))
    return [one for language, text in blocks if language == "console" for one in _commands(text)]


def shown(page: Path) -> Iterator[Shown]:
    """Yield what a page shows of its commands; a block without a command above shows none."""
    above: list[Command] = []
    for block in _HEADING_OR_FENCE.finditer(text_of(page)):
        if block[1] is None:
            above = []
        elif block[1] == "console":
            above = _commands(block[2])
        elif block[1] == "" and above:
            yield Shown(above, block[2].splitlines())


def _commands(text: str) -> list[Command]:
    commands: list[Command] = []
    pending = ""
    for line in text.splitlines():
        pending += line.strip() + "\n"
        try:
            shlex.split(pending, comments=True)
        except ValueError:  # a quotation goes on
            continue
        commands.append(Command(pending.strip()))
        pending = ""
    assert not pending, f"{pending} never ends"
    return commands
