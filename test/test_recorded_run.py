"""Bags that do not hold all of a run, or more than one: what can be rebuilt, and why not all."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import robots
import yaml
from answers import answer_of, received, sent
from ff_planner_msgs.msg import Obstacle, ObstacleArray, PlanAnswer, PlanRequest
from nav_msgs.msg import Odometry
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterEvent
from rclpy.parameter import Parameter
from ros_processes import FRAME, Scene
from sensor_msgs.msg import JointState
from shape_msgs.msg import SolidPrimitive
from std_msgs.msg import Header

from ff_planner_ros.bag.mcap.encoding import encode
from ff_planner_ros.bag.provenance import PROVENANCE, provenance
from ff_planner_ros.bag.reader import open_bag
from ff_planner_ros.bag.robot_plans import robot_plans
from ff_planner_ros.bag.writer import BagWriter
from ff_planner_ros.cli import main
from ff_planner_ros.common.times import NANOSECONDS
from ff_planner_ros.errors import BagError, FfPlannerError, InvalidInput, Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.parameters.values import value_of
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.robot.model import robot_from_urdf_text
from ff_planner_ros.ros.inputs.input_topics import MEMORY
from ff_planner_ros.ros.inputs.scene_input import SceneInput
from ff_planner_ros.ros.inputs.state_input import StateInput
from ff_planner_ros.ros.messages.interfaces import type_name
from ff_planner_ros.ros.messages.to_messages import answer_of_error, time_message
from ff_planner_ros.ros.requests.reading import Provenance
from ff_planner_ros.runs.recorded_run import RecordedRun, recorded_run
from ff_planner_ros.runs.replay import Verdict, replay, version_lines

START = 1_700_000_000 * NANOSECONDS
EVENT = "ff_planner_msgs/srv/PlanTrajectory_Event"
EVENTS = "/plan_trajectory/_service_event"
LINKS = {
    "base_link": "chaser",
    "tip_link": "end_effector",
    "base": "free_flyer",
    "geometry": "lines",
    "locked_joints": "",
    "slide_weight": 1.0,
    "wheels": {},
}


class World:
    """Writes what a planner would have recorded."""

    def __init__(self, problem: PlanningProblem, directory: Path) -> None:
        self._scene, self._directory = Scene(problem), directory
        self._messages: list[tuple[str, str, Any, int]] = []
        self._count = 0
        self.attachments = {"robot.urdf": problem.robot.urdf.encode()}
        self.set_parameters({})

    def set_parameters(self, values: dict[str, Any]) -> None:
        document = {"/**": {"ros__parameters": {"robot": LINKS, **values}}}
        self.attachments["parameters.yaml"] = yaml.safe_dump(document).encode()

    def put(self, topic: str, type_name: str, message: Any, at_ns: int) -> None:
        self._messages.append((topic, type_name, message, at_ns))

    def change_parameter(
        self, changed: ParameterMessage, at_ns: int, node: str = "/ff_planner"
    ) -> None:
        event = ParameterEvent(stamp=time_message(at_ns), node=node, changed_parameters=[changed])
        self.put("/parameter_events", "rcl_interfaces/msg/ParameterEvent", event, at_ns)

    def ask(self, at_ns: int, answer: PlanAnswer | None, topic: str = EVENTS) -> PlanRequest:
        """Record a request that brings all with it, a state stamped when it was asked included."""
        request = self._scene.complete_request()
        request.start_state[0].header.stamp = time_message(at_ns)
        self._count += 1
        info = {"stamp": time_message(at_ns), "sequence_number": self._count}
        self.put(topic, EVENT, received(request, **info), at_ns)
        if answer is not None:
            self.put(topic, EVENT, sent(answer, **info), at_ns)
        return request

    def run(self, **record: str) -> RecordedRun:
        with BagWriter(self._directory / "bag", flush_interval=0.0) as bag:
            for name, content in self.attachments.items():
                bag.attach(name, "text/plain", content)
            if record:
                bag.add_record(PROVENANCE, record)
            for topic, kind in {topic: kind for topic, kind, *_ in self._messages}.items():
                bag.add_topic(topic, kind, [])
            for topic, _, message, at_ns in self._messages:
                bag.write(topic, encode(message), at_ns, at_ns)
        with open_bag(self._directory / "bag") as opened:
            return recorded_run(opened)


@pytest.fixture
def world(lemur_capture: PlanningProblem, tmp_path: Path) -> World:
    return World(lemur_capture, tmp_path)


def refused(at_ns: int, plan_id: str = "run.1") -> PlanAnswer:
    answer = answer_of_error(FfPlannerError(Status.NO_STATE, "none"), plan_id, 0.0)
    Provenance(received_stamp_ns=at_ns).tell(answer)
    return answer


def test_a_bag_without_requests_is_refused(
    world: World, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(BagError, match="holds no request to a planner"):
        world.run()
    assert main(["replay", str(tmp_path / "bag")]) == 2
    assert "holds no request to a planner" in capsys.readouterr().err


def test_a_bag_without_parameters_is_refused(world: World) -> None:
    world.ask(START, refused(START))
    del world.attachments["parameters.yaml"]
    with pytest.raises(BagError, match=r"has no parameters\.yaml attached"):
        world.run()


def test_of_two_planners_only_that_whose_parameters_are_there_is_rebuilt(world: World) -> None:
    world.ask(START, refused(START, "one"), "/one/plan_trajectory/_service_event")
    world.ask(START + 1, refused(START + 1, "two"), "/two/plan_trajectory/_service_event")
    run = world.run(node="/two/ff_planner")
    one, two = run.requests
    found = replay(one)
    assert found.verdict is Verdict.NOT_REBUILT
    assert "planners in /one/, /two/, and parameters of one: /two/ff_planner" in found.words
    assert two.inputs is not None


def test_of_two_planners_none_is_rebuilt_where_the_bag_does_not_say_whose_it_is(
    world: World,
) -> None:
    for name in ("one", "two"):
        world.ask(START, refused(START, name), f"/{name}/plan_trajectory/_service_event")
    assert {replay(request).verdict for request in world.run().requests} == {Verdict.NOT_REBUILT}


def test_requests_with_one_plan_id_are_exported_to_a_file_each(
    world: World, tmp_path: Path
) -> None:
    ids = ("a/1", "a_1", "a_1_2", "a_1")
    for number, name in enumerate(ids):
        world.ask(START + number, refused(START + number, name))
    world.run()
    assert main(["export", str(tmp_path / "bag"), "--scenarios", str(tmp_path / "out")]) == 0
    written = sorted(path.name for path in (tmp_path / "out").glob("*.yaml"))
    assert written == ["a_1.yaml", "a_1_2.yaml", "a_1_2_2.yaml", "a_1_3.yaml"]


def test_a_request_without_answer_is_told(world: World) -> None:
    world.ask(START, None)
    (request,) = world.run().requests
    assert (request.name, request.status) == ("request 1", None)
    assert "no answer in the bag" in replay(request).words


def test_an_answer_without_request_is_told(world: World) -> None:
    world.put(EVENTS, EVENT, sent(refused(START)), START)
    (request,) = world.run().requests
    assert replay(request).verdict is Verdict.NOT_REBUILT
    assert "not the request itself" in replay(request).words


def test_a_plan_that_was_followed_and_is_not_in_the_bag_is_named(world: World) -> None:
    answer = refused(START)
    answer.inputs.previous_plan_id = "run.7"
    world.ask(START, answer)
    (request,) = world.run().requests
    assert replay(request).words == "plan run.7, which the joints followed, is not in the bag"


def test_parameters_are_those_of_the_moment_and_of_the_node(world: World) -> None:
    world.set_parameters({"points": 40, "planner": {"starts": 3}, "once": {"upon": 1}})
    changes = (("/ff_planner", 7, 10), ("/another", 9, 20), ("/ff_planner", 8, 30))
    for node, starts, seconds in changes:
        at_ns = START + seconds * NANOSECONDS
        changed = Parameter("planner.starts", value=starts).to_parameter_msg()
        world.change_parameter(changed, at_ns, node)
    for seconds in (5, 10, 25, 31):
        at_ns = START + seconds * NANOSECONDS
        world.ask(at_ns, refused(at_ns))
    run = world.run(node="/ff_planner")
    known = [one.inputs.parameters for one in run.requests if one.inputs is not None]
    assert [one.planner.starts for one in known] == [3, 7, 7, 8]
    assert {(one.points, one.inertial_frame) for one in known} == {(40, FRAME)}
    assert "parameters that this version does not know are left out: once.upon" in run.notes


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("bag.owner_only", True),
        ("planner.starts", 7),
        ("state_max_age", 0.25),
        ("bag.directory", "elsewhere"),
        ("limits.acceleration", (0.5, 0.25)),
    ],
    ids=lambda value: type(value).__name__,
)
def test_a_changed_parameter_of_any_type_is_read(world: World, name: str, value: object) -> None:
    world.set_parameters({})
    changed = Parameter(name, value=value).to_parameter_msg()
    world.change_parameter(changed, START - NANOSECONDS)
    world.ask(START, refused(START))
    (request,) = world.run(node="/ff_planner").requests
    assert request.inputs is not None
    assert value_of(request.inputs.parameters, name) == value


def test_a_changed_parameter_of_no_type_is_refused(world: World) -> None:
    world.set_parameters({})
    changed = Parameter("planner.starts", value=7).to_parameter_msg()
    changed.value.type = 10
    world.change_parameter(changed, START - NANOSECONDS)
    world.ask(START, refused(START))
    with pytest.raises(BagError, match=r"parameter_events: value\.type is 10: .* 0 to 9"):
        world.run(node="/ff_planner")


def test_a_parameter_that_makes_no_sense_is_named(world: World) -> None:
    world.set_parameters({"planner": {"starts": 0}})
    world.ask(START, refused(START))
    with pytest.raises(BagError, match=r"parameters\.yaml: planner\.starts is 0"):
        world.run()


def test_of_several_messages_with_the_stamp_the_last_before_the_request_counts(
    world: World, lemur_capture: PlanningProblem, lemur_plan: Plan
) -> None:
    """As with obstacles that nobody stamps, sent again while the first plan was made."""
    scene = Scene(lemur_capture)
    for at_ns, radius in ((START, 0.1), (START + 10, 0.2), (START + 30, 0.3)):
        obstacles = scene.obstacles()
        obstacles.header.stamp = time_message(START)
        obstacles.spheres[0].radius = radius
        world.put("/obstacles", "ff_planner_msgs/msg/ObstacleSphereArray", obstacles, at_ns)
    answer = answer_of(lemur_plan, start_ns=START + 20)
    Provenance(START + 20, START + 20, "start_state", obstacles_stamp_ns=START).tell(answer)
    world.ask(START + 20, answer).scene = []
    (request,) = world.run().requests
    assert request.read_request().task.problem.obstacles[0].radius == 0.2


@pytest.mark.parametrize("stamp_ns", [START, 0])
def test_a_plan_is_shown_among_the_obstacles_that_its_planner_had_heard(
    world: World, lemur_capture: PlanningProblem, lemur_plan: Plan, tmp_path: Path, stamp_ns: int
) -> None:
    """Of one stamp are what came before and after the request, and what another planner heard."""
    scene = Scene(lemur_capture)
    heard = ((10, 0.1, ""), (20, 0.2, ""), (25, 0.3, "/other"), (35, 0.4, ""), (40, 0.5, "/other"))
    for after_ns, radius, namespace in heard:
        obstacles = scene.obstacles()
        obstacles.header.stamp = time_message(stamp_ns)
        obstacles.spheres[0].radius = radius
        topic, at_ns = f"{namespace}/obstacles", START + after_ns
        world.put(topic, "ff_planner_msgs/msg/ObstacleSphereArray", obstacles, at_ns)
    answer = answer_of(lemur_plan, start_ns=START + 30)
    Provenance(START + 30, START + 30, "start_state", obstacles_stamp_ns=stamp_ns).tell(answer)
    world.ask(START + 30, answer).scene = []
    world.run()
    (shown,) = robot_plans(tmp_path / "bag").scenes.values()
    assert shown.obstacles[0].radius == 0.2


def test_obstacles_that_the_recorder_heard_after_the_node_are_those_of_the_request(
    world: World, lemur_capture: PlanningProblem, lemur_plan: Plan
) -> None:
    """Without a stamp that would tell; whoever publishes them is found by one after the other."""
    obstacles = Scene(lemur_capture).obstacles()
    obstacles.spheres[0].radius = 0.2
    world.put("/obstacles", "ff_planner_msgs/msg/ObstacleSphereArray", obstacles, START + 10)
    answer = answer_of(lemur_plan, start_ns=START)
    Provenance(START, START, "start_state").tell(answer)
    world.ask(START, answer).scene = []
    (request,) = world.run().requests
    assert request.read_request().task.problem.obstacles[0].radius == 0.2


@pytest.mark.parametrize("later", [-10, 10])
def test_obstacle_bodies_count_where_they_were_heard_before_the_request_alone(
    world: World, lemur_capture: PlanningProblem, lemur_plan: Plan, later: int
) -> None:
    """The node plans without them: what comes later was not there yet."""
    obstacles = Scene(lemur_capture).obstacles()
    world.put("/obstacles", "ff_planner_msgs/msg/ObstacleSphereArray", obstacles, START - 20)
    bodies = ObstacleArray(header=Header(frame_id=FRAME), bodies=[_hatch()])
    world.put("/obstacle_bodies", "ff_planner_msgs/msg/ObstacleArray", bodies, START + later)
    answer = answer_of(lemur_plan, start_ns=START)
    Provenance(START, START, "start_state").tell(answer)
    world.ask(START, answer).scene = []
    (request,) = world.run().requests
    found = [one.id for one in request.read_request().task.problem.obstacle_bodies]
    assert found == ([] if later > 0 else ["hatch"])


def _hatch() -> Obstacle:
    body = Obstacle(id="hatch")
    body.primitive = [SolidPrimitive(type=SolidPrimitive.BOX, dimensions=[0.1, 0.2, 0.3])]
    return body


@pytest.mark.parametrize("with_stamp", [True, False])
@pytest.mark.parametrize("offset_ns", [-1, 1])
def test_joint_states_of_a_gripper_with_the_stamp_of_the_arm_s_are_not_taken_for_them(
    world: World, lemur_capture: PlanningProblem, lemur_plan: Plan, offset_ns: int, with_stamp: bool
) -> None:
    """As of two broadcasters of one update cycle; there are more of the gripper's than are kept."""
    world.set_parameters({"state_source": "odometry", "odometry": {"child_frame_id": "imu"}})
    stamp, start = time_message(START), lemur_capture.start
    header = Header(frame_id=FRAME, stamp=stamp)
    odometry = Odometry(header=header, child_frame_id="imu")
    world.put("/odometry", "nav_msgs/msg/Odometry", odometry, START)
    arm = JointState(
        header=Header(stamp=stamp),
        name=list(lemur_capture.robot.joint_names),
        position=start.joint_positions.tolist(),
        velocity=start.joint_velocities.tolist(),
    )
    gripper = JointState(header=Header(stamp=stamp), name=["finger_l", "finger_r"])
    world.put("/joint_states", "sensor_msgs/msg/JointState", arm, START)
    for number in range(MEMORY):
        at_ns = START + offset_ns * (number + 1)
        world.put("/joint_states", "sensor_msgs/msg/JointState", gripper, at_ns)
    asked_ns = START + 2 * MEMORY
    answer = answer_of(lemur_plan, start_ns=asked_ns)
    Provenance(asked_ns, START, "odometry", joint_states_stamp_ns=START if with_stamp else 0).tell(
        answer
    )
    world.ask(asked_ns, answer).start_state = []
    (request,) = world.run().requests
    measured = request.read_request().task.problem.start.joint_positions
    assert measured.tolist() == start.joint_positions.tolist()


