"""Put one fault after the other into the code, and see whether the tests notice.

    .venv/bin/python tools/faults.py [AREA ...] [--jobs N] [--today]

test/faults/AREA.yaml lists faults that a reviewer would call real: a text that occurs once in
a file of the package or the benchmark, what stands there instead, what goes wrong then, and the
tests that are to fail. Written by hand, not mutants by machine: of these most are no faults, or
change nothing.

The libraries take most of the time that a test of one fault takes: a server imports them once, and
each fault has a process that forks from it, with a copy of the project of its own. Of the core what
a fault has changed is compiled. All faults take hours: of a night's share (`--today`) every week
tries all of them once.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import pytest
import yaml

PROJECT = Path(__file__).resolve().parents[1]
HERE = PROJECT / "test" / "faults"
PACKAGE = "ff_planner_ros"
COPIED = {PACKAGE, "test", "tools", "benchmark"}
AREAS = sorted(path.stem for path in HERE.glob("*.yaml"))
# A fault that keeps its tests busy for so long [s] is noticed: they take seconds without it.
PATIENCE = 1200
# Of the faults so many are to be noticed, and each of the others gives its reason.
SHARE = 0.9
TIER = "nightly"  # the others run a part of the cases of a sampled test
# In a copy of the project, what its tests said.
SAID = "said.txt"
# Slow to import, and nothing of this project; those that are not installed are left out.
LIBRARIES = (
    *("numpy", "scipy.integrate", "scipy.interpolate", "scipy.linalg", "scipy.optimize"),
    *("scipy.spatial.transform", "pinocchio", "coal", "mujoco", "pytest", "yaml", "rclpy.node"),
)


@dataclass(frozen=True)
class Fault:
    """A fault, put into one place."""

    area: str
    file: str  # in the package
    old: str  # occurs once
    new: str
    wrong: str  # what goes wrong
    tests: str  # files or names of tests, apart by blanks
    survives: str = ""  # why no test can or need notice it

    def put_into(self, tree: Path) -> None:
        """Change the file.

        Raises:
            ValueError: The text does not occur exactly once.
        """
        path = tree / PACKAGE / self.file
        text = path.read_text(encoding="utf-8")
        if text.count(self.old) != 1:
            raise ValueError(f"{self.area}: {self.file} has {text.count(self.old)} x {self.old!r}")
        path.write_text(text.replace(self.old, self.new), encoding="utf-8")
        if self.is_of_core:
            build_core(tree)

    @property
    def is_of_core(self) -> bool:
        """Whether the core is built anew with it."""
        return self.file.endswith((".hpp", ".cpp"))


def main() -> int:
    """Try all faults; exit code 1: too few were noticed, or one survives without a reason."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("areas", nargs="*", default=AREAS, metavar="AREA")
    parser.add_argument("--jobs", type=int, default=os.cpu_count())
    parser.add_argument("--today", action="store_true", help="a seventh, by the day of the week")
    options = parser.parse_args()
    faults = [fault for area in options.areas for fault in faults_of(area)]
    if options.today:
        faults = faults[datetime.now(UTC).weekday() :: 7]
    tests = sorted({test for fault in faults for test in fault.tests.split()})
    multiprocessing.set_start_method("forkserver")
    multiprocessing.set_forkserver_preload([*LIBRARIES])
    with copy_of(PROJECT) as sound, ThreadPoolExecutor(options.jobs) as pool:
        said = _failure(sound, tests, f"--numprocesses={options.jobs}")
        if said is not None:
            print(f"without any fault tests fail:\n{said}")
            return 1
        if any(fault.is_of_core for fault in faults):
            build_core(sound)  # so that each copy has all objects
        noticed = pool.map(lambda fault: _is_noticed(fault, sound), faults)
        survivors = [fault for fault, seen in zip(faults, noticed, strict=True) if not seen]
    share = 1.0 - len(survivors) / len(faults)
    print(f"{len(faults) - len(survivors)} of {len(faults)} faults were noticed ({share:.0%})")
    for fault in survivors:
        print(f"{_title(fault)}: {fault.survives or 'SURVIVES WITHOUT A REASON'}")
    return int(share < SHARE or any(not fault.survives for fault in survivors))


