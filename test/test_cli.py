"""The command line, as a user types it: exit codes, messages, files."""

import importlib.metadata
import json
import os
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from mcap.reader import make_reader
from published_paths import p5
from rosbags.highlevel import AnyReader

from ff_planner_ros.analysis.summary import phase_rows
from ff_planner_ros.cli import main
from ff_planner_ros.commands.options import require_directory, require_file
from ff_planner_ros.commands.parser import command_parser
from ff_planner_ros.common.share import share_directory
from ff_planner_ros.errors import InvalidInput
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.paths.polynomial import PARAMETERS
from ff_planner_ros.planning.problem.problem import ChaserGoal, Objective
from ff_planner_ros.planning.scenario.scenario_writer import write_scenario
from ff_planner_ros.planning.task.task import PlanningTask

CONFIG = share_directory() / "config"
CAPTURE = CONFIG / "scenarios" / "lemur_capture.yaml"
LEMUR = CONFIG / "robots" / "lemur" / "lemur.urdf"
SHAPES = {
    "time": (50,),
    "joint_positions": (50, 7),
    "joint_velocities": (50, 7),
    "joint_accelerations": (50, 7),
    "joint_torques": (50, 7),
    "chaser_positions": (50, 3),
    "chaser_quaternions_xyzw": (50, 4),
    "chaser_linear_velocities": (50, 3),
    "chaser_angular_velocities": (50, 3),
    "ee_positions": (50, 3),
    "ee_quaternions_xyzw": (50, 4),
    "xi": (PARAMETERS,),
}
METRICS = {
    "joint_path_length",
    "max_chaser_euler",
    "max_chaser_rotation",
    "min_clearance",
    "min_joint_margin",
    "min_velocity_margin",
    "peak_joint_torques",
    "torque_error",
    "penalty",
    "final_position_error",
    "final_orientation_error",
}


@pytest.fixture
def scenario(tmp_path):
    """A copy of the capture with some values replaced, by dotted name."""

    def write(**changes):
        content = yaml.safe_load(CAPTURE.read_text())
        content["robot"]["urdf"] = str(LEMUR)
        for name, value in changes.items():
            *groups, key = name.split("__")
            place = content
            for group in groups:
                place = place[group]
            place[key] = value
        path = tmp_path / "scenario.yaml"
        path.write_text(yaml.safe_dump(content))
        return path

    return write


def no_constant(constant):
    """Strict readers of JSON take neither NaN nor Infinity."""
    raise AssertionError(constant)


def test_plan_writes_every_field_of_the_contract(tmp_path, capsys):
    answer = tmp_path / "answer.json"
    assert main(["plan", str(CAPTURE), "--objective", "length", "--json", str(answer)]) == 0
    written = json.loads(answer.read_text())
    assert written["status"] == "solved"
    assert written["message"]
    assert written["joint_names"] == [f"joint_{k}" for k in range(1, 8)]
    assert {name: np.shape(written[name]) for name in SHAPES} == SHAPES
    assert set(written["metrics"]) >= METRICS
    assert set(written["solver"]) >= {"solve_time", "iterations", "rollouts", "stop_reason"}
    assert written["metrics"]["joint_path_length"] <= 1.115
    shown = capsys.readouterr().out
    assert re.search(r"joint path length +1\.1", shown)
    peaks = np.array(written["metrics"]["peak_joint_torques"])
    at_points = np.abs(written["joint_torques"]).max(axis=0)
    assert (at_points * (1.0 - 1e-9) <= peaks).all()
    assert peaks == pytest.approx(at_points, rel=0.03)  # they are higher between the points
    assert re.search(rf"peak joint torque +{peaks.max():.4g} N m, joint_4", shown)


def test_plan_tells_the_chasers_rotation_at_the_goal_if_it_is_asked_for(scenario, capsys, tmp_path):
    answer, label = tmp_path / "answer.json", "chaser rotation at the goal"
    asked = scenario(target__chaser_rotation=0.02)
    assert main(["plan", str(asked), "--json", str(answer)]) == 0
    angle = np.rad2deg(json.loads(answer.read_text())["metrics"]["final_chaser_rotation"])
    assert re.search(rf"{label} +{angle:.4f} deg", capsys.readouterr().out)
    assert main(["plan", str(scenario())]) == 0
    told = capsys.readouterr().out
    assert label not in told
    assert "from the path" not in told