def test_a_gripper_s_joint_states_explain_a_refusal_where_there_are_no_other(
    world: World, lemur_capture: PlanningProblem
) -> None:
    world.set_parameters({"state_source": "odometry", "odometry": {"child_frame_id": "imu"}})
    header = Header(frame_id=FRAME, stamp=time_message(START))
    odometry = Odometry(header=header, child_frame_id="imu")
    gripper = JointState(header=header, name=["finger"])
    sensor = replace(load_parameters().odometry, child_frame_id="imu")
    states = StateInput(lemur_capture.robot, FRAME, "odometry", sensor)
    for name, message in (("odometry", odometry), ("joint_states", gripper)):
        world.put(f"/{name}", type_name(type(message)), message, START)
        states.callbacks()[name](message)
    with pytest.raises(InvalidInput, match="finger") as refusal:
        states.snapshot(START, 1.0, 1.0)
    answer = answer_of_error(refusal.value, "run.1", 0.0)
    Provenance(START).tell(answer)
    world.ask(START, answer).start_state = []
    (request,) = world.run().requests
    assert replay(request).verdict is Verdict.IDENTICAL


def test_a_locked_joint_that_was_measured_elsewhere_is_refused_by_a_replay_too(
    world: World,
) -> None:
    """Its joint is a fixed one in the bag."""
    text = robots.LEMUR_URDF.read_text()
    robot = robot_from_urdf_text(text, "chaser", "end_effector", held_at={"joint_1": 0.3})
    odometer = {"state_source": "odometry", "odometry": {"child_frame_id": "imu"}}
    world.set_parameters({**odometer, "locked_joint_tolerance": 0.02})
    world.attachments["robot.urdf"] = robot.drawn_urdf.encode()
    header = Header(frame_id=FRAME, stamp=time_message(START))
    odometry = Odometry(header=header, child_frame_id="imu")
    rest = [0.0] * robot.joints
    arm = JointState(header=header, name=robot.joint_names, position=rest, velocity=rest)
    moved = JointState(header=header, name=["joint_1"], position=[1.2])
    gripper = JointState(header=header, name=["finger"], position=[1.2])
    sensor = replace(load_parameters().odometry, child_frame_id="imu")
    states = StateInput(robot, FRAME, "odometry", sensor)
    heard = [("odometry", odometry), ("joint_states", moved)]
    heard += [("joint_states", gripper)] + [("joint_states", arm)] * MEMORY
    for offset_ns, (name, message) in enumerate(heard):
        world.put(f"/{name}", type_name(type(message)), message, START + offset_ns)
        states.callbacks()[name](message)
    with pytest.raises(InvalidInput, match="joint_1") as refusal:
        states.snapshot(START, 1.0, 1.0, 0.02)
    answer, asked_ns = answer_of_error(refusal.value, "run.1", 0.0), START + 2 * MEMORY
    Provenance(asked_ns).tell(answer)
    world.ask(asked_ns, answer).start_state = []
    (request,) = world.run().requests
    assert replay(request).verdict is Verdict.IDENTICAL