def faults_of(area: str) -> list[Fault]:
    """Return the faults of a list."""
    rows = yaml.safe_load((HERE / f"{area}.yaml").read_text(encoding="utf-8"))
    return [Fault(area, **row) for row in rows]


def _title(fault: Fault) -> str:
    return f"{fault.area}: {fault.file}: {fault.wrong}"


def _is_noticed(fault: Fault, sound: Path) -> bool:
    """Try a fault, and say how it went."""
    with copy_of(sound) as tree:
        fault.put_into(tree)
        said = _failure(tree, fault.tests.split(), "--exitfirst")
    if said is None:
        print(f"SURVIVES {_title(fault)}", flush=True)
        return False
    by = next((line for line in said.splitlines() if line.startswith(("FAILED", "ERROR"))), said)
    print(f"noticed  {_title(fault)} | {by.strip()[-150:]}", flush=True)
    return True


def build_core(tree: Path) -> None:
    """Build the core of a tree, of the objects that it has."""
    for built in (tree / PACKAGE / "core").glob("*.so"):
        built.unlink()
    command = [sys.executable, "setup.py", "--quiet", "build_ext", "--inplace"]
    subprocess.run(command, cwd=tree, check=True, capture_output=True)


@contextmanager
def copy_of(project: Path) -> Iterator[Path]:
    """Yield a project of its own, whose package may be changed."""
    with tempfile.TemporaryDirectory() as directory:
        tree = Path(directory)
        for path in project.iterdir():
            if path.name in COPIED:  # a link to the tests would lead back to the package
                shutil.copytree(path, tree / path.name)
            elif path.name == "build":
                for objects in path.glob("temp.*"):
                    shutil.copytree(objects, tree / "build" / objects.name, copy_function=_linked)
            elif path.name not in {".git", SAID}:
                (tree / path.name).symlink_to(path)
        yield tree


def _linked(source: str, target: str) -> None:
    """Link what a build replaces but never writes to, 340 MB; copy the rest, and between disks."""
    if source.endswith((".o", ".gch")):
        with suppress(OSError):
            os.link(source, target)
            return
    shutil.copy2(source, target)


def _failure(tree: Path, tests: Sequence[str], *options: str) -> str | None:
    """Run tests of the tree; return what they say where one fails."""
    whole = ["-q", "-p", "no:cacheprovider", f"--tier={TIER}"]
    arguments = [*whole, *options, *(f"test/{test}" for test in tests)]
    process = multiprocessing.Process(target=_run, args=(tree, arguments))
    process.start()
    process.join(PATIENCE)
    ended = process.exitcode is not None
    assert process.pid is not None
    with suppress(ProcessLookupError):  # what did not end, or was left running by its tests
        os.killpg(process.pid, signal.SIGKILL)
    process.join()
    if process.exitcode in {pytest.ExitCode.OK, pytest.ExitCode.NO_TESTS_COLLECTED}:
        return None
    said = (tree / SAID).read_text(encoding="utf-8", errors="replace")
    return said if ended else f"{said}\nno end"


def _run(tree: Path, arguments: Sequence[str]) -> None:
    """Run pytest on a tree, in a process of its own that has imported nothing of the project."""
    os.setsid()  # so that it is ended together with the nodes that its tests start
    said = os.open(tree / "said.txt", os.O_WRONLY | os.O_CREAT)
    for stream in (1, 2):
        os.dup2(said, stream)
    os.chdir(tree)
    own = [str(tree), str(tree / "benchmark")]
    os.environ["PYTHONPATH"] = os.pathsep.join(own)
    sys.path[:1] = own  # instead of this file's directory
    # Not one of several that work together, whose progress bars would be in each other's way.
    vars(multiprocessing.process)["_parent_process"] = None
    code = pytest.main([*arguments])
    sys.stdout.flush()
    os._exit(code)  # whatever the fault has left running


if __name__ == "__main__":
    sys.exit(main())
