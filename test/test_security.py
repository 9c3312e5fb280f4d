"""The SROS2 policy is that of the table, and security that cannot be had is refused in words."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest
import rclpy
from rclpy.context import Context
from ros_processes import private_domain
from security_policy import NODE, POLICY, REPLY, REQUEST, policy, profiles

from ff_planner_ros.errors import InvalidInput
from ff_planner_ros.ros.process import joining_ros, security_gap

DEMAND = {"ROS_SECURITY_ENABLE": "true", "ROS_SECURITY_STRATEGY": "Enforce"}


@pytest.mark.law("NODE-22")
def test_the_policy_is_made_from_the_table_of_interfaces() -> None:
    assert POLICY.read_text(encoding="utf-8") == policy(), "run tools/security_policy.py"


@pytest.mark.law("NODE-22")
def test_only_the_operator_sets_parameters_and_drives_the_lifecycle() -> None:
    of_operators = {"set_parameters", "set_parameters_atomically", "change_state", "split_bag"}
    may_ask = {
        enclave.get("path"): {
            service.text.rpartition("/")[2]
            for block in enclave.iter("services")
            if block.get(REQUEST) == "ALLOW"
            for service in block
            if service.text
        }
        for enclave in ElementTree.parse(POLICY).iter("enclave")
    }
    assert may_ask["/operator"] >= of_operators
    assert may_ask["/executive"] == {"describe", "plan_trajectory", "publish_plan"}
    for path, services in may_ask.items():
        assert path == "/operator" or not services & of_operators, path
    served = {rule.name.rpartition("/")[2] for rule in profiles()[NODE] if rule.what == REPLY}
    assert set().union(*may_ask.values()) <= served


@pytest.mark.parametrize("keystore", ["", "nowhere"])
def test_security_that_cannot_be_had_is_a_refusal_that_says_what_it_needs(
    keystore: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, value in (DEMAND | {"ROS_SECURITY_KEYSTORE": keystore}).items():
        monkeypatch.setenv(name, value)
    with pytest.raises(InvalidInput, match="ROS_SECURITY_ENABLE is true") as refused, joining_ros():
        rclpy.init(args=[], context=Context())
    for words in ("ROS_SECURITY_KEYSTORE", keystore or "not set", "docs/how_to/security.md"):
        assert words in str(refused.value)
    assert len(str(refused.value).splitlines()) == 1


def test_a_node_that_must_be_secure_and_cannot_ends_in_one_line(tmp_path: Path) -> None:
    """An enclave without keys: Fast DDS with security refuses it, and Fast DDS without, too."""
    (tmp_path / "enclaves" / "ff_planner").mkdir(parents=True)
    command = [sys.executable, "-m", "ff_planner_ros.ros.node"]
    with private_domain():
        done = subprocess.run(
            [*command, "--ros-args", "--enclave", "/ff_planner"],
            env=os.environ | DEMAND | {"ROS_SECURITY_KEYSTORE": str(tmp_path)},
            capture_output=True,
            text=True,
            cwd=tmp_path,
            check=False,
        )
    assert done.returncode == 2
    assert "Traceback" not in done.stderr
    (line,) = (one for one in done.stderr.splitlines() if one.startswith("planner_node: "))
    assert "security cannot be had" in line
    assert not (tmp_path / "bags").exists()


@pytest.mark.parametrize(
    ("enable", "strategy", "warns"),
    [("", "", False), ("true", "Enforce", False), ("true", "", True), ("true", "enforce", True)],
)
def test_security_that_may_silently_be_left_out_is_told(
    enable: str, strategy: str, warns: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROS_SECURITY_ENABLE", enable)
    monkeypatch.setenv("ROS_SECURITY_STRATEGY", strategy)
    assert bool(security_gap()) == warns
