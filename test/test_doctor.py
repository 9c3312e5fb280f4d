"""`ff-planner doctor`: says what is there, what is missing, and whether it plans."""

from __future__ import annotations

import importlib.metadata
import json
import shutil
from pathlib import Path
from unittest.mock import patch

import pytest
import rclpy
from doc_figures import ours
from pages import README, text_of
from rclpy.executors import SingleThreadedExecutor
from ros_processes import private_domain
from standin_controller import NAME, StandInController
from test_without_ros import ff_planner

from ff_planner_ros.cli import main
from ff_planner_ros.commands import doctor
from ff_planner_ros.core import compiled
from ff_planner_ros.ros.process import spin_in_background


def test_a_whole_installation_plans_and_both_forms_say_the_same(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", "42")
    file = tmp_path / "doctor.json"
    assert main(["doctor", "--json", str(file)]) == 0
    screen, facts = capsys.readouterr().out, json.loads(file.read_text())
    assert facts["version"] == importlib.metadata.version("ff_planner_ros")
    assert facts["dependencies"]["numpy"] == importlib.metadata.version("numpy")
    declared = importlib.metadata.metadata("ff_planner_ros").get_all("Provides-Extra")
    assert set(facts["extras"]) == set(declared or ())
    assert facts["ros"]["ROS_DOMAIN_ID"] == "42"
    assert facts["plan"]["joint_path_length"] == pytest.approx(1.1072, abs=1e-4)
    for told in (facts["version"], facts["ros"]["RMW"], "1.1072 rad in ", "42", facts["core"]):
        assert told in screen


def test_it_says_which_settings_of_a_running_controller_keep_plans(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    settings = {"speed_scaling.initial_scaling_factor": 0.95, "interpolation_method": "splines"}
    file = tmp_path / "doctor.json"
    with private_domain():
        rclpy.init(args=[])
        controller = StandInController(["joint_1"], namespace="/arm", **settings)
        executor = SingleThreadedExecutor()
        executor.add_node(controller.node)
        stop = spin_in_background(executor, controller.node.get_logger())
        try:
            asked = ["--controller", NAME, "--json", str(file)]
            assert main(["doctor", *asked, "--ros-args", "-r", "__ns:=/arm"]) == 0
        finally:
            stop()
            controller.close()
            rclpy.shutdown()
    screen, told = capsys.readouterr().out, json.loads(file.read_text())["controller"]
    assert {name: one["keeps"] for name, one in told.items()} == {
        "speed_scaling.initial_scaling_factor": False,
        "interpolation_method": True,
    }
    assert "0.95, should be 1.0: with another factor the plan runs at another pace" in screen


def test_a_controller_that_does_not_run_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    with private_domain(), patch.object(doctor, "_PATIENCE", 0.1):
        assert main(["doctor", "--controller", "nobody"]) == 2
    assert "nobody/list_parameters: no node offers it" in capsys.readouterr().err


def test_it_compares_with_the_time_that_the_benchmark_has() -> None:
    assert float(ours("time [s]", "min(L)")) == doctor.REFERENCE
    assert doctor.REFERENCE_MACHINE in text_of(README)


def test_a_missing_extra_comes_with_the_command_that_brings_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    installed = importlib.metadata.version

    def version(name: str) -> str:
        if name in ("pyarrow", "ff_planner_msgs"):
            raise importlib.metadata.PackageNotFoundError(name)
        return installed(name)

    monkeypatch.setattr(importlib.metadata, "version", version)
    extras = doctor.findings()["extras"]
    assert extras["campaign"]["missing"] == ["pyarrow"]
    assert extras["campaign"]["command"] == "pip install '.[campaign]'"
    assert extras["ros"]["command"] == "pip install ./msg_defs '.[ros]'"
    assert extras["simulation"]["command"] is None


def test_without_ros_it_plans_and_says_that_there_is_none(tmp_path: Path) -> None:
    done = ff_planner("doctor", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "no module rclpy" in done.stdout


def test_a_core_that_is_missing_is_told_and_no_crash(tmp_path: Path) -> None:
    done = ff_planner("doctor", cwd=tmp_path, hidden={"ff_planner_ros.core.compiled"})
    assert done.returncode == 2
    assert not done.stderr
    assert "missing: `pip install .` in the sources builds it" in done.stdout
    assert "plan of the capture, min(L)    none: ModuleNotFoundError: " in done.stdout


def test_a_core_of_other_sources_than_those_beside_it_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert doctor.core() == "built of the sources beside it"
    here = Path(compiled.__file__).parent
    monkeypatch.setattr(compiled, "__file__", str(tmp_path / "compiled.so"))
    assert doctor.core() == "built, installed without its sources"
    for source in here.rglob("*.[ch]pp"):
        copy = tmp_path / source.relative_to(here)
        copy.parent.mkdir(exist_ok=True)
        shutil.copyfile(source, copy)  # which makes them newer
    assert doctor.core() == "built of the sources beside it"
    with (tmp_path / "kinematics" / "arm.hpp").open("a", encoding="utf-8") as header:
        header.write("// Changed.\n")
    assert doctor.core().startswith("built of other sources: ")
