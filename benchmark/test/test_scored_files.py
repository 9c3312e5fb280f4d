"""Files of a scenario that do harm are refused before they are read, in words."""

import os
import re
import shutil

import pytest

from ff_planner_benchmark import dataset
from ff_planner_benchmark.cli import main
from ff_planner_benchmark.scorer.score import judged, load


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """One scenario of each class of the public seeds."""
    directory = tmp_path_factory.mktemp("scored") / "new"
    dataset.write_dataset(directory, dataset.SEEDS["public"], 1)
    return directory


@pytest.fixture
def scenario(small, tmp_path):
    """A scenario in a data set that a test may change."""
    shutil.copytree(small, tmp_path / "set")
    return tmp_path / "set" / "scenarios" / "planar" / "0000.yaml"


def pipe(file):
    file.unlink()
    os.mkfifo(file)


def device(file):
    file.unlink()
    file.symlink_to("/dev/zero")


def hole(file):
    with file.open("wb") as stream:
        stream.truncate(10**10)


def changed(old, new):
    def change(file):
        text = file.read_text()
        assert re.search(old, text), text
        file.write_text(re.sub(old, new, text, count=1))

    return change


ENTITIES = [f'<!ENTITY {b} "{10 * f"&{a};"}">' for a, b in zip("abcdefgh", "bcdefghi", strict=True)]
BOMB = f'<!DOCTYPE a [<!ENTITY a "aaaaaaaaaa">{"".join(ENTITIES)}]>'
ALIASES = "a: &a [1, 1]\nb: &b [*a, *a]\nc: &c [*b, *b]\n"
OF_SCENARIO = {
    "a pipe": pipe,
    "a device": device,
    "ten gigabytes": hole,
    "deep lists": lambda file: file.write_text("[" * 100_000),
    "aliases": lambda file: file.write_text(ALIASES + file.read_text()),
    "no mapping": lambda file: file.write_text("3"),
    "no UTF-8": lambda file: file.write_bytes(b"\xff"),
    "a URDF that is a device": changed(r"urdf: \S+", "urdf: /dev/zero"),
    "an infinite duration": changed(r"duration: \S+", "duration: .inf"),
    "a duration of a year": changed(r"duration: \S+", "duration: 3.0e7"),
    "another joint": changed(r"(?m)^joints:\s*\n\s*position: \[", r"\g<0>0.0, "),
    "no limits": changed("limits:", "other:"),
    "a box": changed(
        r"(?m)^obstacles:", "obstacles: [{id: a, shape: {box: {size: [1, 1, 1]}}}]\nothers:"
    ),
}
OF_ROBOT = {
    "a pipe": pipe,
    "a device": device,
    "ten gigabytes": hole,
    "entities": lambda file: file.write_text(BOMB + file.read_text()),
    "no XML": lambda file: file.write_text("<robot>"),
    "deep elements": lambda file: file.write_text("<robot>" * 100_000),
    "a link that hangs on nothing": changed("</robot>", '<link name="lost"/></robot>'),
    "links in a circle": changed(
        "</robot>",
        '<link name="x"/><link name="y"/><joint name="a" type="fixed"><parent link="x"/>'
        '<child link="y"/></joint><joint name="b" type="fixed"><parent link="y"/>'
        '<child link="x"/></joint></robot>',
    ),
    "a joint without a child": changed("<child [^>]*>", ""),
}


def require_refused(scenario, tmp_path, capfd):
    answer = tmp_path / "answer.json"
    answer.write_text("{}")
    assert main(["score", str(scenario), str(answer)]) == 2
    said = capfd.readouterr().err
    assert "it must be a scenario of the data set: " in said
    assert len(said) < 2000


@pytest.mark.parametrize("kind", OF_SCENARIO)
def test_a_scenario_that_does_harm_is_refused_in_words(kind, scenario, tmp_path, capfd):
    OF_SCENARIO[kind](scenario)
    require_refused(scenario, tmp_path, capfd)


@pytest.mark.parametrize("kind", OF_ROBOT)
def test_a_robot_that_does_harm_is_refused_in_words(kind, scenario, tmp_path, capfd):
    (urdf,) = (scenario.parents[2] / "robots").glob("planar*.urdf")
    OF_ROBOT[kind](urdf)
    require_refused(scenario, tmp_path, capfd)


@pytest.mark.parametrize("make", [pipe, device], ids=["a pipe", "a device"])
def test_an_answer_that_is_no_file_is_refused_in_words(make, scenario, tmp_path, capfd):
    answer = tmp_path / "answer.json"
    answer.touch()
    make(answer)
    assert main(["score", str(scenario), str(answer)]) == 2
    assert "answer.json: it is a pipe or a device, not a file" in capfd.readouterr().err


def test_a_scenario_of_the_data_set_is_judged(small):
    for file in (small / "scenarios").glob("*/*.yaml"):
        assert judged(*load(file), {}).faults == ("not readable: 'time' is missing",)
