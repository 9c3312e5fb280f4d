"""What to do about each status: the sentences of docs/reference/status_codes.md."""

from __future__ import annotations

from ff_planner_ros.errors import Status

ADVICE = {
    Status.NO_STATE: "Publish `chaser_state`, or `odometry` with `joint_states`, as the parameter "
    "`state_source` says. `/diagnostics` (state) says what has arrived. A publisher with another "
    "quality of service is not heard: compare it with the table of topics.",
    Status.STATE_TOO_OLD: "Look at the publisher's rate and at its clock: stamps are times of "
    "measurement. `/diagnostics` tells the age. Raise `state_max_age` only if your plans may begin "
    "that far from where the system is.",
    Status.STATE_IN_FUTURE: "Synchronise the clocks of publisher and node. `/diagnostics` and "
    "`inputs.state_clock_offset` tell the offset. With simulated time, `state_future_tolerance` "
    "must cover the period of `/clock`.",
    Status.NO_OBSTACLES: "Publish `obstacles`, transient local. An empty scene says that nothing "
    "is in the way.",
    Status.START_IN_COLLISION: "Read which bodies the message names. If they only look like "
    "touching, correct the shape or the obstacle's radius. If they do touch, move the joint that "
    "the message names, or list the pair in `goal.allowed_collisions`.",
    Status.START_OUTSIDE_LIMITS: "Move the joint that the message names back, or slow it down. If "
    "the joint is right, the limit in the URDF is wrong. A joint that the planner has locked must "
    "be where `robot.locked_joints` has it, and at rest: set the parameter to where it is.",
    Status.START_SINGULAR: "Move the arm out of the singular posture: a stretched elbow, two axes "
    "in line. Or ask for `search.parametrisation: joint_spline`, which may begin there.",
    Status.STATE_NOT_SYNCHRONIZED: "Publish `odometry` and `joint_states` with stamps that are at "
    "most `state_synchronization` apart, of each joint.",
    Status.NO_TARGET_BODY: "Publish `target_body`, or bring `target_body` in the request.",
    Status.TARGET_TOO_OLD: "Look at the rate and the clock of the target's publisher. Raise "
    "`target_max_age` only if the body's motion is known that well.",
    Status.TARGET_IN_FUTURE: "Synchronise the clocks of the target's publisher and the node.",
    Status.SEVERAL_PUBLISHERS: "Stop all but one of the publishers that the message names. One "
    "that has crashed is listed until its lease ends (Fast DDS: 20 s). "
    "`allow_several_publishers` lets the newest message count, whoever sent it.",
    Status.NOT_FINITE: "Look for the NaN or infinity in the field that the message names.",
    Status.WRONG_SIZE: "Give the field as many entries as the message says: one a joint, say.",
    Status.BAD_QUATERNION: "Normalise the quaternion. All zeros is no rotation either: identity "
    "is `w: 1`.",
    Status.WRONG_FRAME: "Use the `frame_id` that the parameter `inertial_frame` names (of "
    "`odometry`, also `odometry.child_frame_id`). The node does not transform poses.",
    Status.UNKNOWN_JOINT: "Name every planned joint once. `~/describe` lists them.",
    Status.OUT_OF_RANGE: "Correct the value: the message says what is allowed.",
    Status.UNSUPPORTED: "Leave out the field that the message names: this version does not know "
    "it, or the robot does not have it.",
    Status.BAD_ROBOT: "Run `ff-planner robot FILE`: it lists every fault of the URDF.",
    Status.START_IN_PAST: "Ask for a later `start_time`, or leave it at zero.",
    Status.UNKNOWN_PLAN: "Compare `plan_id` with that of the answer. The "
    "newest 10 plans wait; a deactivated node forgets them. For a plan that is gone, ask again.",
    Status.NO_ACTIVE_PLAN: "Ask again when the published plan has begun, or ask without "
    "`replan_active`.",
    Status.PLAN_ENDING: "Let the running plan end, then ask without `replan_active`.",
    Status.GOAL_OUT_OF_REACH: "Bring the chaser nearer, or move the goal. The message says how far "
    "the goal is and how far the arm reaches.",
    Status.COLLISION: "Read which bodies the message names, and where. A longer duration, another "
    "grasp, a smaller shape or more `planner.starts` may leave room.",
    Status.LIMIT_VIOLATED: "Read which joint or angle exceeds its limit, and by how much. A longer "
    "duration lowers velocities; a weight of the attitude lowers the chaser's rotation.",
    Status.SINGULAR: "Ask for `search.parametrisation: joint_spline`, or for another goal "
    "orientation. If the tool's rotation does not matter, `goal.orientation: ABOUT_AXIS` frees it.",
    Status.CHECK_FAILED: "Read which requirement the check found broken. More `search.points` or a "
    "longer duration usually help. For `~/publish_plan`: the plan is too old; ask for a new "
    "one.",
    Status.TIMED_OUT: "Give the search more time (`search.time_budget`, parameter `time_budget`), "
    "or less to do: fewer points, `search.depth: quick`, a library of plans.",
    Status.TORQUE_TOO_HIGH: "Ask for a longer duration. If the joint is stronger than its effort "
    "limit in the URDF, correct the URDF.",
    Status.TOO_LATE: "Ask for a later `start_time`, or raise `planning_lead_time`. The message "
    "says what took the time.",
    Status.CONTROLLER_CONSTRAINT: "Use `end_behaviour: stop_joints`, or set the controller's "
    "`allow_nonzero_velocity_at_trajectory_end`. The message says which rule the plan breaks.",
    Status.STATE_MOVED: "Ask for a new plan: the system is not where the old one begins. If the "
    "difference is noise, raise the tolerance that the message names (`publication.*`).",
    Status.INTERNAL_ERROR: "Send the same request again. If it fails again, report the bag and "
    "what `ff-planner doctor` prints.",
    Status.SOLVER_DIED: "Send the same request again: a new process is ready. If it dies again, "
    "look at the memory of the machine.",
    Status.BUSY: "Wait for the answer of the other request, or set `when_busy: preempt`.",
    Status.CANCELLED: "Nothing: the client cancelled its goal. `on_cancel: best` would have kept "
    "the best plan found by then.",
    Status.PREEMPTED: "Nothing: a newer request has taken the place of this one. "
    "`when_busy: reject` keeps the first one.",
    Status.NOT_ACTIVE: "Activate the node: `ros2 lifecycle set /ff_planner activate`.",
    Status.SHUT_DOWN: "Start the node again.",
    Status.CLOCK_JUMPED: "Send the request again. A bag that is played in a loop, or a simulator "
    "that is reset, turns the clock back.",
}
