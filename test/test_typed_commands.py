"""Every command of README.md, CONTRIBUTING.md and docs/ is typed, and what is shown is compared."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from pages import PAGES, SOURCE_TREE, Command, console, shown, text_of
from shown_results import differences

from ff_planner_ros.cli import main

# Commands that are not typed here, and what types them or why nothing can.
NOT_TYPED = {
    "make ": "the steps of CI",
    r"(\.venv/bin/)?pip ": "`make without-ros` installs like this",
    r"ros2 |export ROS_SECURITY": "no wheel has ROS's command line and its security",
    "dask |.*HOST": "a cluster is needed",
    r"\.venv/bin/planner_node|.*examples/(simulated|mission|follower)": (
        "they run until they are stopped: test_examples.py, test_launch.py and test_demo.py"
    ),
    ".*ff-planner demo": "test_demo.py, test_whole_flight.py",
    ".*ff-planner ask": "a node must run: test_ask.py",
    ".*ff-planner console": "it runs until it is stopped: test_console_in_browser.py",
    ".*my_planner {scenario}": "a program of the reader's",
}
# Commands that take more than 2 s of a core or nearly repeat another; those of many minutes. The
# rest is typed every day where it stands on a page that newcomers read first, else in CI.
CI = re.compile(
    r".*(ff-planner (report|compare)|plan_in_python|rosbags-convert|objective attitude"
    r"|\$BAG --json|--npz|verify answer_bag|--geometry lines"
    r"|--pareto|--draw|--picture|--srdf|--sensitivity|--parquet|--set|> my_planner|rs my_planner)"
)
NIGHTLY = re.compile(
    r".*(ff-planner campaign|ff-planner-benchmark|--library|data_set|ten_thousand"
    r"|two_hundred|by_mass)"
)
# Commands of a page that a tutorial types in CI with nearly the same words, or that another test
# runs there (test_public_interface.py, test_without_ros.py): here, at night.
REPEATED = {
    "after_the_capture": ".*whole_capture",
    "benchmark_robot": ".*compare",
    "without_ros": ".*(plan_in_python|report answer)",
    "analysing_runs": r".*(info \$BAG  |replay|report \$BAG|--csv|--scenarios)",
    "obstacles_and_contacts": ".*bodies",
    "testbeds": ".*planar_capture",
    "tumbling_targets": ".*capture",
}
NOTHING = "$^"
# Pages on what few need: their commands are typed in CI for other files, on other pages.
AT_NIGHT = {
    "air_bearing_table",
    "reaction_wheels",
    "tumbling_target",
    "uncertainty",
    "verification",
}
# Where the benchmark has brought Drake: pages show what `verify` says without it.
OTHER_ENGINES = re.compile(r"\n.*, in other engines: .*\n(?:.*\n)+?as planned .*\n")
FIRST_PAGES = {"README", "without_ros", "your_robot"}
TIERS = ("everyday", "ci", "nightly")


def tier_of(command: Command, page: Path) -> str | None:
    """Return when a command of a page is typed; None: never here."""
    if any(re.match(pattern, command.text) for pattern in NOT_TYPED):
        return None
    at_night = page.stem in AT_NIGHT or NIGHTLY.match(command.text)
    if at_night or re.match(REPEATED.get(page.stem, NOTHING), command.text):
        return "nightly"
    return "ci" if CI.match(command.text) or page.stem not in FIRST_PAGES else "everyday"


def pages_with_commands() -> Iterator[Any]:
    """Yield the pages that are typed, each marked with the first tier of its commands."""
    for page in PAGES:
        tiers = {tier_of(command, page) for command in console(page)}
        for tier in [one for one in TIERS if one in tiers][:1]:
            marks = [] if tier == "everyday" else [getattr(pytest.mark, tier)]
            yield pytest.param(page, id=page.stem, marks=marks)


@pytest.mark.parametrize("page", [*pages_with_commands()])
def test_the_commands_of_a_page_do_what_it_shows(
    page: Path, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    """Those of the tier that runs and of all before."""
    have_what_the_page_takes_for_granted(page, tmp_path)
    tiers = TIERS[: TIERS.index(request.config.getoption("tier")) + 1]
    typed = [command for command in console(page) if tier_of(command, page) in tiers]
    done = subprocess.run(
        ["bash", "-euo", "pipefail", "-c", "\n".join(command.text for command in typed)],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        check=False,
    )
    assert done.returncode == 0, f"{done.stdout}{done.stderr}"
    for block in shown(page):
        # What takes a night is measured: the pages say when it was, and on which machine.
        if all(one in typed and not NIGHTLY.match(one.text) for one in block.commands):
            said = OTHER_ENGINES.sub("", done.stdout)
            assert not differences(block.lines, said.splitlines()), done.stdout
    if {tier_of(one, page) for one in console(page)} - {None} <= set(tiers):
        pictures_made(page, tmp_path)


def have_what_the_page_takes_for_granted(page: Path, directory: Path) -> None:
    """Make a source tree, and what another page or the reader has made."""
    studies = Path("config", "studies")
    shutil.copytree(SOURCE_TREE / studies, directory / studies)  # a page writes one there
    for path in (*SOURCE_TREE.glob("config/*"), SOURCE_TREE / "examples", SOURCE_TREE / "test"):
        if path != SOURCE_TREE / studies:
            (directory / path.relative_to(SOURCE_TREE)).symlink_to(path)
    (directory / ".venv").symlink_to(sys.prefix)
    if any("demo_output" in command.text for command in console(page)):
        demo = directory / "demo_output" / "demo_1"
        demo.mkdir(parents=True)
        # A bag of this state of the code: to replay another one may say that plans have changed.
        capture = SOURCE_TREE / "config" / "scenarios" / "lemur_capture.yaml"
        assert main(["plan", str(capture), "--bag", str(demo / "ff_planner_1")]) == 0
    for name, content in files_of(page):
        (directory / name).write_text(content, encoding="utf-8")
    method = re.search(r"```python\n(import yaml\n+def answer.*?)```", text_of(page), re.DOTALL)
    if method:
        (directory / "my_method.py").write_text(method[1], encoding="utf-8")


def files_of(page: Path) -> Iterator[tuple[str, str]]:
    """Yield the files that the reader of a page writes: blocks that begin with their name."""
    block = r"^```\w+\n((?:# |<!-- )([\w.]+\.\w+)(?: -->)?\n.*?)^```$"
    for content, name in re.findall(block, text_of(page), re.DOTALL | re.MULTILINE):
        yield name, content


def pictures_made(page: Path, directory: Path) -> None:
    """Look for the pictures of a tutorial, `DIR_NAME.png`, where its commands draw `DIR/NAME.png`.

    With PICTURES=1 they are put into docs/pictures. Of a page, `DIR/NAME.html`, a browser takes
    them.
    """
    if page.parent.name == "tutorials":
        for name in re.findall(r"\]\(\.\./pictures/(\w+\.png)\)", text_of(page)):
            drawn = {f"{one.parent.name}_{one.name}": one for one in directory.glob("*/*.png")}
            pages = {f"{one.parent.name}_{one.stem}.png" for one in directory.glob("*/*.html")}
            assert name in drawn.keys() | pages, f"no command draws {name}: {sorted(drawn)}"
            if os.environ.get("PICTURES") and name in drawn:
                shutil.copy(drawn[name], SOURCE_TREE / "docs" / "pictures" / name)


def test_a_command_that_is_not_typed_has_one_reason_and_each_reason_a_command() -> None:
    commands = [command for page in PAGES for command in console(page)]
    for command in commands:
        reasons = [reason for reason in NOT_TYPED if re.match(reason, command.text)]
        assert len(reasons) <= 1, command.text
    for pattern in (*NOT_TYPED, CI, NIGHTLY):
        assert any(re.match(pattern, command.text) for command in commands), pattern
    assert {page.stem for page in PAGES} >= AT_NIGHT
    for page in REPEATED:
        (commands,) = (console(one) for one in PAGES if one.stem == page)
        assert any(re.match(REPEATED[page], command.text) for command in commands), page


def test_the_files_that_commands_which_are_not_typed_name_are_there() -> None:
    for command in (one for page in PAGES for one in console(page) if not tier_of(one, page)):
        for word in command.words[1:]:
            if re.search(r"/\w+\.(yaml|json|urdf|xml|py)$", word):
                assert (SOURCE_TREE / word).is_file(), command.text


TABLE = [
    "Plans",
    "method  joint path [rad]  time [s]  error    steps",
    "a 1               1.1072     0.032  5.0e-08     14",
    "min(Theta)        4.0000     0.032  5.0e-08     14",
    "",
    "found at t = 2.65 s in 20 attempts",
]


@pytest.mark.parametrize(
    ("line", "old", "new"),
    [
        (2, "1.1072", "1.1074"),  # rounding
        (2, "0.032", "9.999"),  # a time
        (2, "5.0e-08", "9.0e-09"),  # a rounding error
        (2, "  14", "  15"),
        (3, "4.0000", "3.8001"),  # another optimum
        (5, "2.65", "2.67"),
    ],
)
def test_a_number_may_differ_by_rounding_and_a_time_may_differ(
    line: int, old: str, new: str
) -> None:
    printed = ["before", *TABLE, "after"]
    printed[1 + line] = printed[1 + line].replace(old, new)
    assert printed[1 + line] != TABLE[line]
    assert not differences(TABLE, printed)


@pytest.mark.parametrize(
    ("line", "old", "new"),
    [
        (0, "Plans", "Paths"),
        (1, "[rad]", "[deg]"),
        (2, "a 1", "a 2"),
        (2, "1.1072", "1.1075"),
        (2, "5.0e-08", "5.0e-06"),
        (2, "  14", "  17"),
        (2, "     14", ""),
        (3, "4.0000", "3.7999"),
        (5, "2.65", "2.68"),
        (5, "20", "21"),
    ],
)
def test_another_word_or_number_is_a_difference(line: int, old: str, new: str) -> None:
    printed = ["before", *TABLE, "after"]
    printed[1 + line] = printed[1 + line].replace(old, new)
    assert differences(TABLE, printed) == [(TABLE[line], printed[1 + line])]
    assert differences(TABLE, printed[2:])
    assert differences(TABLE, []) == [(line, "") for line in TABLE]
