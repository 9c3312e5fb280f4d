"""Each command of `ff-planner`: its options, and what it does, which loads what it needs itself."""

import os

from ff_planner_ros.common.one_thread import ONE_THREAD

SOLVED, BAD_INPUT, NO_PLAN = 0, 2, 3  # exit codes

OPTIMAL = "optimal"
METHODS = (OPTIMAL, "straight", "apf")  # of `plan` and `verify`

for _name, _one in ONE_THREAD.items():  # before a command loads the libraries
    os.environ.setdefault(_name, _one)
