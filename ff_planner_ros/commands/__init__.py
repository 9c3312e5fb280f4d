"""The command line: the options of each command, and what it does."""

import os

from ff_planner_ros.common.process_environment import PLANNING

SOLVED, BAD_INPUT, NO_PLAN, INTERRUPTED = 0, 2, 3, 130  # exit codes
SCENARIOS = (".yaml", ".yml")  # endings of their files

for _name, _one in PLANNING.items():  # before a command loads the libraries
    os.environ.setdefault(_name, _one)
