"""Everything that must hold before a release, from the tree to what a stranger installs.

Sdists are made of the tree, wheels of the sdists, environments of the wheels: nothing of the tree
is on any path there. Run by `make release-check`; `--python` may name one interpreter or more.
"""

from __future__ import annotations

import argparse
import functools
import json
import os
import shutil
import subprocess
import sys
import time
import zipfile
from collections.abc import Callable, Sequence
from pathlib import Path
from xml.etree import ElementTree

TREE = Path(__file__).resolve().parents[1]
WORK = TREE / "build" / "release"
DIST = TREE / "dist"
UV = TREE / ".venv" / "bin" / "uv"
TOOLS = ("twine>=7,<8", "cyclonedx-bom>=7.5,<8", "catkin-pkg>=1,<2")
# Keys of rosdep and packages of Jazzy that our two package.xml may name.
KNOWN_KEYS = Path(__file__).with_name("rosdep_keys.txt")
# What may be in the package's wheel beside Python, and no test or file of the tree's tooling.
SUFFIXES = {"", ".py", ".pyi", ".typed", ".so", ".hpp", ".cpp", ".css", ".js", ".xml", ".yaml"}
SUFFIXES |= {".urdf", ".srdf", ".json", ".rviz", ".txt", ".md", ".sh"}
# The last Python for which ROS's wheels have compiled modules.
LAST_WITH_ROS = (3, 12)
NOT_SHIPPED = ("test/", "tools/", "docs/", ".ci/", "benchmark/", "msg_defs/", "build/")
# Licences of what the base package brings, as its distributions name them.
ALLOWED = {"0BSD", "Apache", "BSD", "BSL", "CC0", "ISC", "MIT", "MPL", "PSF", "Python-2.0", "Zlib"}
ALLOWED |= {"any-OSI"}  # apsw, which rosbags brings