def test_the_table_of_phases_tells_it_of_those_that_ask_for_it(lemur_plan):
    phases = replace(lemur_plan, then=(lemur_plan,))
    rows = phase_rows(phases, [ChaserGoal(), ChaserGoal(rotation=1.0)])
    most, last = np.rad2deg(
        [lemur_plan.metrics.max_chaser_rotation, lemur_plan.metrics.final_chaser_rotation]
    )
    assert [row[3] for row in rows] == [f"{most:.2f}", f"{most:.2f}, at the goal {last:.4f}"]


def test_plan_tells_the_largest_errors_along_a_path(capsys, tmp_path):
    problem = replace(p5(300.0, 1e-3, 31), objective=Objective(1.0, 0.0))
    file, answer = tmp_path / "path.yaml", tmp_path / "answer.json"
    write_scenario(PlanningTask(problem, load_parameters().planner), file)
    assert main(["plan", str(file), "--json", str(answer)]) == 0
    away = 1e3 * json.loads(answer.read_text())["metrics"]["max_path_position_error"]
    told = capsys.readouterr().out
    assert re.search(rf"largest distance from the path +{away:.4f} mm", told)
    assert "angle to the path" not in told  # its orientation is free


def test_plan_without_obstacles_writes_json_that_strict_readers_take(scenario, tmp_path):
    answer = tmp_path / "answer.json"
    assert main(["plan", str(scenario(obstacles=[])), "--json", str(answer)]) == 0
    written = json.loads(answer.read_text(), parse_constant=no_constant)
    assert written["metrics"]["min_clearance"] is None


def test_a_baseline_that_passes_the_check_is_answered_like_any_plan(tmp_path, capsys):
    answer, directory = tmp_path / "answer.json", tmp_path / "bag"
    command = ["plan", str(CAPTURE), "--method", "apf", "--json", str(answer), "--bag"]
    assert main([*command, str(directory)]) == 0
    assert "artificial potential field: the goal is reached" in capsys.readouterr().out
    written = json.loads(answer.read_text(), parse_constant=no_constant)
    assert written["status"] == "solved"
    assert np.shape(written["joint_positions"]) == (50, 7)
    assert written["xi"] == []
    assert written["solver"]["optimality"] is None
    with AnyReader([directory]) as reader:
        assert "/joint_trajectory" in reader.topics


def test_a_baseline_that_fails_the_check_ends_with_3_and_every_cause(scenario, tmp_path, capsys):
    answer, directory = tmp_path / "answer.json", tmp_path / "bag"
    straight = ["plan", str(CAPTURE), "--method", "straight", "--json", str(answer), "--bag"]
    assert main([*straight, str(directory)]) == 3
    told = capsys.readouterr().err
    assert "no plan found in the only attempt, straight line: xi = 0" in told
    assert "inside obstacle c1" in told
    assert told.rstrip().endswith("What may help: --method optimal")
    written = json.loads(answer.read_text(), parse_constant=no_constant)
    assert written["status"] == "collision"
    assert written["metrics"]["joint_path_length"] == pytest.approx(1.2196, abs=1e-4)
    assert written["solver"]["stop_reason"].startswith("straight line")
    assert "joint_positions" not in written
    with AnyReader([directory]) as reader:
        assert "/joint_trajectory" not in reader.topics

    late = scenario(duration=3.0, obstacles=[])
    assert main(["plan", str(late), "--method", "apf"]) == 3
    complaint = capsys.readouterr().err
    assert "time out" in complaint
    assert "final_position_error" in complaint
    assert "--method optimal" in complaint


def test_a_straight_line_with_nothing_in_the_way_is_a_plan(scenario):
    assert main(["plan", str(scenario(obstacles=[])), "--method", "straight"]) == 0


