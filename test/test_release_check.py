"""What `make release-check` looks at, as far as it needs no build."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from release_check import unknown_keys

SOURCE_TREE = Path(__file__).resolve().parents[1]
SAMPLE = SOURCE_TREE / "tools" / "aarch64" / "sample.py"


@pytest.mark.parametrize("file", ["package.xml", "msg_defs/package.xml"])
def test_package_xml_names_keys_that_rosdep_knows(file: str) -> None:
    text = (SOURCE_TREE / file).read_text(encoding="utf-8")
    assert unknown_keys(text) == []
    changed = text.replace("<depend>", "<exec_depend>").replace("</depend>", "</exec_depend>")
    changed = changed.replace(">action_msgs<", ">python3-rosbags<")
    assert unknown_keys(changed) == ["python3-rosbags"]


def test_nothing_in_the_core_depends_on_the_processor_that_builds_it() -> None:
    """All instructions of x86-64, and no sum that is fused on some and not on others."""
    setup = (SOURCE_TREE / "setup.py").read_text(encoding="utf-8")
    assert "-ffp-contract=off" in setup
    assert "-march" not in setup
    assert "-mtune" not in setup
    assert "-ffast-math" not in setup


@pytest.mark.parametrize(("apart", "kept"), [(0.0, True), (1e-7, True), (2e-6, False)])
def test_numbers_of_another_machine_are_compared_with_what_is_promised(
    tmp_path: Path, apart: float, kept: bool
) -> None:
    ours = {"plan x": np.linspace(0.0, 0.9, 12).reshape(6, 2), "digest x": np.arange(3.0)}
    theirs = ours | {"plan x": ours["plan x"] + apart * np.eye(6, 2)}
    for name, numbers in (("ours", ours), ("theirs", theirs)):
        np.savez(tmp_path / f"{name}.npz", **numbers)
    files = [str(tmp_path / f"{name}.npz") for name in ("ours", "theirs")]
    done = subprocess.run([sys.executable, SAMPLE, "compare", *files], capture_output=True)
    assert (done.returncode == 0) is kept, done.stdout
