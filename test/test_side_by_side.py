"""Parts of a search run side by side, and neither its plan nor its steps depend on that.

Each test runs in a process of its own with one thread: another one is not forked.
"""

from __future__ import annotations

import os
import select
import subprocess
import sys
import textwrap
from collections.abc import Callable
from pathlib import Path

import pytest

from ff_planner_ros.common.process_environment import PLANNING
from ff_planner_ros.errors import EndedBy, OutOfTime
from ff_planner_ros.planning.motion.watch import REFINING, Progress, Steps, Watch
from ff_planner_ros.planning.search.candidate import Effort
from ff_planner_ros.planning.search.side_by_side import SideBySide

NEEDS_TWO_CORES = pytest.mark.skipif(
    len(os.sched_getaffinity(0)) < 2, reason="processes share the work of one core by turns"
)
HEAD = """
    import os, signal, threading
    from contextlib import closing
    from ff_planner_ros.planning.optimisation.workers import Workers
    me, (heard, told) = os.getpid(), os.pipe()

    def compute(number):
        global forks
        if os.getpid() != me:
            os.write(told, b".")
        elif forks:
            os.read(heard, 1)  # until a fork has begun a part: it must not come too late
            forks = False
        return number * number, os.getpid()

    def has_forks():
        try:
            os.waitpid(-1, os.WNOHANG)
        except ChildProcessError:
            return False
        return True
"""


def started(code: str, head: str = HEAD) -> subprocess.Popen[str]:
    code = textwrap.dedent(head) + textwrap.dedent(code)
    tests = os.pathsep.join([str(Path(__file__).parent), os.environ.get("PYTHONPATH", "")])
    env = os.environ | PLANNING | {"PYTHONPATH": tests}
    return subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, text=True, env=env
    )


def run_alone(code: str, head: str = HEAD) -> str:
    process = started(code, head)
    try:
        out, _ = process.communicate(timeout=600.0)
    finally:
        process.kill()  # if it hangs
    assert process.returncode == 0
    return out


def is_ready(file: int, within: float) -> bool:
    return bool(select.select([file], [], [], within)[0])


@NEEDS_TWO_CORES
def test_parts_are_shared_and_their_results_in_order_and_nothing_is_left_behind() -> None:
    run_alone("""
        forks = True
        before = len(os.listdir("/proc/self/fd"))
        with closing(Workers(compute, 2)) as workers:
            found = list(workers.results(range(30)))
            assert len({pid for _, pid in found}) == 2
            for again in (found, list(workers.results(range(30)))):
                assert [value for value, _ in again] == [n * n for n in range(30)]
            assert list(workers.results([7])) == [(49, me)]
        assert len(os.listdir("/proc/self/fd")) == before
        assert not has_forks()
    """)


@NEEDS_TWO_CORES
def test_what_a_fork_cannot_do_is_done_without_it() -> None:
    run_alone("""
        forks = True
        def deadly(number):
            value = compute(number)
            if os.getpid() != me:
                os.kill(os.getpid(), signal.SIGKILL)
            return value
        with closing(Workers(deadly, 2)) as workers:
            for _ in range(2):
                assert list(workers.results(range(9))) == [(n * n, me) for n in range(9)]
    """)


def test_an_error_is_raised_as_if_there_were_no_forks() -> None:
    out = run_alone("""
        def impossible(number):
            raise ValueError(f"part {number}")
        try:
            with closing(Workers(impossible, 2)) as workers:
                list(workers.results(range(2)))
        except ValueError as error:
            print(error)
    """)
    assert out.startswith("part ")


def test_a_process_with_threads_is_not_forked() -> None:
    run_alone("""
        forks = False
        waiting = threading.Event()
        threading.Thread(target=waiting.wait, daemon=True).start()
        with closing(Workers(compute, 2)) as workers:
            results = workers.results(range(5))
            assert next(results) == (0, me)
            assert list(results) == [(n * n, me) for n in range(1, 5)]
            assert not has_forks()
    """)


@NEEDS_TWO_CORES
def test_forks_do_not_outlive_the_process_that_they_help() -> None:
    process = started("""
        def slow(number):
            if os.getpid() != me:
                print(os.getpid(), flush=True)
            signal.pause()
        with closing(Workers(slow, 2)) as workers:
            list(workers.results(range(2)))
    """)
    assert process.stdout is not None
    assert is_ready(process.stdout.fileno(), within=60.0), "no fork has begun a part"
    fork = os.pidfd_open(int(process.stdout.readline()))
    assert not is_ready(fork, within=0.0)
    process.kill()
    process.wait()
    assert is_ready(fork, within=60.0)
    process.stdout.close()
    os.close(fork)


