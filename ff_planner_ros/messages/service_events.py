"""Types and topics of the service events that carry requests and answers to a bag."""

# As a bag writes them, see `recorded_name`
SERVICE_EVENT = "ff_planner_msgs/msg/PlanTrajectoryEvent"
GOAL_EVENT = "ff_planner_msgs/msg/PlanTrajectorySendGoalEvent"
RESULT_EVENT = "ff_planner_msgs/msg/PlanTrajectoryGetResultEvent"
PUBLISH_EVENT = "ff_planner_msgs/msg/PublishPlanEvent"
SERVICE_EVENTS = "/_service_event"  # topics, behind the name of the service or action
GOAL_EVENTS = "/_action/send_goal/_service_event"
RESULT_EVENTS = "/_action/get_result/_service_event"
# Of service_msgs/ServiceEventInfo; clients send events of the other kinds.
REQUEST_RECEIVED, RESPONSE_SENT = 1, 2


def recorded_name(type_name: str) -> str:
    """Return the type name that a bag records for a ROS type, `package/msg/Name`.

    Parts of a service or an action, `package/srv/Name_Event`, are recorded as the message with the
    same bytes.
    """
    package, _, rest = type_name.partition("/")
    kind, _, name = rest.partition("/")
    return f"{package}/msg/{name.replace('_', '')}" if kind in ("srv", "action") else type_name
