"""The command line: the options of each command, and what it does."""

import os

from ff_planner_ros.common.one_thread import ONE_THREAD

SOLVED, BAD_INPUT, NO_PLAN = 0, 2, 3  # exit codes

for _name, _one in ONE_THREAD.items():  # before a command loads the libraries
    os.environ.setdefault(_name, _one)