def test_bad_input_ends_with_2_and_the_field_on_stderr(scenario, tmp_path, capsys):
    answer = tmp_path / "answer.json"
    path = scenario(chaser__quaternion_xyzw=[0.0, 0.0, 0.0, 2.0])
    assert main(["plan", str(path), "--json", str(answer)]) == 2
    assert "chaser.quaternion_xyzw" in capsys.readouterr().err
    written = json.loads(answer.read_text())
    assert written["status"] == "bad_quaternion"
    assert "chaser.quaternion_xyzw" in written["message"]
    assert "joint_positions" not in written


def test_no_plan_ends_with_3_and_the_constraint_on_stderr(scenario, tmp_path, capsys):
    answer = tmp_path / "answer.json"
    path = scenario(target__position=[9.0, 0.4, 0.6])
    assert main(["plan", str(path), "--json", str(answer)]) == 3
    assert "target.position is" in capsys.readouterr().err
    assert json.loads(answer.read_text())["status"] == "goal_out_of_reach"


def test_the_best_attempt_of_a_refusal_tells_its_metrics_and_not_its_motion(
    scenario, tmp_path, capsys
):
    answer, planner = tmp_path / "answer.json", tmp_path / "planner.yaml"
    text = (CONFIG / "planner.yaml").read_text()
    planner.write_text(re.sub(r"(starts|max_iterations): \d+", r"\1: 1", text))
    path = scenario(duration=1.0, obstacles=[], limits={"velocity": "from_urdf"})
    assert main(["plan", str(path), "--parameters", str(planner), "--json", str(answer)]) == 3
    assert "moves at" in capsys.readouterr().err
    written = json.loads(answer.read_text())
    assert written["status"] == "limit_violated"
    assert written["metrics"]["min_velocity_margin"] < 0.0
    assert written["solver"]["starts"] == 1
    assert "joint_positions" not in written


def test_a_time_budget_that_is_used_up_ends_with_3(tmp_path, capsys):
    answer = tmp_path / "answer.json"
    command = ["plan", str(CAPTURE), "--json", str(answer), "--time-budget"]
    assert main([*command, "1e-6"]) == 3
    assert "the time budget of 1e-06 s is used up" in capsys.readouterr().err
    assert json.loads(answer.read_text())["status"] == "timed_out"
    assert main([*command, "600"]) == 0


def test_what_the_first_check_loads_is_loaded_before_the_time_of_the_search_begins(tmp_path):
    bodies = str(CAPTURE.with_name("lemur_capture_bodies.yaml"))
    program = f"""if True:
        import sys
        from ff_planner_ros.cli import main
        from ff_planner_ros.time_budget import TimeBudget
        begin = TimeBudget.__init__
        def noted(self, *given, **named):
            begin(self, *given, **named)
            noted.before = set(sys.modules)
        TimeBudget.__init__ = noted
        assert main(["plan", {bodies!r}, "--time-budget", "60"]) == 0
        print({{name.partition(".")[0] for name in set(sys.modules) - noted.before}})
    """
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, check=False, text=True, cwd=tmp_path
    )
    assert done.returncode == 0, done.stderr
    assert "scipy" not in done.stdout.splitlines()[-1]


@pytest.mark.parametrize("budget", ["0", "-1", "nan"])
def test_a_time_budget_that_is_none_ends_with_2(budget, capsys):
    assert main(["plan", str(CAPTURE), f"--time-budget={budget}"]) == 2
    assert "--time-budget is" in capsys.readouterr().err


def test_an_unknown_command_or_option_ends_with_2(capsys):
    for arguments in (["fly"], ["plan", str(CAPTURE), "--fast"], []):
        with pytest.raises(SystemExit) as stop:
            main(arguments)
        assert stop.value.code == 2
    assert "--fast" in capsys.readouterr().err


@pytest.mark.parametrize("command", [["check", "--schema", "scenario"], ["robot", str(LEMUR)]])
def test_who_reads_no_more_is_no_fault(command):
    """As `| head` does: no message, and no exit code of bad input."""
    reader, writer = os.pipe()
    os.close(reader)
    program = [sys.executable, "-m", "ff_planner_ros.cli", *command]
    done = subprocess.run(program, stdout=writer, stderr=subprocess.PIPE, check=False, text=True)
    os.close(writer)
    assert (done.returncode, done.stderr) == (0, "")


