"""The planner node, and on request the simulated testbed beside it.

ros2 launch ff_planner_ros planner.launch.py parameters:=my_planner.yaml namespace:=chaser_1
ros2 launch ff_planner_ros planner.launch.py testbed:=lemur_capture.yaml
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution, PythonExpression
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare


def generate_launch_description() -> LaunchDescription:
    """Describe what is launched."""
    share = FindPackageShare("ff_planner_ros")
    testbed = LaunchConfiguration("testbed")
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "parameters",
                default_value=PathJoinSubstitution([share, "config", "planner.yaml"]),
                description="Parameter file of the node; one that names some leaves the others",
            ),
            DeclareLaunchArgument(
                "namespace", default_value="", description="In front of every relative topic"
            ),
            DeclareLaunchArgument(
                "use_sim_time", default_value="false", description="Whether /clock is the time"
            ),
            DeclareLaunchArgument(
                "testbed",
                default_value="",
                description="Scenario below config/scenarios that a simulated testbed lives; it "
                "waits for its first plan. Empty: no testbed",
            ),
            Node(
                package="ff_planner_ros",
                executable="planner_node",
                name="ff_planner",
                namespace=LaunchConfiguration("namespace"),
                parameters=[
                    LaunchConfiguration("parameters"),
                    {"use_sim_time": LaunchConfiguration("use_sim_time")},
                ],
                output="screen",
            ),
            ExecuteProcess(
                cmd=[
                    "python3",
                    PathJoinSubstitution([share, "examples", "simulated_testbed.py"]),
                    PathJoinSubstitution([share, "config", "scenarios", testbed]),
                    "--ros-args",
                    "-r",
                    ["__ns:=/", LaunchConfiguration("namespace")],
                    "-p",
                    ["use_sim_time:=", LaunchConfiguration("use_sim_time")],
                ],
                condition=IfCondition(PythonExpression(["'", testbed, "' != ''"])),
                output="screen",
            ),
        ]
    )
