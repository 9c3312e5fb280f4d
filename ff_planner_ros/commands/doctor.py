"""The command `doctor`: the facts on a machine for a report of a defect, on one screen."""

from __future__ import annotations

import json
import os
import re
import time
from argparse import Namespace
from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from ff_planner_ros.commands import BAD_INPUT, SOLVED
from ff_planner_ros.commands.options import Add, add_output, require_file
from ff_planner_ros.commands.printed import print_table
from ff_planner_ros.common.share import PACKAGE, share_directory

# Processor time of the second plan of a process [s], and where it was measured (README.md).
REFERENCE, REFERENCE_MACHINE = 0.015, "one core of an AMD EPYC"
_PATIENCE = 10.0  # for a controller [s]
MESSAGES = "ff_planner_msgs"  # no package of an index: they come from the sources
_REQUIREMENT = re.compile(r"(?P<name>[\w.-]+)[^;]*(;.*extra == [\"'](?P<extra>[\w-]+)[\"'])?")
# Read by ROS when it starts, and what it takes where they are not set.
_ROS_VARIABLES = {
    "ROS_DOMAIN_ID": "0",
    "ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET",
    "ROS_STATIC_PEERS": "none",
}


def add_doctor(add: Add) -> None:
    """Add `doctor`."""
    doctor = add(
        "doctor",
        examine,
        "say what is installed, what is missing, and how fast it plans",
        description="One screen for a report of a defect: versions, extras and the commands that "
        "bring them, the core, ROS, and one timed plan.",
        epilog="Exit code: 0 a plan can be made, 2 none can. What follows --ros-args goes to ROS.",
    )
    controller_help = (
        "also say which parameters of this joint_trajectory_controller, which runs, keep the times "
        "of plans"
    )
    doctor.add_argument("--controller", metavar="NODE", help=controller_help)
    add_output(doctor, "--json", "FILE", "write it all", require_file)


def examine(options: Namespace) -> int:
    """Print what is installed and whether it plans, and write it as JSON if asked."""
    facts = findings()
    if options.controller is not None:
        facts["controller"] = _controller(options.controller, options.rest)
    print_table(list(_rows(facts)))
    if options.json is not None:
        options.json.write_text(json.dumps(facts, indent=2) + "\n", encoding="utf-8")
    return SOLVED if facts["plan"]["solved"] else BAD_INPUT


def findings() -> dict[str, Any]:
    """Return what is installed, what is missing, and how a plan went; for JSON."""
    import platform

    requirements = _requirements()
    return {
        "version": _version(PACKAGE),
        "python": platform.python_version(),
        "platform": platform.platform(),
        "cores": len(os.sched_getaffinity(0)),
        "dependencies": requirements.pop("", {}),
        "extras": {extra: _extra(extra, names) for extra, names in requirements.items()},
        "core": core(),
        "ros": _ros(),
        "plan": _plan(),
    }


def core() -> str:
    """Return in words whether the C++ core is built, and from the sources beside it."""
    import hashlib

    try:
        from ff_planner_ros.core import compiled
    except ImportError:
        return "missing: `pip install .` in the sources builds it"
    # As setup.py takes their digest.
    sources = sorted(Path(compiled.__file__).parent.rglob("*.[ch]pp"))
    digest = hashlib.sha256(b"".join(path.read_bytes() for path in sources)).hexdigest()
    if not sources:
        return "built, installed without its sources"
    if digest != compiled.SOURCES_DIGEST:
        return "built of other sources: `python setup.py build_ext --inplace` builds it anew"
    return "built of the sources beside it"


def _requirements() -> dict[str, dict[str, str | None]]:
    """Return versions by extra and name, as far as they are installed; extra "": always needed."""
    import importlib.metadata

    found: dict[str, dict[str, str | None]] = {}
    try:
        declared = importlib.metadata.requires(PACKAGE) or []
    except importlib.metadata.PackageNotFoundError:  # run from its sources
        declared = []
    for line in declared:
        if parts := _REQUIREMENT.match(line):
            found.setdefault(parts["extra"] or "", {})[parts["name"]] = _version(parts["name"])
    return found


def _version(distribution: str) -> str | None:
    import importlib.metadata

    try:
        return importlib.metadata.version(distribution)
    except importlib.metadata.PackageNotFoundError:
        return None


def _extra(extra: str, versions: dict[str, str | None]) -> dict[str, Any]:
    """Return what is missing of an extra, and the command that brings it."""
    missing = [name for name, version in versions.items() if version is None]
    messages = "./msg_defs " if MESSAGES in missing else ""
    command = f"pip install {messages}'.[{extra}]'" if missing else None
    return {"versions": versions, "missing": missing, "command": command}