def run(*command: str | Path, cwd: Path = TREE, **environment: str) -> str:
    """Run a command, and return what it printed; end the check where it fails."""
    leaking = ("PYTHON", "AMENT_", "CMAKE_", "COLCON_", "ROS_", "VIRTUAL_ENV")
    kept = {name: value for name, value in os.environ.items() if not name.startswith(leaking)}
    done = subprocess.run(
        [str(word) for word in command],
        cwd=cwd,
        env=kept | environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    if done.returncode:
        sys.exit(f"{' '.join(map(str, command))}\n{done.stdout}\nended with {done.returncode}")
    return done.stdout


def build(pythons: Sequence[str], extras: Sequence[str]) -> None:
    """Make an sdist of each distribution, and wheels of the sdists alone.

    Where `[ros]` is not tried there may be no ROS for an interpreter, nor messages.
    """
    shutil.rmtree(DIST, ignore_errors=True)
    shutil.rmtree(WORK, ignore_errors=True)
    WORK.mkdir(parents=True)
    for source in (TREE, TREE / "msg_defs", TREE / "benchmark"):
        run(UV, "build", "--quiet", "--sdist", "--out-dir", DIST, source)
    constraints = ("--build-constraints", TREE / "constraints.txt")
    for sdist in sorted(DIST.glob("*.tar.gz")):
        if "ff_planner_msgs" in sdist.name and "ros" not in extras:
            continue
        for python in pythons[:1] if "benchmark" in sdist.name else pythons:
            if "ff_planner_msgs" in sdist.name and version(python) > LAST_WITH_ROS:
                continue
            run(UV, "build", "--quiet", "--wheel", "--python", python, *constraints,
                "--out-dir", DIST, sdist, cwd=WORK)  # fmt: skip
    (DIST / ".gitignore").unlink(missing_ok=True)


def check_contents() -> None:
    """The wheels hold what they should, the sdists can be built, and twine takes all of them."""
    for wheel in DIST.glob("ff_planner_ros-*.whl"):
        names = zipfile.ZipFile(wheel).namelist()
        strange = [name for name in names if Path(name).suffix not in SUFFIXES]
        shipped = [name for name in names if name.startswith(NOT_SHIPPED)]
        assert not strange + shipped, f"{wheel.name} holds {(strange + shipped)[:5]}"
        for needed in ("NOTICE", "LICENSE", "package.xml", "compiled.pyi", "py.typed"):
            assert any(name.endswith(needed) for name in names), f"{wheel.name} lacks {needed}"
    tools = environment("tools", sys.executable, *TOOLS)
    files = sorted(map(str, DIST.glob("*.*")))
    run(tools / "twine", "check", *files)
    ours = [name for name in files if "ff_planner_ros" in name]
    run(tools / "twine", "check", "--strict", *ours)


def check_package_xml() -> None:
    """Both package.xml are valid by ROS's own rules, and name keys that rosdep knows."""
    code = "import sys; from catkin_pkg.package import parse_package; w = []; "
    code += "p = parse_package(sys.argv[1], warnings=w); p.validate(warnings=w); print(w)"
    for file in (TREE / "package.xml", TREE / "msg_defs" / "package.xml"):
        assert run(WORK / "tools" / "bin" / "python", "-c", code, file).strip() == "[]", file
        unknown = unknown_keys(file.read_text(encoding="utf-8"))
        assert not unknown, f"{file} names {unknown}, which {KNOWN_KEYS.name} does not have"


def unknown_keys(package_xml: str) -> list[str]:
    """Return what a package.xml depends on and neither rosdep nor Jazzy is known to have."""
    lines = KNOWN_KEYS.read_text(encoding="utf-8").splitlines()
    known = {line for line in lines if not line.startswith("#")} | {"ff_planner_msgs"}
    root = ElementTree.fromstring(package_xml)
    named = {str(element.text) for element in root if element.tag.endswith("depend")}
    return sorted(named - known)


def environment(name: str, python: str, *requirements: str) -> Path:
    """Make an environment, and return its directory of commands."""
    where = WORK / name
    if not where.is_dir():
        run(UV, "venv", "--quiet", "--python", python, where)
    if requirements:
        run(UV, "pip", "install", "--quiet", "--python", where / "bin" / "python",
            "--constraint", TREE / "constraints.txt", *requirements)  # fmt: skip
    return where / "bin"


def version(python: str) -> tuple[int, int]:
    """Return major and minor version of an interpreter."""
    major, minor = run(python, "-c", "import sys; print(*sys.version_info[:2])").split()
    return int(major), int(minor)


def wheel(name: str, python: str) -> str:
    """Return the wheel of a distribution that an interpreter takes."""
    tag = "cp{}{}".format(*version(python))
    found = [one for one in DIST.glob(f"{name}-*.whl") if tag in one.name or "-py3-" in one.name]
    assert found, f"no wheel of {name} for {tag}"
    return str(found[0])


def check_installed(python: str, extras: Sequence[str]) -> None:
    """What a stranger installs runs: the base package, then each extra."""
    name = f"env_{Path(python).name}"
    ours = wheel("ff_planner_ros", python)
    bin_ = environment(name, python, ours)
    empty = WORK / f"{name}_run"
    shutil.rmtree(empty, ignore_errors=True)
    empty.mkdir()
    path = {"PATH": f"{bin_}:/usr/bin:/bin"}
    code = "import ff_planner_ros, sys; from ff_planner_ros.common.share import share_directory; "
    code += "assert not ff_planner_ros.__file__.startswith(sys.argv[1]); print(share_directory())"
    share = Path(run(bin_ / "python", "-c", code, TREE / "ff_planner_ros", cwd=empty).strip())
    capture = share / "config" / "scenarios" / "lemur_capture.yaml"
    run(bin_ / "ff-planner", "--version", cwd=empty, **path)
    run(bin_ / "ff-planner", "plan", capture, "--json", "answer.json", cwd=empty)
    run(bin_ / "ff-planner", "report", "answer.json", cwd=empty)
    run(bin_ / "python", share / "examples" / "plan_in_python.py", cwd=empty)
    sbom(name, bin_)
    for extra in extras:
        if extra == "ros" and version(python) > LAST_WITH_ROS:
            print("    [ros] is not tried: ROS has no wheels for this Python", flush=True)
            continue
        messages = [wheel("ff_planner_msgs", python)] if extra == "ros" else []
        environment(name, python, *messages, f"{ours}[{extra}]")
        EXTRAS[extra](bin_, share, empty)
        print(f"    [{extra}] runs", flush=True)
    environment(name, python, wheel("ff_planner_benchmark", python))
    run(bin_ / "ff-planner-benchmark", "dataset", "data_set", "--scenarios", "1", cwd=empty)


def of_simulation(bin_: Path, _: Path, empty: Path) -> None:
    """A plan comes true in MuJoCo."""
    assert "verdict: passed" in run(bin_ / "ff-planner", "verify", "answer.json", cwd=empty)


def of_campaign(bin_: Path, share: Path, empty: Path) -> None:
    """A study of a few plans."""
    text = (share / "config" / "studies" / "lemur_masses.yaml").read_text(encoding="utf-8")
    for all_, few in (
        ("../scenarios", str(share / "config" / "scenarios")),
        ("[8.0, 10.0, 12.0]", "[10.0]"),
        ("count: 4", "count: 1"),
    ):
        text = text.replace(all_, few)
    (empty / "study.yaml").write_text(text, encoding="utf-8")
    run(bin_ / "ff-planner", "campaign", "study.yaml", "--out", "tables", cwd=empty)


def of_console(bin_: Path, _: Path, empty: Path) -> None:
    """The page can be made."""
    run(bin_ / "python", "-c", "import ff_planner_ros.console.serve, viser", cwd=empty)
    run(bin_ / "ff-planner", "console", "--help", cwd=empty)


def of_ros(bin_: Path, share: Path, empty: Path) -> None:
    """The node comes to the robot that it cannot find, and a plan in a bag is replayed."""
    code = "import subprocess, sys; done = subprocess.run(sys.argv[1:], capture_output=True, "
    code += "text=True); print(done.stdout + done.stderr)"
    node: list[str | Path] = [bin_ / "planner_node", "--ros-args", "-p", "robot.urdf:=none.urdf"]
    said = run(bin_ / "python", "-c", code, *node, cwd=empty)
    assert "robot.urdf is none.urdf" in said, said
    capture = share / "config" / "scenarios" / "lemur_capture.yaml"
    run(bin_ / "ff-planner", "plan", capture, "--bag", "bag", cwd=empty)
    run(bin_ / "ff-planner", "info", "bag", cwd=empty)
    assert "identical" in run(bin_ / "ff-planner", "replay", "bag", cwd=empty)


EXTRAS: dict[str, Callable[[Path, Path, Path], None]] = {
    "simulation": of_simulation,
    "campaign": of_campaign,
    "console": of_console,
    "ros": of_ros,
}


def sbom(name: str, bin_: Path) -> None:
    """Write the bill of materials of an environment, and look at its licences."""
    file = DIST / f"sbom_{name}.json"
    run(
        WORK / "tools" / "bin" / "cyclonedx-py",
        "environment",
        "--output-file",
        file,
        bin_ / "python",
    )
    unnamed = list[str]()
    for part in json.loads(file.read_text(encoding="utf-8"))["components"]:
        named = [
            str(one.get("expression") or one["license"].get("id") or one["license"].get("name"))
            for one in part.get("licenses", ())
        ]
        if named and not any(word in text for text in named for word in ALLOWED):
            sys.exit(f"{part['name']} {part['version']} has the licence {named}")
        if not named:
            unnamed.append(f"{part['name']} {part['version']}")
    print(f"    no licence is named by {', '.join(unnamed) or 'none'}: look at them by hand")


def check_colcon() -> None:
    """What a ROS machine does: build, test, and the tests' results."""
    run("make", "build")
    tests = ("test/test_package.py", "test/test_share.py", "test/test_launch.py")
    path = f"{TREE / '.venv' / 'bin'}:{os.environ['PATH']}"
    run("colcon", "test", "--pytest-args", "--no-cov", *tests, PATH=path)
    print(run("colcon", "test-result", "--all", "--test-result-base", "build", PATH=path))


def main() -> None:
    """Run every step, and say how long each took."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--python", action="append", help="interpreter; default: this one")
    parser.add_argument("--extras", default=",".join(EXTRAS))
    parser.add_argument("--skip", default="", help="steps that are left out")
    options = parser.parse_args()
    pythons = options.python or [sys.executable]
    extras = [one for one in options.extras.split(",") if one]
    steps: dict[str, Callable[[], None]] = {
        "build": lambda: build(pythons, extras),
        "contents": check_contents,
        "package.xml": check_package_xml,
    }
    for python in pythons:
        steps[python] = functools.partial(check_installed, python, extras)
    steps["colcon"] = check_colcon
    for name, step in steps.items():
        if name in options.skip.split(","):
            continue
        begun = time.monotonic()
        step()
        print(f"{name}: passed, {time.monotonic() - begun:.0f} s", flush=True)


if __name__ == "__main__":
    main()