@pytest.mark.parametrize(("since", "before"), [(0.5, ["run.2", "run.1"]), (1.5, ["run.2"])])
def test_plans_that_were_published_for_later_are_known_with_those_followed_until_then(
    world: World, lemur_plan: Plan, since: float, before: list[str]
) -> None:
    """One runs, the second begins a second later and the third two seconds later."""
    for number in (1, 2, 3):
        answer = answer_of(lemur_plan, f"run.{number}", START + (number - 1) * NANOSECONDS)
        Provenance(START, previous_plan_id=f"run.{number - 1}" if number > 1 else "").tell(answer)
        world.ask(START + number, answer)
    asked_ns = START + round(since * NANOSECONDS)
    answer = answer_of(lemur_plan, "run.4", START + 4 * NANOSECONDS)
    Provenance(asked_ns, previous_plan_id="run.3").tell(answer)
    world.ask(asked_ns, answer)
    inputs = world.run().requests[-1].inputs
    assert inputs is not None
    plan = inputs.published
    assert plan is not None
    found = [plan.plan_id]
    while plan.before is not None:
        plan = plan.before
        found.append(plan.plan_id)
    assert found[: len(before) + 1] == ["run.3", *before]


def test_inputs_are_found_whatever_their_topics_are_called(
    world: World, lemur_capture: PlanningProblem, lemur_plan: Plan
) -> None:
    state = Scene(lemur_capture).state(START)
    world.put("/mocap/pose_of_the_chaser", "ff_planner_msgs/msg/ChaserState", state, START)
    answer = answer_of(lemur_plan, start_ns=START)
    Provenance(START, START, "chaser_state").tell(answer)
    world.ask(START, answer).start_state = []
    (request,) = world.run().requests
    measured = request.read_request().task.problem.start.joint_positions
    assert measured.tolist() == lemur_capture.start.joint_positions.tolist()


