"""The command `published`: plans of the gallery's scenarios, and the page of its figures."""

import json
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

from ff_planner_benchmark.cli import main
from ff_planner_benchmark.gallery import plans, run
from ff_planner_benchmark.gallery.least_turn import PlanarTestbed, least_last_turns
from ff_planner_benchmark.gallery.page import page
from ff_planner_benchmark.gallery.problems import PROBLEMS
from ff_planner_benchmark.gallery.recomputed import COMPARISONS, HERE, model
from ff_planner_ros.errors import InvalidInput
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.scenario.scenario import Defaults, load_task
from ff_planner_ros.robot.model import Base

SETTINGS = load_parameters().planner
DOCS = Path(__file__).resolve().parents[2] / "docs"
FIGURES = json.loads((DOCS / "published.json").read_text(encoding="utf-8"))
FILES = sorted(path.stem for path in plans.SCENARIOS.glob("*.yaml"))
TOLD = [task for tasks in plans.TASKS.values() for task in tasks]
# Rotation of the chaser at the end that a plan may have [deg], and at any time.
MOST = {
    "p2b": (6.88, 6.88),
    "p4_least": (4.5, 4.5),
    "p8_planar": (0.1, 0.1),
    "p9": (1.3443, 1.3443),
}


def test_every_scenario_is_planned_and_says_its_units_and_frames():
    assert sorted({*(task.scenario for task in TOLD), "p5_reach", "p16"}) == FILES
    for name in FILES:
        head = (plans.SCENARIOS / f"{name}.yaml").read_text().partition("robot:")[0]
        assert "Units: m, rad, s, N m. Frames: " in head
        assert "models/" in head


def test_every_problem_has_a_section_and_every_model_one_that_names_it():
    assert set(COMPARISONS) | set(plans.TASKS) | {"P16"} == set(PROBLEMS)
    named = [one for problem in PROBLEMS.values() for one in problem.models]
    assert sorted(set(named)) == sorted(path.stem for path in HERE.glob("models/*.urdf"))


@pytest.mark.parametrize("name", MOST)
def test_a_plan_of_a_published_task_turns_the_chaser_less(name):
    (task,) = (one for one in TOLD if one.scenario == name)
    row = plans.planned(task, SETTINGS)
    last, largest = MOST[name]
    assert row["status"] == plans.SOLVED
    assert row["turn_deg"] <= last
    assert row["peak_deg"] <= largest
    assert row["position_mm"] <= 0.05


def test_goals_of_the_environment_are_of_its_distribution_and_reached_within_a_millimetre():
    start = Defaults(SETTINGS)
    middle = load_task(plans.SCENARIOS / "p16.yaml", start).problem.target.position
    for row in plans.drawn_goals(3, SETTINGS):
        off = [goal - center for goal, center in zip(row["goal"], middle, strict=True)]
        assert all(abs(one) <= most for one, most in zip(off, (0.2, 0.3, 0.15), strict=True))
        assert row["status"] == plans.SOLVED
        assert row["position_mm"] <= 1.0


def test_the_start_of_every_scenario_has_its_base_link_at_the_origin():
    """As the published numbers have it, whose motions begin there."""
    for name in FILES:
        try:
            task = load_task(plans.SCENARIOS / f"{name}.yaml", Defaults(SETTINGS))
        except InvalidInput:
            continue
        robot, start = task.problem.robot, task.problem.start
        attitude = Rotation.from_quat(start.quaternion_chaser_to_inertial_xyzw.copy())
        off = start.position_chaser_in_inertial - attitude.apply(
            robot.position_chaser_in_base.copy()
        )
        assert off == pytest.approx([0.0, 0.0, 0.0], abs=1e-5), name


def test_the_page_is_that_of_the_measured_figures():
    assert (DOCS / "explanation" / "published.md").read_text(encoding="utf-8") == page(FIGURES)
    assert list(FIGURES["problems"]) == list(PROBLEMS)


def test_the_measured_figures_have_every_number_that_is_compared():
    for name, compared in COMPARISONS.items():
        rows = FIGURES["problems"][name]["recomputed"]
        if name != "P5":  # which takes long
            assert [row["printed"] for row in rows] == [one.printed for one in compared()]
        assert all(row["agrees"] for row in rows)