def _ros() -> dict[str, str]:
    """Return the ROS middleware and the settings of discovery; empty without ROS."""
    if find_spec("rclpy") is None:
        return {}
    try:
        from rclpy.utilities import get_rmw_implementation_identifier

        middleware = str(get_rmw_implementation_identifier())
    except Exception as error:  # whatever is wrong with an installation is what is asked for
        middleware = f"cannot be loaded: {type(error).__name__}: {error}"
    told = {
        name: os.environ.get(name) or f"{usual} (default)" for name, usual in _ROS_VARIABLES.items()
    }
    return {"messages": "found" if find_spec(MESSAGES) else "missing", "RMW": middleware, **told}


def _controller(name: str, ros_arguments: list[str]) -> dict[str, dict[str, Any]]:
    """Return what a running controller has of each setting that matters, and why it does."""
    from rcl_interfaces.srv import ListParameters

    from ff_planner_ros.parameters.controller import KEEPS_PLANS
    from ff_planner_ros.ros.client import PlannerClient

    with closing(PlannerClient(f"ff_planner_doctor_{os.getpid()}", ros_arguments)) as client:
        asked = ListParameters.Request()
        listed = client.call(ListParameters, f"{name}/list_parameters", asked, _PATIENCE)
        # Of an unknown one a controller tells none at all; older ones have fewer.
        known = [one for one in KEEPS_PLANS if one.name in listed.result.names]
        told = client.parameters(name, [one.name for one in known], _PATIENCE)
    return {
        one.name: {
            "value": told[one.name],
            "keeps": told[one.name] == one.value,
            "needed": one.value,
            "why": one.why,
        }
        for one in known
    }


def _plan() -> dict[str, Any]:
    """Plan the paper's capture twice, and time the second: the first loads what it needs."""
    try:
        from ff_planner_ros.parameters import load_parameters
        from ff_planner_ros.planning.problem.problem import Objective
        from ff_planner_ros.planning.scenario.scenario import Defaults, load_task
        from ff_planner_ros.planning.task.task import perform

        scenario = share_directory() / "config" / "scenarios" / "lemur_capture.yaml"
        task = load_task(scenario, Defaults(load_parameters().planner))
        task = replace(task, problem=replace(task.problem, objective=Objective(1.0, 0.0)))
        perform(task)
        begun, begun_on_processor = time.perf_counter(), time.process_time()
        length = perform(task).metrics.joint_path_length
    except Exception as error:  # whatever keeps it from planning is what is asked for
        return {"solved": False, "message": f"{type(error).__name__}: {error}"}
    return {
        "solved": True,
        "joint_path_length": length,
        "seconds": time.perf_counter() - begun,
        "processor_seconds": time.process_time() - begun_on_processor,
        "reference_processor_seconds": REFERENCE,
        "reference_machine": REFERENCE_MACHINE,
    }


def _rows(facts: dict[str, Any]) -> Iterator[tuple[str, str]]:
    yield PACKAGE, facts["version"] or "not installed, run from its sources"
    yield "Python", f"{facts['python']}, {facts['platform']}"
    yield "cores", str(facts["cores"])
    yield "core in C++", facts["core"]
    for name, version in facts["dependencies"].items():
        yield name, version or "not known to pip"
    for extra, one in facts["extras"].items():
        missing = f"missing {', '.join(one['missing'])}: {one['command']}"
        versions = ", ".join(f"{name} {version}" for name, version in one["versions"].items())
        yield f"extra {extra}", missing if one["missing"] else versions
    if not facts["ros"]:
        yield "ROS", "no module rclpy: install the extra ros, or source a ROS workspace"
    for name, value in facts["ros"].items():
        yield {"messages": MESSAGES, "RMW": "ROS middleware"}.get(name, name), value
    for name, one in facts.get("controller", {}).items():
        wrong = f"should be {one['needed']!r}: {one['why']}"
        yield name, f"{one['value']!r}{'' if one['keeps'] else f', {wrong}'}"
    plan = facts["plan"]
    if plan["solved"]:
        took = f"{plan['seconds']:.2f} s, {plan['processor_seconds']:.2f} s of a processor"
        reference = f"{REFERENCE:g} s on {REFERENCE_MACHINE}"
        length = f"{plan['joint_path_length']:.4f} rad"
        yield "plan of the capture, min(L)", f"{length} in {took} (reference: {reference})"
    else:
        yield "plan of the capture, min(L)", f"none: {plan['message']}"
