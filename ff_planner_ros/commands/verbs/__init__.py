"""The options of each verb of `ff-planner`; what runs it is imported when it runs."""

from argparse import ArgumentParser
from collections.abc import Callable
from typing import TypeAlias

# Given name, function, summary and what else argparse takes, adds a verb and returns its parser.
Add: TypeAlias = Callable[..., ArgumentParser]
