"""From a study to its cases and from a case to its row, without a cluster."""

from __future__ import annotations

import itertools
import json
import re
from copy import deepcopy
from dataclasses import asdict
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
import yaml
from campaigns import study, study_file
from quick_capture import quick_capture
from robots import LEMUR_SCENARIO, LEMUR_URDF
from scipy.spatial.transform import Rotation
from scipy.stats import binomtest
from test_target_urdf import scenario_with_urdf, tetrahedron

from ff_planner_ros.campaign.cases import Case, cases, kinds_of_values, require_sound
from ff_planner_ros.campaign.environment import meaning_of
from ff_planner_ros.campaign.sources import Generated, content, task_of, written
from ff_planner_ros.campaign.study import MethodOfStudy, load_study
from ff_planner_ros.campaign.table import Writer, plan_schema, read_plans
from ff_planner_ros.campaign.work import Outcome, run_case, run_cases
from ff_planner_ros.errors import FfPlannerError, InvalidInput
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.scenario.changes import Change, changed
from ff_planner_ros.planning.scenario.scenario import Defaults, load_task
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.problems.scenarios import scenario
from ff_planner_ros.report.statistics import Rate
from ff_planner_ros.robot.model import load_robot, robot_from_urdf_text

OURS = MethodOfStudy("ours", "optimal", ())


@pytest.fixture(scope="module")
def defaults() -> Defaults:
    return Defaults(load_parameters().planner)


MIXED: list[tuple[dict[str, Any], str]] = [
    ({"grid": {"limits.velocity": ["none", 0.3]}}, "text"),
    ({"grid": {"limits.acceleration": ["none", [0.5] * 7]}}, "text"),
    (
        {
            "random": {
                "count": 6,
                "seed": 1,
                "values": {"limits.velocity": {"choice": ["none", 0.3]}},
            }
        },
        "text",
    ),
]


@pytest.mark.parametrize(("variations", "kind"), MIXED)
def test_a_quantity_of_mixed_kinds_has_a_row_for_each_case(
    variations: dict[str, Any], kind: str, tmp_path: Path
) -> None:
    """A plan that waits to be written must not be lost by the value of another one."""
    asked = study(tmp_path, variations=variations, methods=[{"name": "s", "method": "straight"}])
    kinds = kinds_of_values(asked)
    assert list(kinds.values()) == [kind]
    out = tmp_path / "out"
    out.mkdir()
    writer = Writer(out, plan_schema(kinds))
    rows = [run_case(case).row for case in cases(asked)]
    writer.add([Outcome(row, []) for row in rows])
    writer.flush()
    (key,) = kinds
    found = {row["id"]: json.loads(row[f"change.{key}"]) for row in read_plans(out).to_pylist()}
    assert found == {row["id"]: json.loads(row["changes"])[key] for row in rows}


@pytest.mark.parametrize("kind", ["number", "numbers"])
def test_a_value_that_does_not_fit_its_column_is_left_out_of_it_alone(
    kind: str, tmp_path: Path
) -> None:
    asked = study(tmp_path, methods=[{"name": "s", "method": "straight"}])
    row = run_case(next(iter(cases(asked)))).row
    out = tmp_path / "out"
    out.mkdir()
    writer = Writer(out, plan_schema({"duration": kind}))
    values = {"number": 1.5, "numbers": [1.0, 2.0], "text": '"none"', "switch": "true"}
    writer.add(
        [
            Outcome(row | {"id": f"{k:016x}", "change.duration": value}, [])
            for k, value in enumerate(values.values())
        ]
    )
    writer.flush()
    found = [row["change.duration"] for row in read_plans(out).to_pylist()]
    assert found == [value if name == kind else None for name, value in values.items()]


def test_comments_and_docstrings_do_not_forbid_to_go_on_with_a_campaign(tmp_path: Path) -> None:
    same = {
        "py": (
            '"""One."""\ndef f():\n    """Two."""\n    return 1\n',
            "def f(): return 1  # one\n",
        ),
        "hpp": (
            'int a = 1; // one "\nchar* b = "//";\n',
            'int a = 1; /* two\n */\nchar* b = "//";\n',
        ),
        "yaml": ("a: 1  # one\n", "# two\na: 1\n"),
    }
    for ending, texts in same.items():
        found = []
        for number, text in enumerate((*texts, texts[0].replace("1", "2"))):
            path = tmp_path / f"{number}.{ending}"
            path.write_text(text, encoding="utf-8")
            found.append("".join(meaning_of(path).split()))
        assert found[0] == found[1] != found[2]