def test_a_task_without_a_plan_is_on_the_page_with_its_reason():
    row = {
        "what": "a thing",
        "published": "",
        "status": "COLLISION",
        "message": "it collides",
        "seconds": 1.0,
    }
    figures = {"machine": FIGURES["machine"], "problems": {"P12": {"plans": [row]}}}
    text = page(figures)
    assert "| a thing | - | - | - | - | - | - | 1.00 | - | - | - |" in text
    assert "*a thing*, not planned: it collides" in text


def test_a_number_that_is_off_says_no():
    row = {"what": "a turn", "unit": "deg", "printed": "1.0", "ours": 1.3, "by": "published"}
    row |= {"agrees": False, "rounds": False, "remark": ""}
    figures = {"machine": FIGURES["machine"], "problems": {"P12": {"recomputed": [row]}}}
    assert "| a turn | deg | 1.0 | 1.30 | published | no |" in page(figures)


def test_the_planar_testbed_moves_as_the_dynamics_of_its_model_say():
    testbed, rng = PlanarTestbed(), np.random.default_rng(1)
    model, data = testbed.robot.model, testbed.robot.model.createData()
    joints, rates, accelerations = rng.normal(size=(3, 3))
    turn, torques = testbed.motion(joints, rates, accelerations)
    q = np.concatenate([np.zeros(6), [1.0], joints])
    mass = pin.crba(model, data, q)
    mass = np.triu(mass) + np.triu(mass, 1).T
    base = np.linalg.solve(mass[:6, :6], -mass[:6, 6:] @ rates)
    assert turn == pytest.approx(base[5])
    forces = pin.nle(model, data, q, np.concatenate([base, rates]))
    of_base = np.linalg.solve(mass[:6, :6], -forces[:6] - mass[:6, 6:] @ accelerations)
    true = mass[6:] @ np.concatenate([of_base, accelerations]) + forces[6:]
    assert torques == pytest.approx(true)


@pytest.mark.ci
def test_no_start_of_the_direct_optimisation_turns_the_testbed_less_than_its_limits_allow():
    """What bounds P1: the same from every start, and below any plan, which comes near to it."""
    turns = least_last_turns(25, 3, within_torques=True)
    assert turns == pytest.approx(np.full(3, 4.101), abs=1e-3)
    assert least_last_turns(25, 1, within_torques=False)[0] == pytest.approx(3.087, abs=1e-3)
    (first, _) = plans.TASKS["P1"]
    turn = plans.planned(first, SETTINGS)["turn_deg"]
    assert turns.max() < turn < 1.1 * turns.max()


@pytest.mark.ci
def test_the_hub_comes_back_within_the_accelerations_of_the_published_profile():
    """And turns less on the way than at the end of the published motion."""
    (slow,) = (one for one in TOLD if one.scenario == "p4_back_slow")
    row = plans.planned(slow, SETTINGS)
    assert row["status"] == plans.SOLVED
    assert row["turn_deg"] <= 0.01
    assert row["peak_deg"] < 11.7465


@pytest.mark.ci
def test_the_command_adds_a_problem_to_the_file_of_figures(tmp_path):
    file, written = tmp_path / "figures.json", tmp_path / "page.md"
    file.write_text(json.dumps({"problems": {"P12": FIGURES["problems"]["P12"]}}))
    told = ["--only", "P9", "--json", str(file), "--page", str(written)]
    assert main(["published", *told]) == 0
    figures = json.loads(file.read_text())
    assert list(figures["problems"]) == ["P9", "P12"]
    assert written.read_text() == page(figures)
    assert "## P9. ETS-VII" in written.read_text()


def test_the_command_refuses_an_unknown_problem(capsys):
    assert main(["published", "--only", "P3"]) == 2
    assert "it must be one of P1, P2a" in capsys.readouterr().err


def test_without_their_motion_there_are_plans_alone():
    figures = run.figures_of("P12", 1)
    assert list(figures) == ["plans"]
    assert figures["plans"][0]["turn_deg"] < 15.9


def test_the_arm_of_a_model_is_as_long_as_printed():
    """DEOS stretches to about 3 m."""
    deos = model("deos", Base.FREE_FLYER)
    offsets = [one.translation for one in deos.model.jointPlacements.tolist()[3:]]
    assert 2.8 < sum((offset @ offset) ** 0.5 for offset in offsets) + 0.1855 < 3.4