BAG = str(Path(__file__).parent / "golden_bags" / "node")
# Every output of every command: no work is done for one that cannot be written.
OUTPUTS = [
    ("ask", "--json"),
    ("campaign", "study.yaml", "--out"),
    ("campaign", "study.yaml", "--out", "out", "--library"),
    ("campaign", "report", "DIR", "--output"),
    ("compare", str(CAPTURE), "--output"),
    ("demo", "--output"),
    ("doctor", "--json"),
    ("export", BAG, "--aem"),
    ("export", BAG, "--csv"),
    ("export", BAG, "--npz"),
    ("export", BAG, "--oem"),
    ("export", BAG, "--parquet"),
    ("export", BAG, "--scenarios"),
    ("plan", str(CAPTURE), "--bag"),
    ("plan", str(CAPTURE), "--draw"),
    ("plan", str(CAPTURE), "--json"),
    ("plan", str(CAPTURE), "--pareto", "--json"),
    ("plan", str(CAPTURE), "--pareto", "--output"),
    ("recover", BAG, "--output"),
    ("report", BAG, "--output"),
    ("robot", str(LEMUR), "--draw"),
    ("robot", str(LEMUR), "--json"),
    ("robot", str(LEMUR), "--picture"),
    ("robot", str(LEMUR), "--srdf"),
    ("verify", str(CAPTURE), "--json"),
]


def test_every_path_that_an_option_takes_is_of_an_input_or_of_an_output_that_is_tried():
    inputs = {"--library", "--parameters"}
    (commands,) = (one for one in command_parser()._actions if one.choices)
    found = set()
    for verb, command in commands.choices.items():
        tried = command.get_default("outputs") or {}
        for action in command._actions:
            if action.type is Path and action.option_strings:
                (option,) = action.option_strings
                assert action.dest in tried or option in inputs or verb == "report"
                found |= set() if option in inputs else {(verb, option)}
    told = {(verb, option) for verb, *_, option in OUTPUTS} - {("campaign", "--library")}
    assert found == told


