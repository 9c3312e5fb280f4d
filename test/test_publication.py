"""Plans that wait to be published: which go out, which do not any more, and how many wait."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
from changed_parameters import replaced
from ff_planner_msgs.msg import PlanStatus
from ff_planner_msgs.srv import PublishPlan
from heard_inputs import HeardScenes
from ros_processes import FRAME, Scene
from scipy.spatial.transform import Rotation

from ff_planner_ros.common.times import NANOSECONDS, nanoseconds
from ff_planner_ros.errors import FfPlannerError, Status
from ff_planner_ros.parameters import NodeParameters, load_parameters
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.problem.scene import scene_of
from ff_planner_ros.robot.state import SystemState
from ff_planner_ros.ros.inputs.state_input import Snapshot
from ff_planner_ros.ros.messages.to_messages import plan_message
from ff_planner_ros.ros.outputs.exchanges import Exchanges
from ff_planner_ros.ros.outputs.made_plan import MadePlan
from ff_planner_ros.ros.outputs.plan_output import PublishedPlan
from ff_planner_ros.ros.requests.publication import MOST_WAITING, Publication
from ff_planner_ros.ros.requests.reading import Knowledge
from ff_planner_ros.simulation.free_floating import carried_back

NOW = 1_000 * NANOSECONDS
AHEAD = 0.5  # of the plan's start from now [s]
START = NOW + round(AHEAD * NANOSECONDS)


class World:
    """A publication without a node: what it knows can be changed, what it publishes is kept."""

    def __init__(self, problem: PlanningProblem, plan: Plan) -> None:
        self.problem, self.plan, self.now_ns = problem, plan, NOW
        self.parameters: NodeParameters = load_parameters()
        # The plan begins where the scenario does: half a second before, the system was here.
        self.state = carried_back(problem.robot, problem.start, AHEAD)
        self.state_age_ns = 0
        self.output = Mock(published=None)
        node = Mock()
        node.get_clock().now = lambda: SimpleNamespace(nanoseconds=self.now_ns)
        self.exchanges = Mock(spec=Exchanges)
        self.publication = Publication(node, self.output, self.exchanges, self.knowledge)

    def knowledge(self) -> Knowledge:
        states = Mock()
        stamp_ns = self.now_ns - self.state_age_ns
        states.snapshot.return_value = Snapshot(self.state, stamp_ns, "chaser_state")
        published = self.output.published
        scene = HeardScenes()
        return Knowledge(self.problem.robot, self.parameters, states, scene, published, self.now_ns)

    def made(self, plan_id: str = "run.1", start_ns: int = START) -> MadePlan:
        scene = scene_of(self.problem)
        return MadePlan(
            *(plan_id, self.plan, start_ns, "none", self.problem.robot, scene, FRAME),
            made_ns=self.now_ns,
        )

    def ask(self, plan_id: str = "run.1", **fields: Any) -> PlanStatus:
        request = PublishPlan.Request(plan_id=plan_id, **fields)
        return self.publication._serve(request, PublishPlan.Response()).status

    @property
    def told(self) -> list[tuple[str, ...]]:
        """Event, plan id and requester of each exchange."""
        calls = (call.args for call in self.exchanges.tell.call_args_list)
        return [(event, plan_id, requester) for event, plan_id, _, requester in calls]

    @property
    def out(self) -> list[tuple[str, str]]:
        """Ids of what went out, and who asked for it."""
        calls = [call.args for call in self.output.publish.call_args_list]
        return [(made.plan_id, requester) for made, _, requester in calls]


@pytest.fixture
def world(lemur_capture: PlanningProblem, lemur_plan: Plan) -> World:
    world = World(lemur_capture, lemur_plan)
    world.publication.open()
    world.publication.keep(world.made())
    return world


@pytest.mark.law("NODE-08")
def test_a_plan_that_still_fits_goes_out_once_as_it_was_answered(world: World) -> None:
    status = world.ask(requester="flight director")
    assert status.code == Status.SOLVED, status
    assert "run.1" in status.message
    assert "flight director" in status.message
    assert world.out == [("run.1", "flight director")]
    made, written, _ = world.output.publish.call_args.args
    assert made.plan is world.plan
    answered = plan_message(world.plan, START, FRAME)
    assert written.joint_trajectory == answered.joint_trajectory
    again = world.ask()
    assert again.code == Status.UNKNOWN_PLAN
    assert len(world.out) == 1


def test_who_does_not_say_who_asks_is_named_by_the_service(world: World) -> None:
    assert world.ask().code == Status.SOLVED
    assert world.out == [("run.1", "~/publish_plan")]


@pytest.mark.parametrize("plan_id", ["", "run.2", "run.1 ", "RUN.1", "\x00"])
def test_an_unknown_id_is_refused_by_name_and_the_known_ones_are_not_told(
    world: World, plan_id: str
) -> None:
    world.publication.keep(world.made("known.7"))
    status = world.ask(plan_id)
    assert (status.code, status.field) == (Status.UNKNOWN_PLAN, "plan_id")
    assert f"plan_id is {plan_id!r}" in status.message
    assert "known.7" not in f"{status}"
    assert world.out == []


def test_a_plan_that_is_published_already_is_refused_as_such(world: World) -> None:
    world.output.published = PublishedPlan("run.9", world.plan.trajectory, START)
    status = world.ask("run.9")
    assert status.code == Status.UNKNOWN_PLAN
    assert "published already" in status.message


def test_a_plan_whose_start_has_passed_is_refused_and_forgotten(world: World) -> None:
    world.now_ns = START + 1_000_000
    status = world.ask()
    assert (status.code, status.retry) == (Status.TOO_LATE, PlanStatus.RETRY_CHANGED)
    assert "0.001 s ago" in status.message
    world.now_ns = NOW
    assert world.ask().code == Status.UNKNOWN_PLAN
    assert world.out == []


def test_a_plan_whose_start_passes_while_it_is_looked_at_is_refused(world: World) -> None:
    knowledge = world.publication._knowledge

    def slow() -> Knowledge:
        known = knowledge()
        world.now_ns = START + 1
        return known

    world.publication._knowledge = slow
    assert world.ask().code == Status.TOO_LATE
    assert world.out == []


def _moved(name: str, by: Any) -> Callable[[SystemState], SystemState]:
    return lambda state: replace(state, **{name: getattr(state, name) + np.array(by)})


def _turned(angle: float) -> Callable[[SystemState], SystemState]:
    def turned(state: SystemState) -> SystemState:
        attitude = Rotation.from_quat(state.quaternion_chaser_to_inertial_xyzw)
        turn = Rotation.from_rotvec([0.0, angle, 0.0])
        return replace(state, quaternion_chaser_to_inertial_xyzw=(turn * attitude).as_quat())

    return turned


JOINT = np.eye(7)[3]
AWAY = {
    "max_position": lambda off: _moved("position_chaser_in_inertial", [off, 0.0, 0.0]),
    "max_angle": _turned,
    "max_velocity": lambda off: _moved("linear_velocity_chaser_in_inertial", [0.0, off, 0.0]),
    "max_angular_velocity": lambda off: _moved(
        "angular_velocity_chaser_in_inertial", [0.0, 0.0, off]
    ),
    "max_joint_position": lambda off: _moved("joint_positions", off * JOINT),
    "max_joint_velocity": lambda off: _moved("joint_velocities", off * JOINT),
}


@pytest.mark.law("NODE-09")
@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("tolerance", AWAY)
def test_a_plan_goes_out_only_while_the_system_will_be_where_it_begins(
    world: World, tolerance: str, sign: float
) -> None:
    """What is off by this much now is off by as much, and a little more, when the plan begins."""
    most = getattr(world.parameters.tracking, tolerance)
    sound = world.state
    world.state = AWAY[tolerance](1.3 * sign * most)(sound)
    status = world.ask()
    assert status.code == Status.STATE_MOVED, status
    assert f"tracking.{tolerance}, {most:g}" in status.message
    assert "run.1" in status.message
    assert world.out == []
    world.state = AWAY[tolerance](0.7 * sign * most)(sound)
    assert world.ask().code == Status.SOLVED, "it waits on, and goes out as soon as it fits"


def test_nothing_but_the_plans_first_point_says_where_it_begins(world: World) -> None:
    """A system that is where the plan ends has moved, in every quantity that changes on the way."""
    motion = world.plan.trajectory
    world.state = SystemState(
        motion.chaser_positions[-1],
        motion.chaser_quaternions_xyzw[-1],
        motion.chaser_linear_velocities[0],
        motion.chaser_angular_velocities[0],
        motion.joint_positions[-1],
        motion.joint_velocities[0],
    )
    status = world.ask()
    assert status.code == Status.STATE_MOVED
    for name in ("max_position", "max_angle", "max_joint_position"):
        assert f"tracking.{name}" in status.message


def test_a_plan_goes_out_with_all_that_was_made_of_it(world: World) -> None:
    """What it follows, and what screens show of it."""
    made = replace(world.made("run.2"), previous_plan_id="run.1", end_behaviour="stop_joints")
    world.publication.keep(made)
    assert world.ask("run.2").code == Status.SOLVED
    assert world.output.publish.call_args.args[0] is made
    world.output.preview.release.assert_called_once_with(made)
    world.exchanges.afterwards.assert_called_with(world.output.preview.draw)


def waits(world: World) -> str:
    """Id of the plan that screens are told to show as one that waits; empty: none."""
    (shown,) = world.output.preview.let_wait.call_args.args
    return "" if shown is None else str(shown.plan_id)


def test_the_newest_plan_that_waits_is_shown_until_it_is_released(world: World) -> None:
    assert waits(world) == "run.1"
    world.publication.keep(world.made("run.2"))
    assert waits(world) == "run.2"
    assert world.ask("run.2").code == Status.SOLVED
    assert waits(world) == "run.1", "it may still be released"
    assert world.ask().code == Status.SOLVED
    assert waits(world) == ""


def test_a_plan_that_cannot_go_out_any_more_is_not_shown(world: World) -> None:
    world.publication.keep(world.made("run.2", START + 20 * NANOSECONDS))
    world.parameters = replaced(world.parameters, "publication.max_age", 10.0)
    for now_ns, shown in ((START, "run.2"), (NOW + 10 * NANOSECONDS + 1, "")):
        world.now_ns = now_ns
        world.publication.look()
        assert waits(world) == shown
    world.now_ns = NOW
    world.publication.look()
    assert waits(world) == "run.2"
    world.publication.forget()
    assert waits(world) == ""


def test_a_plan_that_is_rejected_is_shown_no_more_and_never_goes_out(world: World) -> None:
    unknown = world.ask("run.7", reject=True)
    assert unknown.code == Status.UNKNOWN_PLAN
    assert waits(world) == "run.1"
    status = world.ask(reject=True, requester="flight director")
    assert status.code == Status.SOLVED
    assert "flight director rejected it" in status.message
    assert waits(world) == ""
    assert world.ask().code == Status.UNKNOWN_PLAN
    assert world.out == []


def test_a_velocity_that_is_a_little_off_counts_for_as_long_as_the_plan_is_ahead(
    lemur_capture: PlanningProblem, lemur_plan: Plan
) -> None:
    """9 mm/s are allowed, but in 4 s they carry the chaser 36 mm away."""
    world = World(lemur_capture, lemur_plan)
    world.publication.open()
    world.publication.keep(world.made(start_ns=NOW + 4 * NANOSECONDS))
    before = carried_back(lemur_capture.robot, lemur_capture.start, 4.0)
    world.state = _moved("linear_velocity_chaser_in_inertial", [0.009, 0.0, 0.0])(before)
    status = world.ask()
    assert status.code == Status.STATE_MOVED
    assert "position by 0.036 m" in status.message
    assert "tracking.max_velocity" not in status.message
    world.state = before
    assert world.ask().code == Status.SOLVED


def test_a_plan_that_joins_one_that_runs_fits_the_states_along_that_one(world: World) -> None:
    """The waiting plan is the rest of one that runs: 4 s of that are over, it begins after 6 s."""
    whole = world.plan.trajectory
    over, begin = np.searchsorted(whole.time, [4.0, 6.0])
    rest = {item.name: getattr(whole, item.name)[begin:] for item in fields(whole)}
    rest["time"] = rest["time"] - whole.time[begin]
    world.state = SystemState(
        whole.chaser_positions[over],
        whole.chaser_quaternions_xyzw[over],
        whole.chaser_linear_velocities[over],
        whole.chaser_angular_velocities[over],
        whole.joint_positions[over],
        whole.joint_velocities[over],
    )
    begun_ns = NOW - round(whole.time[over] * NANOSECONDS)
    start_ns = begun_ns + round(whole.time[begin] * NANOSECONDS)
    waits = replace(
        world.made("run.2", start_ns), plan=replace(world.plan, trajectory=type(whole)(**rest))
    )
    world.publication.keep(waits)
    # If nothing runs, the joints keep their rates, and are elsewhere two seconds later.
    assert world.ask("run.2").code == Status.STATE_MOVED
    world.output.published = PublishedPlan("run.0", whole, begun_ns)
    status = world.ask("run.2")
    assert status.code == Status.SOLVED, status


def test_a_state_that_the_request_brings_goes_before_the_latest(world: World) -> None:
    world.state = _turned(0.5)(world.state)
    assert world.ask().code == Status.STATE_MOVED
    fitting = Scene(world.problem).state(START)
    world.parameters = replace(world.parameters, state_future_tolerance=1.0)
    assert world.ask(start_state=[fitting]).code == Status.SOLVED


def test_a_refusal_names_each_joint_that_is_off_and_by_how_much(world: World) -> None:
    off = np.zeros(7)
    off[[1, 5]] = 0.031, -0.052
    world.state = _moved("joint_positions", off)(world.state)
    status = world.ask()
    assert status.code == Status.STATE_MOVED
    second, sixth = (world.problem.robot.joint_names[joint] for joint in (1, 5))
    assert f"{second}'s position by 0.031 rad, more than tracking.max_joint" in status.message
    assert f"{sixth}'s position by 0.052 rad" in status.message
    assert status.message.count("'s position") == 2


def test_a_continuous_joint_is_where_it_was_a_turn_ago(world: World) -> None:
    """Its encoder may have counted another turn; a joint with limits is elsewhere then."""
    sound, robot = world.state, world.problem.robot
    world.state = _moved("joint_positions", -2.0 * np.pi * JOINT)(sound)
    assert world.ask().code == Status.STATE_MOVED
    endless = replace(robot, continuous=tuple((JOINT > 0.0).tolist()))
    world.problem = replace(world.problem, robot=endless)
    world.state = _moved("joint_positions", (0.03 - 2.0 * np.pi) * JOINT)(sound)
    refused = world.ask()
    assert refused.code == Status.STATE_MOVED
    assert f"{robot.joint_names[3]}'s position by 0.03 rad" in refused.message
    world.state = _moved("joint_positions", -2.0 * np.pi * JOINT)(sound)
    assert world.ask().code == Status.SOLVED


def test_an_old_plan_is_not_published_whatever_its_start(world: World) -> None:
    world.parameters = replaced(world.parameters, "publication.max_age", 0.4)
    world.publication.keep(world.made("run.2", NOW + 60 * NANOSECONDS))
    world.now_ns += round(0.41 * NANOSECONDS)
    status = world.ask("run.2")
    assert (status.code, status.retry) == (Status.CHECK_FAILED, PlanStatus.RETRY_CHANGED)
    assert "run.2 was made 0.41 s ago, longer than publication.max_age, 0.4 s" in status.message


def test_the_newest_plans_wait_and_the_oldest_makes_way(world: World) -> None:
    for number in range(2, MOST_WAITING + 2):
        world.publication.keep(world.made(f"run.{number}"))
    status = world.ask("run.1")
    assert status.code == Status.UNKNOWN_PLAN
    assert f"the newest {MOST_WAITING}," in status.message
    assert world.ask("run.2").code == Status.SOLVED


def test_plans_of_before_a_jump_of_the_clock_or_a_pause_are_forgotten(world: World) -> None:
    world.publication.forget()
    assert world.ask().code == Status.UNKNOWN_PLAN
    world.publication.keep(world.made("run.2"))
    world.publication.close(Status.NOT_ACTIVE, "the planner is not active any more")
    assert world.ask("run.2").code == Status.NOT_ACTIVE
    with pytest.raises(FfPlannerError, match="not active any more"):
        world.publication.keep(world.made("run.3"))
    world.publication.open()
    assert world.ask("run.2").code == Status.UNKNOWN_PLAN
    assert world.out == []


@pytest.mark.parametrize("name", ["two\nlines", "n" * 201])
def test_a_name_that_would_spoil_the_log_is_refused(world: World, name: str) -> None:
    status = world.ask(requester=name)
    assert status.code == Status.OUT_OF_RANGE
    assert "requester is" in status.message
    assert world.out == []


def test_what_nobody_foresaw_is_answered_and_ends_nothing(world: World) -> None:
    world.output.publish.side_effect = ZeroDivisionError("nobody foresaw this")
    status = world.ask()
    assert status.code == Status.INTERNAL_ERROR
    assert status.message == "ZeroDivisionError: nobody foresaw this"
    world.output.publish.side_effect = None
    assert world.ask().code == Status.SOLVED


def test_each_request_to_publish_is_told_with_what_its_answer_was_made_from(world: World) -> None:
    world.output.published = PublishedPlan("run.0", world.plan.trajectory, START)
    world.state_age_ns = NANOSECONDS // 10
    for plan_id in ("run.2", "run.3"):
        world.publication.keep(world.made(plan_id))
    asked = [
        world.ask("run.1", requester="director"),
        world.ask("run.2", reject=True),
        world.ask("run.7"),
    ]
    world.publication.forget()
    assert world.told == [
        *(("received", "run.1", "director"), ("published", "run.1", "director")),
        *(("received", "run.2", "~/publish_plan"), ("rejected", "run.2", "~/publish_plan")),
        *(("received", "run.7", "~/publish_plan"), ("answered", "run.7", "~/publish_plan")),
        ("dropped", "run.3", ""),
    ]
    answers = [call.kwargs["answer"] for call in world.exchanges.tell.call_args_list[1::2]]
    assert [one.status for one in answers] == asked
    inputs = answers[0].inputs
    assert nanoseconds(inputs.received_stamp) == NOW
    assert nanoseconds(inputs.state_stamp) == NOW - world.state_age_ns
    assert (inputs.state_source, inputs.previous_plan_id) == ("chaser_state", "run.0")


def test_a_plan_that_waits_no_longer_is_told_as_dropped(world: World) -> None:
    for number in range(2, MOST_WAITING + 2):
        world.publication.keep(world.made(f"run.{number}"))
    world.now_ns = START + 1
    assert world.ask("run.2").code == Status.TOO_LATE
    dropped = [plan_id for event, plan_id, _ in world.told if event == "dropped"]
    assert dropped == ["run.1", "run.2"]
