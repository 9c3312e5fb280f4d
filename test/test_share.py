"""Where the files of ROS packages lie."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import ff_planner_ros
from ff_planner_ros.common.share import resolve_uri, share_directory
from ff_planner_ros.errors import InvalidInput, Status

SOURCE_TREE = Path(__file__).resolve().parents[1]


@pytest.fixture
def workspace(tmp_path, monkeypatch):
    """A sourced workspace, second in the path, with a package `other_arm` that has one file."""
    prefix = tmp_path / "install" / "other_arm"
    marker = prefix / "share/ament_index/resource_index/packages/other_arm"
    urdf = prefix / "share/other_arm/urdf/arm.urdf"
    for file in (marker, urdf):
        file.parent.mkdir(parents=True)
        file.touch()
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"{tmp_path}/install/empty:{prefix}")
    return prefix


def test_run_from_the_source_tree_the_share_directory_is_the_source_tree():
    assert share_directory() == SOURCE_TREE
    assert (share_directory() / "config" / "planner.yaml").is_file()


def copied_package(directory):
    """A copy of the package alone, as an installation has it: no package.xml beside it."""
    library = directory / "lib"
    library.mkdir()
    package = Path(ff_planner_ros.__file__).parent
    shutil.copytree(package / "common", library / "ff_planner_ros" / "common")
    for name in ("__init__.py", "errors.py"):
        shutil.copy(package / name, library / "ff_planner_ros")
    return library


def share_directory_seen_by(library, prefix):
    """Ask a Python without site packages, hence without ROS, for the share directory."""
    program = (
        f"import sys; sys.path.insert(0, {str(library)!r}); sys.prefix = {str(prefix)!r}\n"
        "from ff_planner_ros.common.share import share_directory; print(share_directory())"
    )
    return subprocess.run(
        [sys.executable, "-I", "-S", "-c", program], capture_output=True, text=True, env={}
    )


def test_an_installed_package_finds_its_share_directory_without_ros(tmp_path):
    library = copied_package(tmp_path)
    marker = tmp_path / "share/ament_index/resource_index/packages/ff_planner_ros"
    marker.parent.mkdir(parents=True)
    marker.touch()
    answer = share_directory_seen_by(library, tmp_path)
    assert answer.stdout.strip() == str(tmp_path / "share/ff_planner_ros"), answer.stderr


def test_a_package_copied_without_its_configuration_says_where_it_looked(tmp_path):
    answer = share_directory_seen_by(copied_package(tmp_path), tmp_path)
    assert answer.returncode != 0
    assert (
        f"FfPlannerError: the configuration of ff_planner_ros is not installed: no share/"
        f"ff_planner_ros below {tmp_path}" in answer.stderr
    )


def test_our_own_robot_resolves_without_any_workspace(monkeypatch, tmp_path):
    monkeypatch.delenv("AMENT_PREFIX_PATH", raising=False)
    path = resolve_uri("package://ff_planner_ros/config/planner.yaml", relative_to=tmp_path)
    assert path == SOURCE_TREE / "config" / "planner.yaml"


def test_a_package_of_a_sourced_workspace_resolves(workspace, tmp_path):
    path = resolve_uri("package://other_arm/urdf/arm.urdf", relative_to=tmp_path)
    assert path == workspace / "share/other_arm/urdf/arm.urdf"


def test_a_package_of_the_environment_resolves(monkeypatch, tmp_path, workspace):
    monkeypatch.delenv("AMENT_PREFIX_PATH")
    monkeypatch.setattr(sys, "prefix", str(workspace))
    path = resolve_uri("package://other_arm/urdf/arm.urdf", relative_to=tmp_path)
    assert path == workspace / "share/other_arm/urdf/arm.urdf"


@pytest.mark.parametrize("uri", ["arm.urdf", "./arm.urdf", "../here/arm.urdf"])
def test_a_relative_path_starts_at_the_given_directory(uri, tmp_path):
    directory = tmp_path / "here"
    directory.mkdir()
    (directory / "arm.urdf").touch()
    assert resolve_uri(uri, relative_to=directory) == directory / "arm.urdf"


def test_an_absolute_path_stays_as_it_is(tmp_path):
    (tmp_path / "arm.urdf").touch()
    assert resolve_uri(f"{tmp_path}/arm.urdf", relative_to=Path("/")) == tmp_path / "arm.urdf"


def test_a_relative_directory_gives_an_absolute_path(monkeypatch, tmp_path):
    (tmp_path / "arm.urdf").touch()
    monkeypatch.chdir(tmp_path)
    assert resolve_uri("arm.urdf", relative_to=Path()) == tmp_path / "arm.urdf"


def test_a_tilde_is_the_home_directory(monkeypatch, tmp_path):
    monkeypatch.setenv("HOME", str(tmp_path))
    (tmp_path / "arm.urdf").touch()
    assert resolve_uri("~/arm.urdf", relative_to=Path("/")) == tmp_path / "arm.urdf"


@pytest.mark.parametrize(
    ("uri", "reason"),
    [
        ("nowhere.urdf", "there is no file {directory}/nowhere.urdf"),
        (".", "there is no file {directory}"),
        ("package://no_such_arm/a.urdf", "there is no package no_such_arm below "),
        ("package://ff_planner_ros/a.urdf", "there is no file {source}/a.urdf"),
        ("package://ff_planner_ros", "it must read package://PACKAGE/PATH"),
        ("package:///a.urdf", "it must read package://PACKAGE/PATH"),
        ("~no_such_user/a.urdf", "it is no path: "),
        ("a\0.urdf", "it is no path: "),
    ],
)
def test_a_uri_that_leads_nowhere_is_refused_by_name(uri, reason, tmp_path):
    with pytest.raises(InvalidInput) as refusal:
        resolve_uri(uri, relative_to=tmp_path)
    assert refusal.value.status is Status.BAD_ROBOT
    expected = reason.format(directory=tmp_path, source=SOURCE_TREE)
    assert str(refusal.value).startswith(f"robot.urdf is {uri}: {expected}")
