"""Plan in Python, without ROS: a scenario, then a problem that is built in code."""

from dataclasses import replace
from pathlib import Path

import ff_planner_ros as ff

# The problem of a scenario file, and the default settings of the planner.
scenarios = ff.share_directory() / "config" / "scenarios"
problem = ff.load_scenario(scenarios / "lemur_capture.yaml")
settings = ff.load_parameters().planner

# Plan it, and read the plan as arrays: a row per point, SI units and radians.
task = ff.PlanningTask(problem, settings)
shortest = ff.perform(task)
motion = shortest.trajectory
print(f"{len(motion.time)} points, {shortest.metrics.joint_path_length:.4f} rad of joint path")
print("joints at the goal [rad]:", motion.joint_positions[-1].round(3))
print("chaser at the goal [m]:", motion.chaser_positions[-1].round(3))

# Build a problem in code: one more obstacle, limited joint rates, at most 0.2 rad of rotation.
changed = ff.PlanningProblem(
    robot=problem.robot,
    start=problem.start,
    target=ff.Target(position=[1.7, 0.4, 0.6], quaternion_xyzw=problem.target.quaternion_xyzw),
    duration=10.0,
    points=50,
    obstacles=(
        *problem.obstacles,
        ff.Obstacle.sphere("antenna", center=[1.2, -0.6, 0.3], radius=0.1),
    ),
    objective=ff.Objective(joint_path_length=1.0, chaser_attitude=0.0),
    limits=ff.Limits(joint_velocities=True, chaser_rotation=0.2),
)
steady = ff.perform(replace(task, problem=changed))
for name, plan in (("shortest", shortest), ("steady", steady)):
    print(f"{name}: the chaser rotates by {plan.metrics.max_chaser_rotation:.3f} rad at most")

# What cannot be planned is refused, with the cause and what may help.
try:
    ff.perform(replace(task, problem=replace(problem, duration=0.5)))
except ff.NoPlanFound as error:
    print("no plan in 0.5 s:", error)

# Draw the plan, and execute it in MuJoCo (extra `simulation`).
for picture in ff.plot_plan(problem, shortest, Path("plan_in_python")):
    print(picture)
try:
    print("verified:", ff.simulate_plan(problem.robot, motion).passed)
except ff.FfPlannerError as error:
    print(error)