def test_of_several_topics_that_might_be_the_input_none_is_guessed(
    world: World, lemur_capture: PlanningProblem, lemur_plan: Plan
) -> None:
    for topic in ("/one", "/two"):
        state = Scene(lemur_capture).state(START)
        world.put(topic, "ff_planner_msgs/msg/ChaserState", state, START)
    answer = answer_of(lemur_plan, start_ns=START)
    Provenance(START, START, "chaser_state").tell(answer)
    world.ask(START, answer).start_state = []
    (request,) = world.run().requests
    assert "its topics of this type are /one, /two" in replay(request).words


def test_versions_that_are_others_now_are_named(world: World) -> None:
    world.ask(START, refused(START))
    now = provenance()
    run = world.run(**now | {"numpy": "1.0.0", "host": "elsewhere", "started": "long ago"})
    assert list(version_lines(run)) == [f"version: numpy was 1.0.0, is {now['numpy']}"]


def test_a_refusal_for_what_was_not_heard_yet_comes_again_though_the_recorder_heard_it(
    world: World, lemur_capture: PlanningProblem
) -> None:
    message = Scene(lemur_capture).obstacles()
    world.put("/obstacles", "ff_planner_msgs/msg/ObstacleSphereArray", message, START - 1)
    with pytest.raises(InvalidInput) as refusal:
        SceneInput(FRAME).scene()
    answer = answer_of_error(refusal.value, "run.1", 0.0)
    Provenance(START, START, "start_state").tell(answer)
    world.ask(START, answer).scene = []
    (request,) = world.run().requests
    assert replay(request).verdict is Verdict.IDENTICAL
