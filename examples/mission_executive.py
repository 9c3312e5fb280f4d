"""A mission executive: asks for a plan, checks it, commits it, and watches it come true.

    .venv/bin/python examples/mission_executive.py config/scenarios/lemur_capture.yaml

needs a running planner node and a running testbed (`simulated_testbed.py`). The scenario says what
to request; the planner receives the chaser's state and the obstacles from the testbed.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import rclpy
from builtin_interfaces.msg import Time
from ff_planner_msgs.action import PlanTrajectory
from ff_planner_msgs.msg import PlanAnswer, PlanProgress, PlanRequest
from rclpy.action import ActionClient
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args

from ff_planner_ros.demo.executive import NAME, FlownPlan, MissionExecutive
from ff_planner_ros.demo.mission import ends_of_phases, mission_report, phases_said, run_mission
from ff_planner_ros.errors import NoPlanFound, Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.problem.problem import DurationRange, Objective
from ff_planner_ros.planning.scenario.scenario import SCENARIO_FRAME, Defaults, load_task
from ff_planner_ros.ros.client import PlannerClient
from ff_planner_ros.ros.messages.requests import request_of_task
from ff_planner_ros.ros.outputs.prediction import FramePose

OBJECTIVES = {
    "length": Objective(1.0, 0.0),
    "attitude": Objective(0.0, 1.0),
    "sooner": Objective(1.0, 0.0, 0.02),  # a second is worth 0.02 rad of joint path
}
PATIENCE = 60.0  # [s] for the planner, the testbed and the answer


def main() -> int:
    """Fly a scenario; exit code: 0 done, 2 something could not run, 3 no plan, 130 interrupted."""
    options = _options()
    return run_mission("mission_executive", partial(_fly, options), options.json)


def _fly(options: argparse.Namespace, check: Callable[[], None]) -> dict[str, Any]:
    task = load_task(options.scenario, Defaults(load_parameters().planner))
    problem = task.problem
    if options.objective is not None:
        problem = replace(problem, objective=OBJECTIVES[options.objective])
    if options.durations is not None:
        window = DurationRange(*options.durations)
        problem = replace(problem, duration=window.maximum, duration_range=window)
    with closing(MissionExecutive(check, PATIENCE, sys.argv)) as executive:
        # 1. Ask. The planner predicts the chaser's state at the start time and plans from there. It
        #    does not publish the plan, so that nobody executes what the mission has not checked.
        #    Where the scenario has phases, it plans all of them.
        request = request_of_task(replace(task, problem=problem), SCENARIO_FRAME)
        request.plan_only, request.requester = True, NAME
        request.start_time = Time(sec=options.start)
        request.search.time_budget = PATIENCE  # unless the start is before
        print("asking     the planner, as soon as it is there", flush=True)
        ask = ask_with_rclpy if options.plain else partial(ask_with_client, executive.client)
        answer = executive.plan(request, _say_how_the_search_goes, ask)
        print(f"plan       {answer.plan_id}: {_worth(answer)}", flush=True)
        for number, said in enumerate(phases_said(request, answer), start=1):
            print(f"phase {number}    {said}", flush=True)

        # 2. Check. No plan of the planner violates a limit or touches an obstacle; what only the
        #    mission knows has to be checked here.
        rotation = math.degrees(answer.metrics[0].max_chaser_rotation)
        if rotation > options.max_attitude_deg:
            raise NoPlanFound(
                Status.LIMIT_VIOLATED,
                f"{answer.plan_id} rotates the chaser by {rotation:.1f} deg, this mission allows "
                f"{options.max_attitude_deg:g} deg: try --objective attitude",
            )

        # 3. Commit. The planner publishes the plan by its id, if it still fits the state and the
        #    clock. From here on the controller has it, and nothing moves before its stamp.
        executive.commit(answer)
        print("committed  the controller has it", flush=True)

        # 4. Watch it come true, each phase. Where the planner chose the duration, the answer says
        #    which.
        flown = list[FlownPlan]()
        for seconds in ends_of_phases(answer):
            flown.append(executive.watch(answer, seconds, problem.robot))
            _say_what_was_reached(seconds, flown[-1])
    return mission_report(answer, flown)


def ask_with_client(
    client: PlannerClient,
    request: PlanRequest,
    report: Callable[[PlanProgress], None],
    check: Callable[[], None],
) -> PlanAnswer:
    """Ask by the client that comes with the planner; it cancels what `check` ends by raising."""
    client.wait_for_planner(PATIENCE, check)
    return client.plan(request, report, check)


def ask_with_rclpy(
    request: PlanRequest, report: Callable[[PlanProgress], None], check: Callable[[], None]
) -> PlanAnswer:
    """Ask the same by rclpy alone, as any node can: send, receive and wait in one thread."""
    rclpy.init(args=sys.argv, signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node("mission")
    planner = ActionClient(node, PlanTrajectory, "plan_trajectory_action")

    def answered(future: Any) -> Any:
        while not future.done():
            rclpy.spin_once(node, timeout_sec=0.1)
            check()
        return future.result()

    try:
        planner.wait_for_server()
        goal = PlanTrajectory.Goal(request=request)
        sent = planner.send_goal_async(goal, lambda message: report(message.feedback.progress))
        try:
            answer: PlanAnswer = answered(answered(sent).get_result_async()).result.answer
        except BaseException:  # the plan is not needed any more, even before it is begun
            rclpy.spin_until_future_complete(node, sent, timeout_sec=PATIENCE)
            if sent.done():  # or else the planner is gone
                cancelled = sent.result().cancel_goal_async()
                rclpy.spin_until_future_complete(node, cancelled, timeout_sec=PATIENCE)
            raise
        return answer
    finally:
        planner.destroy()
        node.destroy_node()
        rclpy.shutdown()


def _say_what_was_reached(seconds: float, flown: FlownPlan) -> None:
    print(f"after      {seconds:.3f} s")
    print(f"predicted  end effector at {_words(flown.predicted)}")
    print(f"reached    end effector at {_words(flown.reached)}")
    print(f"deviation  {flown.error.position * 1e3:.2f} mm, {_deg(flown.error.angle)}")
    if flown.capture is not None:
        apart, turned = flown.capture.position_error, flown.capture.orientation_error
        print(f"grasp      {apart * 1e3:.2f} mm, {_deg(turned)} from the end effector")
    worst = f"{flown.worst.position * 1e3:.2f} mm, {_deg(flown.worst.angle)}"
    print(f"chaser     {worst} at worst", flush=True)


def _say_how_the_search_goes(progress: PlanProgress) -> None:
    best = f"objective {progress.best_objective:.4f}" if progress.found else "no path yet"
    print(
        f"{progress.phase:<10} {progress.elapsed:5.2f} s, step {progress.effort}, {best}",
        flush=True,
    )


def _worth(answer: PlanAnswer) -> str:
    (metrics,) = answer.metrics
    return (
        f"joint path {metrics.joint_path_length:.4f} rad, "
        f"rotation of the chaser {_deg(metrics.max_chaser_rotation)}, "
        f"clearance {metrics.min_clearance * 1e3:.1f} mm, {ends_of_phases(answer)[-1]:.3f} s long, "
        f"found in {answer.solver.solve_time:.2f} s"
    )


def _deg(angle: float) -> str:
    return f"{math.degrees(angle):.3f} deg"


def _words(pose: FramePose) -> str:
    x, y, z = pose.position
    qx, qy, qz, qw = pose.rotation.as_quat()
    return f"{x:.4f} {y:.4f} {z:.4f} m, quaternion {qx:.4f} {qy:.4f} {qz:.4f} {qw:.4f}"


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenario", type=Path, metavar="SCENARIO")
    parser.add_argument("--objective", choices=OBJECTIVES, help="instead of the scenario's")
    parser.add_argument(
        "--durations",
        type=float,
        nargs=2,
        metavar=("MIN", "MAX"),
        help="of which the planner chooses [s], instead of the scenario's duration",
    )
    parser.add_argument(
        "--start",
        type=int,
        default=0,
        metavar="SECONDS",
        help="ROS time at which the plan starts (default: as soon as the planner can)",
    )
    parser.add_argument(
        "--max-attitude-deg",
        type=float,
        default=math.inf,
        metavar="DEG",
        help="refuse plans that rotate the chaser further",
    )
    parser.add_argument("--plain", action="store_true", help="ask by rclpy alone")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the result")
    # What follows --ros-args is for ROS, anything else that is not known a slip of the pen.
    return parser.parse_args(remove_ros_args(sys.argv)[1:])


if __name__ == "__main__":
    sys.exit(main())
