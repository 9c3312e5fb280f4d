"""Types and topics of the events that hold the requests and answers of service and action."""

SERVICE_EVENT = "ff_planner_msgs/srv/PlanTrajectory_Event"
GOAL_EVENT = "ff_planner_msgs/action/PlanTrajectory_SendGoal_Event"
RESULT_EVENT = "ff_planner_msgs/action/PlanTrajectory_GetResult_Event"
PUBLISH_EVENT = "ff_planner_msgs/srv/PublishPlan_Event"
SERVICE_EVENTS = "/_service_event"  # topics, behind the name of the service or action
GOAL_EVENTS = "/_action/send_goal/_service_event"
RESULT_EVENTS = "/_action/get_result/_service_event"
# Of service_msgs/ServiceEventInfo; clients send events of the other kinds.
REQUEST_RECEIVED, RESPONSE_SENT = 1, 2
