"""A result that is kept with its object is computed once, and goes where the object goes not."""

from __future__ import annotations

import gc
import pickle
import weakref
from dataclasses import dataclass, fields, replace

from ff_planner_ros.core.conversions import chain_of
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.robot.kept_with import kept_with_it


@dataclass(frozen=True, eq=False)
class Owner:
    size: int


COMPUTED: list[int] = []


@kept_with_it
def doubled(owner: Owner) -> list[int]:
    COMPUTED.append(owner.size)
    return [2 * owner.size]


def test_it_is_computed_once_an_object_and_by_name_again_for_a_copy() -> None:
    one, same = Owner(3), Owner(3)
    assert doubled(one) is doubled(one)
    assert doubled(one) is not doubled(same)
    assert doubled(replace(one, size=4)) == [8]
    assert COMPUTED == [3, 3, 4]


def test_it_lives_no_longer_than_its_object() -> None:
    owner = Owner(5)
    doubled(owner)
    gone = weakref.ref(owner)
    del owner
    gc.collect()
    assert gone() is None


def test_a_robot_is_pickled_without_what_is_kept_with_it(lemur_capture: PlanningProblem) -> None:
    robot = replace(lemur_capture.robot)
    plain = len(pickle.dumps(robot))
    chain = chain_of(robot)
    copy = pickle.loads(pickle.dumps(robot))
    assert len(pickle.dumps(robot)) == plain
    assert chain_of(robot) is chain
    assert chain_of(copy) is not chain
    assert vars(copy).keys() >= {field.name for field in fields(robot)}