SEARCH = """
    import os
    import numpy as np
    from dataclasses import replace
    from ff_planner_ros.errors import NoPlanFound
    from ff_planner_ros.parameters import load_parameters
    from ff_planner_ros.planning.motion.watch import Budget, Watch
    from ff_planner_ros.planning.problem.problem import Objective
    from ff_planner_ros.planning.task.task import PlanningTask, perform
    from ff_planner_ros.problems.scenarios import scenario
    from ff_planner_ros.time_budget import TimeBudget

    SETTINGS = load_parameters().planner

    def drawn(number, robot=None):
        robot = robot or ("lemur", "arm6")[number % 2]
        problem = scenario("ordinary", robot, number, turned=False).problem
        return PlanningTask(replace(problem, objective=Objective(0.0, 1.0)), SETTINGS)

    def answered(task, threads, watch):
        task = replace(task, settings=replace(SETTINGS, threads=threads))
        try:
            return perform(task, watch), None
        except NoPlanFound as refused:
            return None, refused

    def same(one, other):
        return all(
            np.array_equal(getattr(one.trajectory, name), getattr(other.trajectory, name))
            for name in vars(one.trajectory)
        ) and one.solver == other.solver
"""


@pytest.mark.ci
@NEEDS_TWO_CORES
@pytest.mark.law("PLAN-23")
def test_no_plan_depends_on_the_number_of_processes() -> None:
    """Nor do its counts: of two paths that are refined side by side, both exceed torques once."""
    run_alone(
        """
        for task in (drawn(0), drawn(1), drawn(4, "canadarm2")):
            alone, _ = answered(task, 1, Watch())
            before = os.times().children_user
            shared, _ = answered(task, 2, Watch())
            assert os.times().children_user > before, "nothing was shared"
            assert same(alone, shared), task.problem.robot
        """,
        SEARCH,
    )


@pytest.mark.nightly
@NEEDS_TWO_CORES
@pytest.mark.law("NODE-11")
def test_whatever_the_clock_ended_among_parts_the_effort_gives_it_again(
    times: Callable[[int, int], int],
) -> None:
    run_alone(
        f"""
        rng, ended = np.random.default_rng(7), 0
        for number in range({times(30, 60)}):
            task = drawn(number)
            budget = Budget(float(10.0 ** rng.uniform(-1.3, 0.0)))
            found, refused = answered(task, 2, TimeBudget(budget))
            effort = (found or refused).effort
            ended += effort > 0
            for threads in (1, 2):
                again, refused_again = answered(task.ended_at(effort), threads, Watch())
                if found is None:
                    assert again is None, number
                    assert refused_again.effort == effort, number
                    continue
                report = replace(again.solver, stop_reason="", ended_by=None)
                assert report == replace(found.solver, stop_reason="", ended_by=None), number
                assert same(replace(again, solver=found.solver), found), number
                assert again.effort == effort, number
        assert ended
        """,
        SEARCH,
    )


def test_steps_of_parts_count_and_one_of_them_may_be_the_last() -> None:
    """Nothing begins at the last one; a part that would reach it does not count."""

    def compute(part: int, watch: Watch, effort: Effort) -> int:
        for _ in range(part):
            watch.require_time()
        effort.rollouts += part
        return part

    for parts, counted in (([2, 3, 4], 5), ([2, 4, 1], 6), ([7], 0)):
        steps, effort = Steps(Watch(), last=8), Effort()
        steps.require_time()
        values = SideBySide(compute, steps, effort, threads=1).values(parts)
        with pytest.raises(OutOfTime) as end:
            list(values)
        assert (steps.ended_at, end.value.ended_by) == (8, EndedBy.EFFORT)
        assert effort.rollouts == counted


def test_what_ends_a_part_ends_the_search_at_the_step_before_it() -> None:
    steps, reached = Steps(Watch()), OutOfTime("the clock of this test")
    steps.require_time()
    steps.passed(4)
    with pytest.raises(OutOfTime) as end:
        steps.passed(0, reached)
    assert end.value is reached
    assert steps.ended_at == 6
    with pytest.raises(OutOfTime):
        steps.require_time()


def test_a_part_counts_its_steps_and_tells_nobody() -> None:
    class Listening(Watch):
        looks = 0

        def require_time(self, *_: str) -> None:
            self.looks += 1

        def report(self, progress: Progress) -> None:
            raise AssertionError(progress)

    watch = Listening()
    aside = Steps(watch).aside()
    aside.require_time()
    aside.require_time(REFINING)
    progress = Progress(REFINING, 1, 2, 3.0, 0.0)
    aside.report(progress)
    assert (watch.looks, aside.steps, aside.progress) == (2, 2, progress)