@pytest.mark.parametrize("command", OUTPUTS, ids=" ".join)
def test_an_output_that_cannot_be_written_is_refused_before_the_work(
    command, tmp_path, monkeypatch, capsys
):
    option = command[-1]
    taken = tmp_path / "taken"
    taken.write_text("a file")
    place = taken / "answer"

    def work(_options):
        raise AssertionError

    monkeypatch.setattr("ff_planner_ros.analysis.pareto_front.pareto_front", work)
    monkeypatch.setattr("ff_planner_ros.report.from_bag.report_of_bag", work)
    monkeypatch.setattr("ff_planner_ros.planning.task.task.perform", work)
    monkeypatch.setattr("ff_planner_ros.planning.scenario.scenario.load_scenario", work)
    assert main([*command, str(place)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"ff-planner: {option} is {place}: it cannot be written: ")
    assert taken.read_text() == "a file"


def test_trying_an_output_leaves_what_is_there_and_nothing_new(tmp_path):
    old, new = tmp_path / "old.json", tmp_path / "new.json"
    old.write_text("before")
    with pytest.raises(SystemExit):
        main(["plan", str(CAPTURE), "--json", str(new), "--fast"])
    for path in (old, new):
        require_file("--json", path)
    require_directory("--draw", tmp_path / "one" / "two")
    assert old.read_text() == "before"
    assert [one.name for one in tmp_path.iterdir()] == ["old.json"]


def test_an_output_that_is_a_pipe_is_left_to_who_reads_it(tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    require_file("--json", pipe)  # to open it would wait for a reader
    reader, writer = os.pipe()  # as of a shell's >(...)
    require_file("--json", Path(f"/dev/fd/{writer}"))
    os.close(writer)
    os.close(reader)


def test_an_output_that_is_a_link_is_tried_where_it_leads(tmp_path):
    for name, place in (("link", "there.json"), ("lost", "none/there.json")):
        (tmp_path / name).symlink_to(tmp_path / place)
    require_file("--json", tmp_path / "link")
    with pytest.raises(InvalidInput, match=r"--json is .*lost: it cannot be written: No such file"):
        require_file("--json", tmp_path / "lost")
    assert sorted(one.name for one in tmp_path.iterdir()) == ["link", "lost"]


def test_a_plan_that_cannot_be_written_after_all_is_printed(tmp_path, monkeypatch, capsys):
    def fail(*_arguments):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("ff_planner_ros.commands.planning.write_json", fail)
    command = ["plan", str(CAPTURE), "--objective", "length", "--json", str(tmp_path / "x.json")]
    assert main(command) == 2
    shown, said = capsys.readouterr()
    assert "joint path" in shown
    assert "No space left on device" in said


# Options that a command would not look at, and where they count.
IN_VAIN = [
    (("plan", CAPTURE, "--output", "x"), "--output", "--pareto"),
    (("plan", CAPTURE, "--pareto", "--draw", "x"), "--draw", "--pareto"),
    (("plan", CAPTURE, "--method", "apf", "--time-budget", "1"), "--time-budget", "apf"),
    (("plan", CAPTURE, "--method", "straight", "--library", "x"), "--library", "straight"),
    (("plan", CAPTURE, "--method", "straight", "--objective", "1,1"), "--objective", "straight"),
    (("plan", CAPTURE, "--method", "zero_momentum", "--library", "x"), "--library", "zero"),
    (("verify", "x.json", "--objective", "length"), "--objective", "a scenario"),
    (("verify", BAG, "--parameters", "x.yaml"), "--parameters", "a scenario"),
    (("verify", "x.json", "--method", "apf"), "--method", "a scenario"),
    (("verify", CAPTURE, "--seed", "1"), "--seed", "--monte-carlo"),
    (("report", "x.json", "--plans", "3"), "--plans", "bags"),
    (("campaign", "x.yaml", "--out", "o", "--output", "x"), "--output", "campaign report"),
    (("campaign", "x.yaml", "--out", "o", "--plans", "3"), "--plans", "campaign report"),
    (("campaign", "x.yaml", "--out", "o", "--case", "3"), "--case", "campaign report"),
    (("campaign", "report", "x", "--workers", "3"), "--workers", "a study is planned"),
    (("campaign", "report", "x", "--library", "y"), "--library", "a study is planned"),
    (("campaign", "report", "x", "--case", "a", "--plans", "3"), "--plans", "--case"),
    (("campaign", "x.yaml", "--out", "o", "--scheduler", "x", "--dashboard"), "--dashboard", ""),
    (("demo", "whole_capture", "--testbed", "planar"), "--testbed", "whole_capture"),
    (("console", CAPTURE, "--timeout", "3"), "--timeout", "--node"),
    (("ask", "--bring", "state"), "--bring", "a scenario"),
]


@pytest.mark.parametrize(("command", "option", "where"), IN_VAIN)
def test_an_option_that_would_be_ignored_is_refused(
    command, option, where, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    assert main([*map(str, command)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"ff-planner: {option} is ")
    assert where in line
    assert [*tmp_path.iterdir()] == []


def test_the_bag_of_a_plan_holds_question_and_answer(tmp_path):
    directory, file = tmp_path / "bag", tmp_path / "answer.json"
    command = ["plan", str(CAPTURE), "--objective", "length", "--json", str(file)]
    assert main([*command, "--bag", str(directory)]) == 0
    written = json.loads(file.read_text())
    with AnyReader([directory]) as reader:
        messages = {
            (connection.topic, index): reader.deserialize(raw, connection.msgtype)
            for index, (connection, _, raw) in enumerate(reader.messages())
        }
    topics = [topic for topic, _ in messages]
    assert sorted(topics) == [
        *("/exchanges", "/exchanges", "/joint_trajectory", "/markers", "/predicted_chaser_path")
    ]
    found = dict(zip(topics, messages.values(), strict=True))
    points = found["/joint_trajectory"].points
    assert len(points) == 50
    assert [point.effort.tolist() for point in points] == written["joint_torques"]
    (answer,), (request,) = found["/exchanges"].answer, found["/exchanges"].request
    assert answer.status.code == 0
    (metrics,) = answer.metrics
    assert metrics.joint_path_length <= 1.115
    assert metrics.peak_joint_torques.tolist() == written["metrics"]["peak_joint_torques"]
    assert [sphere.id for sphere in request.scene[0].spheres] == ["c1", "c2", "c3"]
    with (directory / "bag_0.mcap").open("rb") as stream:
        reader = make_reader(stream)
        attached = {one.name: one.data for one in reader.iter_attachments()}
        records = {one.name: one.metadata for one in reader.iter_metadata()}
    assert attached["scenario.yaml"] == CAPTURE.read_bytes()
    assert records["ff_planner_ros"]["scipy"] == importlib.metadata.version("scipy")


def test_the_bag_of_a_refusal_holds_question_and_cause_and_no_trajectory(scenario, tmp_path):
    directory = tmp_path / "bag"
    path = scenario(target__position=[9.0, 0.4, 0.6])
    assert main(["plan", str(path), "--bag", str(directory)]) == 3
    with AnyReader([directory]) as reader:
        received, answered = [
            reader.deserialize(raw, connection.msgtype)
            for connection, _, raw in reader.messages()
            if connection.topic == "/exchanges"
        ]
        assert "/joint_trajectory" not in reader.topics
    assert (received.event, answered.event) == ("received", "answered")
    assert received.request[0].goal.pose.pose.position.x == 9.0
    assert answered.answer[0].status.code == 300
    assert answered.answer[0].plans == []


def test_a_bag_that_exists_is_not_overwritten(tmp_path, capsys):
    assert main(["plan", str(CAPTURE), "--objective", "length", "--bag", str(tmp_path)]) == 2
    assert str(tmp_path) in capsys.readouterr().err


def test_robot_shows_the_chain(capsys):
    assert main(["robot", str(LEMUR)]) == 0
    shown = capsys.readouterr().out
    assert "chaser (the chaser" in shown
    assert "end_effector" in shown
    assert shown.count("deg/s") == 7
    assert shown.count(" 80 N m") == 4
    # The mount's and the joints' offsets in the URDF, added up.
    assert re.search(r"end effector +at \[1\.7, 0\.2626, 2\.1156\] m", shown)


def test_robot_locks_joints_as_a_scenario_does(capsys):
    assert main(["robot", str(LEMUR), "--locked-joints", "joint_1: 0.5, joint_2: -0.25"]) == 0
    shown = capsys.readouterr().out
    assert shown.count("deg/s") == 5
    assert "joint_1 at 0.5 rad, joint_2 at -0.25 rad" in " ".join(shown.split())
    assert main(["robot", str(LEMUR), "--locked-joints", "joint_1: 0.5, elbow: 1.0"]) == 2
    assert "robot.locked_joints" in capsys.readouterr().err


def test_robot_tells_where_no_effort_limit_is_known(tmp_path, capsys):
    unknown = tmp_path / "unknown.urdf"
    unknown.write_text(LEMUR.read_text().replace('effort="80.0"', 'effort="0"'))
    assert main(["robot", str(unknown)]) == 0
    assert capsys.readouterr().out.count("any torque") == 4


def test_robot_refuses_a_urdf_by_link(tmp_path, capsys):
    broken = tmp_path / "broken.urdf"
    broken.write_text(LEMUR.read_text().replace('mass value="6.0"', 'mass value="-6.0"'))
    assert broken.read_text() != LEMUR.read_text()
    assert main(["robot", str(broken)]) == 2
    assert "link 'link_3' mass" in capsys.readouterr().err


def test_robot_asks_for_the_tip_where_it_cannot_know_it(tmp_path, capsys):
    forked = tmp_path / "forked.urdf"
    camera = (
        '<link name="camera"/><joint name="camera_mount" type="fixed">'
        '<parent link="{}"/><child link="camera"/></joint></robot>'
    )
    forked.write_text(LEMUR.read_text().replace("</robot>", camera.format("chaser")))
    assert main(["robot", str(forked)]) == 0, "what is fixed to the chaser is no tip"
    assert "end_effector (the end effector)" in capsys.readouterr().out
    forked.write_text(LEMUR.read_text().replace("</robot>", camera.format("link_7")))
    assert main(["robot", str(forked)]) == 2
    assert "camera" in capsys.readouterr().err
    assert main(["robot", str(forked), "--tip-link", "end_effector"]) == 0


def test_planning_needs_no_ros(tmp_path):
    """The commands that do not talk to ROS run where it is not installed."""
    code = (
        "import sys; sys.modules['rclpy'] = sys.modules['ff_planner_msgs'] = None\n"
        "from ff_planner_ros.cli import main\n"
        f"sys.exit(main(['plan', {str(CAPTURE)!r}, '--objective', 'length']))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr


def test_its_commands_plan_with_one_thread_of_linear_algebra_unless_told_otherwise():
    code = "import ff_planner_ros.cli, os; print(os.environ['OPENBLAS_NUM_THREADS'])"
    untold = {name: value for name, value in os.environ.items() if "NUM_THREADS" not in name}
    for told, expected in (({}, "1"), ({"OPENBLAS_NUM_THREADS": "2"}, "2")):
        done = subprocess.run([sys.executable, "-c", code], env=untold | told, capture_output=True)
        assert done.stdout.decode().strip() == expected


def test_the_command_is_installed():
    command = Path(sys.executable).with_name("ff-planner")
    done = subprocess.run([command, "--help"], capture_output=True, text=True, check=True)
    for name in ("demo", "plan", "robot", "verify"):
        assert f"\n    {name}" in done.stdout


# Runs a command where no module of ROS can be imported, and prints what came of it.
WITHOUT_ROS = """
import sys
from importlib.abc import MetaPathFinder

class NoRos(MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        package = name.partition(".")[0]
        if package == "rclpy" or package.endswith(("_msgs", "_srvs", "_interfaces")):
            raise ModuleNotFoundError(name, name=name)

sys.meta_path.insert(0, NoRos())
from ff_planner_ros.cli import main, planner_node
code = main(sys.argv[1:]) if sys.argv[1:] else planner_node()
assert not [name for name in sys.modules if name.startswith("ff_planner_ros.ros.")], sys.modules
sys.exit(code)
"""


def without_ros(*arguments):
    command = [sys.executable, "-c", WITHOUT_ROS, *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


@pytest.mark.nightly
def test_planning_and_verifying_need_no_ros(tmp_path):
    answer = tmp_path / "answer.json"
    planned = without_ros("plan", CAPTURE, "--json", answer)
    assert planned.returncode == 0, planned.stderr
    for arguments in (("verify", answer), ("robot", CONFIG / "robots" / "lemur" / "lemur.urdf")):
        done = without_ros(*arguments)
        assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("arguments", [[], ["plan", CAPTURE, "--bag", "bag"]])
def test_a_command_that_needs_ros_says_so_where_there_is_none(arguments):
    done = without_ros(*arguments)
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert "needs ROS 2" in line
    assert ".[ros]" in line


def test_an_interrupted_command_ends_with_130_and_one_line(monkeypatch, capsys):
    def load(_path):
        raise KeyboardInterrupt

    monkeypatch.setattr("ff_planner_ros.commands.tasks.load_parameters", load)
    assert main(["plan", str(CAPTURE)]) == 130
    assert capsys.readouterr().err == "ff-planner: interrupted\n"


def test_a_defect_is_told_in_one_line_with_its_place(monkeypatch, capsys):
    def load(_path):
        raise ZeroDivisionError("long\x1b[31m" * 1000)

    monkeypatch.setattr("ff_planner_ros.commands.tasks.load_parameters", load)
    assert main(["plan", str(CAPTURE)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "this is a defect of ff-planner, please report it: ZeroDivisionError at tasks" in line
    assert "long?[31m" in line
    assert len(line) <= 1000


def test_the_version_is_told_alone(capsys):
    with pytest.raises(SystemExit) as ended:
        main(["--version"])
    assert ended.value.code == 0
    version = importlib.metadata.version("ff_planner_ros")
    assert capsys.readouterr().out == f"ff-planner {version}\n"