def test_a_study_has_every_source_point_draw_and_method_once(tmp_path: Path) -> None:
    found = list(
        cases(
            study(
                tmp_path,
                generated={"kind": "ordinary", "robots": ["lemur", "arm6"], "count": 2},
            )
        )
    )
    sources = ["quick_capture"]
    sources += [f"ordinary/{robot}/{seed}" for seed in (0, 1) for robot in ("lemur", "arm6")]
    told = [
        (case.source.name, case.changes[0].value, case.changes[1].value.number, case.method.name)
        for case in found
    ]
    assert told == list(itertools.product(sources, [2.0, 2.5], range(3), ["ours", "straight"]))
    assert len({case.id for case in found}) == 5 * 2 * 3 * 2
    assert [case.number for case in found] == list(range(60))


def test_a_case_keeps_its_id_where_a_study_grows_and_equal_cases_are_one(tmp_path: Path) -> None:
    small = [case.id for case in cases(study(tmp_path))]
    grid = {"duration": [2.0, 2.5, 2.5, 3.0]}
    larger = yaml.safe_load(study_file(tmp_path).read_text())["variations"] | {"grid": grid}
    grown = [case.id for case in cases(study(tmp_path, variations=larger))]
    assert grown[: len(small)] == small
    assert len(grown) == len(set(grown)) == len(small) * 3 // 2


def test_a_draw_is_the_same_for_every_source_point_and_method_and_beside_other_keys(
    tmp_path: Path,
) -> None:
    key = "chaser.angular_velocity"
    values: dict[int, set[str]] = {}
    for case in cases(study(tmp_path)):
        draw = case.changes[1].value.number
        values.setdefault(draw, set()).add(json.dumps(case.scenario()[2][key]))
    assert [len(found) for found in values.values()] == [1, 1, 1]
    assert len(set.union(*values.values())) == 3
    alone = {"count": 3, "seed": 7, "values": {key: {"plus": {"normal": [0.0, 0.002]}}}}
    again = cases(study(tmp_path, variations={"random": alone}, methods=[{"name": "x"}]))
    assert {json.dumps(c.scenario()[2][key]) for c in again} == set.union(*values.values())


def test_what_is_drawn_has_the_distribution_that_is_asked_for(tmp_path: Path) -> None:
    drawn: dict[str, list[Any]] = {"duration": [], "target.position": [], "points": []}
    values = {
        "duration": {"uniform": [2.0, 6.0]},
        "target.position": {"plus": {"normal": [0.5, 0.1]}},
        "points": {"choice": [20, 30]},
    }
    random = {"count": 500, "seed": 3, "values": values}
    found = study(tmp_path, variations={"random": random}, methods=[{"name": "x"}])
    for case in cases(found):
        for key, value in case.scenario()[2].items():
            drawn[key].append(value)
    assert 2.0 <= min(drawn["duration"]) < 2.1
    assert 5.9 < max(drawn["duration"]) <= 6.0
    offsets = np.array(drawn["target.position"]) - found.sources[0].document["target"]["position"]
    # Five standard errors of mean and deviation of 500 draws.
    assert np.allclose(offsets.mean(axis=0), 0.5, atol=5 * 0.1 / np.sqrt(500))
    assert np.allclose(offsets.std(axis=0), 0.1, atol=5 * 0.1 / np.sqrt(1000))
    assert np.abs(np.corrcoef(offsets.T)[np.triu_indices(3, 1)]).max() < 5 / np.sqrt(500)
    assert set(drawn["points"]) == {20, 30}


def test_masses_and_inertias_are_changed_in_the_robot_that_is_planned_for(
    defaults: Defaults,
) -> None:
    source = written(LEMUR_SCENARIO, "capture", defaults)
    changes = [
        Change("urdf.chaser.mass", "set", 300),
        Change("urdf.chaser.inertia", "times", 1.5),
        Change("urdf.link_2.inertia.ixx", "plus", 0.0004),
    ]
    document, urdf, _ = changed(source.document, source.urdf, changes)
    robot = task_of(document, urdf, defaults).problem.robot
    tree = ElementTree.parse(LEMUR_URDF)
    for link in tree.iter("link"):
        if link.get("name") == "chaser":
            link.find("inertial/mass").set("value", "300")
            inertia = link.find("inertial/inertia")
            for name, value in list(inertia.attrib.items()):
                inertia.set(name, str(float(value) * 1.5))
        if link.get("name") == "link_2":
            inertia = link.find("inertial/inertia")
            inertia.set("ixx", str(float(inertia.get("ixx")) + 0.0004))
    text = ElementTree.tostring(tree.getroot(), encoding="unicode")
    expected = robot_from_urdf_text(text, "chaser", "end_effector", geometry=robot.geometry)
    before = load_robot(LEMUR_URDF, "chaser", "end_effector", geometry=robot.geometry)
    for made, wanted in zip(robot.model.inertias, expected.model.inertias, strict=True):
        assert made.isApprox(wanted, 1e-12)
    assert (
        sum(
            not made.isApprox(old, 1e-12)
            for made, old in zip(robot.model.inertias, before.model.inertias, strict=True)
        )
        == 2
    )


