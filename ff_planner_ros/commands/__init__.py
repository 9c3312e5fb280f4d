"""What each command of `ff-planner` does; a command that needs ROS imports it itself."""

import os

from ff_planner_ros.one_thread import ONE_THREAD

for _name, _one in ONE_THREAD.items():  # before a command loads the libraries
    os.environ.setdefault(_name, _one)