def test_scenario_values_are_changed_in_place_by_number_by_id_or_in_a_new_block(
    defaults: Defaults,
) -> None:
    source = written(LEMUR_SCENARIO, "capture", defaults)
    changes = [
        Change("target.position[2]", "plus", -0.1),
        Change("obstacles.c3.radius", "times", 2.0),
        Change("obstacles[0].center", "set", [1.0, 2.0, 3.0]),
        Change("planner.starts", "set", 2),
        Change("limits.velocity", "set", "from_urdf"),
    ]
    document, urdf, values = changed(source.document, source.urdf, changes)
    task, problem = (task_of(document, urdf, defaults), load_task(LEMUR_SCENARIO, defaults).problem)
    assert task.problem.target.position.tolist() == [1.7, 0.4, 0.6 - 0.1]
    assert [s.radius for s in task.problem.obstacles] == [0.2, 0.15, 0.5]
    assert task.problem.obstacles[0].center.tolist() == [1.0, 2.0, 3.0]
    assert (task.settings.starts, task.problem.limits.joint_velocities) == (2, True)
    assert values["obstacles.c3.radius"] == 0.5
    # Nothing else is another: a source is the same after its cases are made.
    assert (
        task_of(source.document, source.urdf, defaults).problem.start.joint_positions.tolist()
        == problem.start.joint_positions.tolist()
    )


@pytest.mark.parametrize("attitude", ["quaternion_xyzw", "euler_xyz_deg"])
def test_a_frame_is_turned_about_its_own_axes_in_the_order_of_the_keys(
    attitude: str, defaults: Defaults
) -> None:
    """R Rx(a) Ry(b), of matrices that are written out, whichever of the two comes first."""
    source = written(LEMUR_SCENARIO, "capture", defaults)
    before = load_task(LEMUR_SCENARIO, defaults).problem.target.quaternion_xyzw
    document = deepcopy(source.document)
    if attitude == "quaternion_xyzw":
        del document["target"]["euler_xyz_deg"]
        document["target"][attitude] = before.tolist()
    a, b = 0.3, -1.1
    about_x = [[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]]
    about_y = [[np.cos(b), 0, np.sin(b)], [0, 1, 0], [-np.sin(b), 0, np.cos(b)]]
    wanted = Rotation.from_quat(before).as_matrix() @ about_x @ about_y
    changes = [
        Change("turn.target.y", "set", np.rad2deg(b)),
        Change("turn.target.x", "plus", np.rad2deg(a)),
    ]
    turned, urdf, values = changed(document, source.urdf, changes)
    found = task_of(turned, urdf, defaults).problem.target.quaternion_xyzw
    np.testing.assert_allclose(Rotation.from_quat(found).as_matrix(), wanted, atol=1e-12)
    assert values == {"turn.target.x": np.rad2deg(a), "turn.target.y": np.rad2deg(b)}


def test_a_range_of_a_grid_is_its_values_and_times_and_plus_are_as_in_draws(tmp_path: Path) -> None:
    grid = {
        "duration": {"range": [2.0, 3.0, 11]},
        "target.position[0]": {"plus": {"range": [-0.1, 0.1, 3]}},
        "chaser.angular_velocity": {"times": [0.5, 2.0]},
    }
    asked = study(tmp_path, variations={"grid": grid}, methods=[{"name": "x"}])
    document = asked.sources[0].document
    place, spin = document["target"]["position"][0], document["chaser"]["angular_velocity"]
    told = [case.scenario()[2] for case in cases(asked)]
    assert [one["duration"] for one in told[:33:3]] == [(20 + k) / 10 for k in range(11)]
    moved = [one["target.position[0]"] - place for one in told[:3]]
    assert moved == pytest.approx([-0.1, 0.0, 0.1])
    assert told[0]["chaser.angular_velocity"] == [0.5 * one for one in spin]
    assert not any(case.is_drawn for case in cases(asked))
    assert all(case.is_drawn for case in cases(study(tmp_path)))


@pytest.mark.parametrize("name", ["lemur_capture", "lemur_capture_bodies", "canadarm2_capture"])
def test_a_source_is_the_task_of_its_file_without_the_file(name: str, defaults: Defaults) -> None:
    path = LEMUR_SCENARIO.with_name(f"{name}.yaml")
    source = written(path, name, defaults)
    digest = load_task(path, defaults).digest
    assert task_of(*content(source, defaults), defaults).digest == digest == source.digest


def test_a_source_carries_the_meshes_and_the_urdf_that_its_file_names(
    tmp_path: Path, defaults: Defaults
) -> None:
    path = scenario_with_urdf(tmp_path)
    tetrahedron(tmp_path / "client.stl")
    document = yaml.safe_load(path.read_text(encoding="utf-8"))
    mesh = {"id": "hull", "shape": {"mesh": {"file": "client.stl"}}, "position": [30.0, 0.0, 0.0]}
    document["obstacles"].append(mesh)
    path.write_text(yaml.safe_dump(document), encoding="utf-8")
    digest = load_task(path, defaults).digest
    source = written(path, "client", defaults)
    for name in ("client.stl", "client/client.urdf"):
        (tmp_path / name).unlink()
    task = task_of(*content(source, defaults), defaults)
    assert task.digest == digest == source.digest
    assert [one.id for one in task.problem.obstacles if not one.is_sphere][:2] == ["hull", "bus"]


def test_a_row_tells_what_perform_answers(tmp_path: Path, defaults: Defaults) -> None:
    path = quick_capture(tmp_path)
    case = Case(0, written(path, "quick", defaults), defaults, (), OURS, trajectory=True)
    outcome = run_case(case)
    task = load_task(path, defaults)
    plan = perform(task)
    row, metrics = outcome.row, asdict(plan.metrics)
    assert (row["status"], row["solved"], row["digest"]) == ("solved", True, task.digest)
    assert row["message"] == plan.solver.stop_reason
    for name in ("joint_path_length", "max_chaser_euler", "final_position_error", "penalty"):
        assert row[name] == metrics[name], name
    assert row["peak_joint_torques"] == list(plan.metrics.peak_joint_torques)
    assert row["min_clearance"] is None, "there are no obstacles"
    positions = [point["joint_positions"] for point in outcome.points]
    assert positions == plan.trajectory.joint_positions.tolist()
    again = run_case(case)
    assert again.row | {"solve_time": 0} == row | {"solve_time": 0}


def test_a_refusal_and_a_value_out_of_range_are_rows(tmp_path: Path, defaults: Defaults) -> None:
    source = written(quick_capture(tmp_path), "quick", defaults)
    far = Change("target.position[0]", "plus", 90.0)
    negative = Change("duration", "set", -1.0)
    rows = [run_case(Case(0, source, defaults, (c,), OURS, False)).row for c in (far, negative)]
    assert [row["status"] for row in rows] == ["goal_out_of_reach", "out_of_range"]
    assert not any(row["solved"] for row in rows)
    assert "duration is -1" in rows[1]["message"]


def test_a_drawn_problem_is_that_of_the_benchmark(defaults: Defaults) -> None:
    source = Generated("ordinary", "lemur", 1, turned=False)
    drawn = scenario("ordinary", "lemur", 1, turned=False).problem
    task = task_of(*content(source, defaults), defaults)
    assert task.digest == PlanningTask(drawn, defaults.settings).digest


def test_a_worker_of_another_version_plans_nothing_and_says_what_differs(
    tmp_path: Path,
) -> None:
    jobs = list(cases(study(tmp_path)))[:1]
    said = run_cases(jobs, {"numpy": "0.1", "python": "1.0"})
    assert isinstance(said, str)
    assert re.search(r"numpy is .*, not 0.1, python is .*, not 1.0", said)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"scenarios": ["none.yaml"]}, r"scenarios\[0\] is none.yaml: there is no such file"),
        ({"scenarios": []}, "there is nothing to plan"),
        ({"scenario": []}, "scenario is unknown"),
        ({"bag": "no_such_bag"}, "no_such_bag"),
        (
            {"generated": {"kind": "hard", "robots": ["lemur"], "count": 1}},
            "generated.kind is 'hard'",
        ),
        ({"generated": {"kind": "ordinary", "robots": ["r2"], "count": 1}}, r"robots\[0\] is r2"),
        (
            {"generated": {"kind": "bodies", "robots": ["lemur"], "count": 1, "turned": True}},
            "generated.turned is True: there are no turned frames of kind bodies",
        ),
        ({"variations": {"grid": {"planner.strats": [1]}}}, "planner.strats is unknown"),
        ({"variations": {"grid": {"planner.starts": []}}}, "planner.starts is empty"),
        ({"variations": {"grid": {"duration": {"range": [1, 2]}}}}, r"range is .1, 2.: .*count"),
        ({"variations": {"grid": {"duration": {"range": [1, 2, 1]}}}}, "range is .*2 to 10000"),
        ({"variations": {"grid": {"points": {"range": [1, 2, 10**9]}}}}, "range is .*2 to 10000"),
        ({"variations": {"grid": {"turn.target": [1.0]}}}, "'turn.target': to turn a frame"),
        ({"variations": {"grid": {"turn.joints.x": [1.0]}}}, "turn.joints.x is unknown"),
        ({"variations": {"grid": {"turn.target.x": ["far"]}}}, "turn.target.x"),
        ({"variations": {"grid": {"planner.starts": 3}}}, "planner.starts is 3: .* a list"),
        ({"variations": {"grid": {"duration": {"by": [1]}}}}, "duration.by is unknown"),
        (
            {"variations": {"grid": {"obstacles.c9.radius": [1.0]}}},
            "obstacles.c9.radius is unknown",
        ),
        ({"variations": {"grid": {"urdf.nose.mass": [1.0]}}}, "nose.mass is unknown: links with"),
        (
            {"variations": {"grid": {"urdf.chaser.colour": [1.0]}}},
            "'urdf.chaser.colour': of a URDF",
        ),
        ({"variations": {"grid": {"urdf.chaser.inertia": [1.0]}}}, "inertia is set: .* `times`"),
        ({"variations": {"grid": {"points": {"times": ["x"]}}}}, "points is 'x': .* number"),
        ({"variations": {"random": {"count": 1, "values": {}}}}, "random.seed is missing"),
        (
            {
                "variations": {
                    "random": {"count": 1, "seed": 1, "values": {"points": {"cauchy": 1}}}
                }
            },
            "points.cauchy is unknown",
        ),
        (
            {
                "variations": {
                    "random": {"count": 1, "seed": 1, "values": {"x": {"uniform": [2, 1]}}}
                }
            },
            "x.uniform is .2, 1.: .*lower bound",
        ),
        ({"methods": [{"name": "a", "method": "magic"}]}, r"methods\[0\].method is 'magic'"),
        ({"methods": [{"name": "a"}, {"name": "a"}]}, r"methods\[1\].name is a: .* unique"),
        ({"methods": [{"name": "a", "set": {"target.colour": 1}}]}, "target.colour is unknown"),
        ({"variations": {"grid": {"robot.urdf": ["x.urdf"]}}}, "'robot.urdf': a robot of another"),
        (
            {
                "methods": [{"name": "a", "set": {"duration": 3.0}}],
                "variations": {"grid": {"duration": [2.0]}},
            },
            "duration is varied twice",
        ),
        (
            {"variations": {"grid": {"points": list(range(9999)), "duration": [1.0] * 9999}}},
            "199960002 cases: a campaign has 1000000 cases at most",
        ),
        ({"keep": {"trajectories": "some"}}, "keep.trajectories is 'some'"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_a_study_that_names_what_does_not_exist_is_refused_by_name(
    tmp_path: Path, changes: dict[str, Any], said: str
) -> None:
    with pytest.raises(FfPlannerError, match=said):
        require_sound(study(tmp_path, **changes))


def test_the_study_that_comes_along_is_sound() -> None:
    path = LEMUR_SCENARIO.parents[1] / "studies" / "lemur_masses.yaml"
    found = load_study(path)
    require_sound(found)
    assert len(list(cases(found))) == 3 * 4 * 3


def test_the_interval_of_a_rate_is_that_of_clopper_and_pearson() -> None:
    for count, total in ((0, 1), (1, 1), (0, 40), (40, 40), (7, 10), (9_990, 10_000)):
        expected = binomtest(count, total).proportion_ci(0.95, method="exact")
        assert Rate(count, total).interval == pytest.approx(tuple(expected), abs=1e-12)


def test_the_same_study_in_another_place_has_the_same_cases(tmp_path: Path) -> None:
    first, second = (
        [case.id for case in cases(study(tmp_path / name))] for name in ("one", "other")
    )
    assert first == second
    with pytest.raises(InvalidInput, match=r"file is .*study\.yaml: it cannot be read"):
        load_study(tmp_path / "study.yaml")
