"""The solver in processes of its own."""

from __future__ import annotations

import gc
import math
import operator
import os
import pickle
import random
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, suppress
from dataclasses import replace
from mmap import MAP_ANONYMOUS, MAP_PRIVATE, PAGESIZE, mmap
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from robots import LEMUR_SCENARIO
from ros_processes import DEADLINE

from ff_planner_ros.common.process_environment import PLANNING
from ff_planner_ros.errors import (
    FfPlannerError,
    Interrupted,
    InvalidInput,
    NoPlanFound,
    OutOfTime,
    Status,
)
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.motion.watch import Budget, Progress
from ff_planner_ros.planning.problem.problem import (
    Objective,
    Parametrisation,
    PlanningProblem,
    Target,
)
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.scenario.scenario import load_scenario
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.robot.collision.solids import Solid
from ff_planner_ros.ros.requests import solver as module
from ff_planner_ros.ros.requests import solver_process
from ff_planner_ros.ros.requests.solver import Solver
from ff_planner_ros.ros.requests.solver_process import CANCEL, READY, WORN, rehearsal


@pytest.fixture(scope="module")
def settings() -> PlannerSettings:
    return load_parameters().planner


@pytest.fixture(scope="module")
def solver() -> Iterator[Solver]:
    with pytest.MonkeyPatch.context() as patch:
        for name in PLANNING:
            patch.setenv(name, "2")
        solver = Solver()
    with closing(solver):
        yield solver


@pytest.fixture(scope="module")
def longer(lemur_capture: PlanningProblem) -> PlanningProblem:
    """A plan of it takes so long that its progress is told."""
    return replace(lemur_capture, objective=Objective(0.0, 1.0))


SEED = 20260101
LONG = 600.0  # [s] a budget that no plan uses up


def nothing(*_: Any) -> None:
    """Neither check nor listen."""


def solve(
    solver: Solver,
    problem: PlanningProblem,
    settings: PlannerSettings,
    budget: float = LONG,
    check: Callable[[], None] = nothing,
    report: Callable[[Progress], None] = nothing,
) -> Plan:
    return solver.solve(
        PlanningTask(problem, settings), Budget(budget), time.monotonic(), check, report
    )


def impatient(seconds: float) -> Callable[[], None]:
    """Return a check that fails once nobody would wait any longer."""
    give_up = time.monotonic() + seconds

    def check() -> None:
        assert time.monotonic() < give_up, "nobody answers"

    return check


def processes(solver: Solver) -> list[int]:
    """Process numbers of the two, once both are ready; the first one makes the next plan."""
    wait_until(
        lambda: solver.is_warm and [one.is_ready for one in solver._children] == [True, True]
    )
    return [child._process.pid for child in solver._children]


def wait_until(condition: Callable[[], bool]) -> None:
    give_up = time.monotonic() + DEADLINE
    while not condition():
        assert time.monotonic() < give_up
        time.sleep(0.01)


def kill_both(solver: Solver) -> None:
    """Kill both processes, and wait until the solver could know."""
    both = list(solver._children)
    for child in both:
        os.kill(child._process.pid, signal.SIGKILL)
    wait_until(lambda: all(child.is_lost for child in both))


def wait_for_end(process: int) -> None:
    """Wait until a process has ended; nobody may have asked for its exit code yet."""
    with suppress(FileNotFoundError, ProcessLookupError):
        stat = Path(f"/proc/{process}/stat")
        wait_until(lambda: stat.read_text().rpartition(")")[2].split()[0] == "Z")


def same(one: Plan, other: Plan) -> bool:
    """Whether two plans are equal to the last bit."""
    return one.metrics == other.metrics and all(
        np.array_equal(getattr(one.trajectory, name), getattr(other.trajectory, name))
        for name in vars(one.trajectory)
    )


class Loud:
    """Prints a line where it is unpickled, as a chatty library would."""

    def __reduce__(self) -> tuple[Any, ...]:
        return print, ("a line that is no answer",)


class Heavy:
    """A task whose request is more than a connection takes at once."""

    def __init__(self, task: PlanningTask) -> None:
        self._task = task

    def __reduce__(self) -> tuple[Any, ...]:
        return operator.getitem, ((bytes(2**26), self._task), 1)


class Unlucky(Exception):
    """Somebody has no use for the plan any more."""


def test_a_plan_is_the_same_to_the_last_bit_as_without_it(
    solver: Solver, lemur_capture: PlanningProblem, settings: PlannerSettings
) -> None:
    here = perform(PlanningTask(lemur_capture, settings))
    there = solve(solver, lemur_capture, settings)
    assert same(there, here)
    np.testing.assert_array_equal(there.xi, here.xi)


def test_after_other_plans_of_its_process_a_plan_is_the_same_to_the_last_bit(
    solver: Solver, lemur_capture: PlanningProblem, settings: PlannerSettings
) -> None:
    tumbling = load_scenario(LEMUR_SCENARIO.with_name("lemur_tumbling.yaml"))
    before = processes(solver)
    first = {problem: solve(solver, problem, settings) for problem in (lemur_capture, tumbling)}
    solve(solver, replace(lemur_capture, points=500), settings)
    with pytest.raises(NoPlanFound):
        solve(solver, lemur_capture, settings, 1e-6)
    for problem, plan in first.items():
        assert processes(solver) == before
        assert same(solve(solver, problem, settings), plan)


def test_a_robot_is_built_once_for_all_requests_that_have_it(
    lemur_capture: PlanningProblem, settings: PlannerSettings
) -> None:
    task, budget = PlanningTask(lemur_capture, settings), Budget(LONG)
    one, again = (pickle.loads(module._request(task, budget, 0.0))[0] for _ in range(2))
    assert one.problem.robot is again.problem.robot is not task.problem.robot
    assert one is not again
    assert one.digest == task.digest


def test_the_other_process_is_loaded_once_the_first_is_ready() -> None:
    with closing(Solver()) as solver:
        assert not solver.is_warm
        assert len(solver._children) == 1, "two that load at once take twice as long"
        solver.wait_until_warm()
        assert len(solver._children) == 2


def test_before_the_first_request_the_shortest_and_the_steadiest_are_planned() -> None:
    tasks = rehearsal()
    for task in tasks:
        perform(task)
    problems = [task.problem for task in tasks]
    assert {problem.objective.chaser_attitude for problem in problems} == {0.0, 1.0}
    assert {bool(problem.robot.bodies) for problem in problems} == {False, True}
    assert {problem.parametrisation for problem in problems} == {Parametrisation.AUTO}


@pytest.mark.parametrize("why", ["no task", "no plan"])
def test_where_nothing_is_planned_before_the_first_request_the_process_is_there(
    why: str, monkeypatch: pytest.MonkeyPatch, lemur_capture: PlanningProblem
) -> None:
    def tasks() -> list[PlanningTask]:
        if why == "no task":
            raise InvalidInput(Status.UNSUPPORTED, "robot", "lemur", "any other")
        far = replace(lemur_capture.target, position=np.full(3, 100.0))
        problem = replace(lemur_capture, target=far)
        return [PlanningTask(problem, load_parameters().planner)]

    monkeypatch.setattr(solver_process, "rehearsal", tasks)
    solver_process._rehearse()


@contextmanager
def serving() -> Iterator[Connection]:
    """The node's end of the link of a process that is a thread of this one."""
    ours, theirs = Pipe()
    thread = threading.Thread(target=solver_process.serve, args=[theirs])
    thread.start()
    try:
        with ours:
            yield ours
    finally:
        thread.join()
        theirs.close()
        gc.unfreeze()


def test_a_process_says_that_it_has_made_its_share_of_plans(
    monkeypatch: pytest.MonkeyPatch, lemur_capture: PlanningProblem, settings: PlannerSettings
) -> None:
    monkeypatch.setattr(solver_process, "_MOST_PLANS", 2)
    signs = []
    with serving() as link:
        for _ in range(3):
            signs.append(link.recv())
            link.send((PlanningTask(lemur_capture, settings), Budget(LONG), time.monotonic()))
            while isinstance(answer := link.recv(), Progress):
                pass
            assert isinstance(answer, Plan)
    assert signs == [READY, READY, WORN]


def test_a_process_that_has_grown_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    most = solver_process._MOST_GROWTH
    for grown, sign in ((most, READY), (most + 1, WORN)):
        memory = iter([10**8, 10**8 + grown])
        monkeypatch.setattr(solver_process, "_own_memory", lambda memory=memory: next(memory))
        with serving() as link:
            assert link.recv() == sign


def test_a_process_knows_its_own_memory() -> None:
    """New pages: an object might take what earlier tests left free on the heap."""
    before, size = solver_process._own_memory(), 64 << 20
    with mmap(-1, size, flags=MAP_PRIVATE | MAP_ANONYMOUS) as kept:
        for page in range(0, size, PAGESIZE):
            kept[page] = 1
        grown = solver_process._own_memory() - before
    assert 0.9 * size <= grown <= 1.5 * size


def test_cancellations_that_come_too_late_are_passed_over(
    lemur_capture: PlanningProblem, settings: PlannerSettings
) -> None:
    with serving() as link:
        link.recv()
        for _ in range(3):
            link.send(CANCEL)
        link.send((PlanningTask(lemur_capture, settings), Budget(LONG), time.monotonic()))
        while isinstance(answer := link.recv(), Progress):
            pass
        assert isinstance(answer, Plan)


@pytest.mark.law("NODE-10")
def test_each_search_of_a_sequence_can_be_cancelled() -> None:
    ours, theirs = Pipe()
    with ours, theirs:
        teller = solver_process._Teller(theirs, Budget(LONG), time.monotonic())
        for searches in (3, 2, 1):
            search = teller.share(searches)
            search.require_time()
            ours.send(CANCEL)
            with pytest.raises(OutOfTime, match="cancelled"):
                search.require_time()
            theirs.recv()


def test_a_process_that_has_made_its_share_goes_while_idle_once_the_other_can_take_its_place(
    solver: Solver,
) -> None:
    worn, other = processes(solver)
    for child in solver._children:
        child.is_worn = True
    assert solver.is_warm
    wait_for_end(worn)
    assert solver.is_warm
    assert solver._children[0]._process.pid == other, "it stays until the new one has loaded"
    wait_until(lambda: other not in processes(solver))


@pytest.mark.law("NODE-10")
@pytest.mark.parametrize("how", ["interrupted", "given up"])
def test_a_plan_that_is_not_wanted_ends_and_its_process_makes_others(
    solver: Solver,
    lemur_capture: PlanningProblem,
    longer: PlanningProblem,
    settings: PlannerSettings,
    how: str,
) -> None:
    before = processes(solver)

    def stop(_: Progress) -> None:
        if how == "given up":
            raise Unlucky
        solver.interrupt()

    with pytest.raises((Interrupted, Unlucky)):
        solve(solver, longer, settings, report=stop)
    assert solve(solver, lemur_capture, settings).metrics.min_clearance >= 0.0
    assert processes(solver) == before


def test_no_process_outlives_the_solver() -> None:
    with closing(Solver()) as solver:
        numbers = processes(solver)
    for number in numbers:
        wait_for_end(number)


def test_it_plans_in_the_environment_of_processes_that_plan(solver: Solver) -> None:
    """Several wait for each other where the machine has other work."""
    environment = Path(f"/proc/{processes(solver)[0]}/environ").read_bytes().split(b"\0")
    assert {b"OPENBLAS_NUM_THREADS=1", b"OMP_NUM_THREADS=1"} <= set(environment)
    assert {b"MALLOC_TRIM_THRESHOLD_=67108864", b"MALLOC_MMAP_THRESHOLD_=33554432"} <= set(
        environment
    )


# Prints how many pages the system hands out while as much memory is asked for again and again as a
# search does in its steps.
PAGES = """
from resource import RUSAGE_SELF, getrusage
import numpy as np

def step():
    return sum(float(one[0]) for one in [np.ones(40_000) for _ in range(10)])

step()
before = getrusage(RUSAGE_SELF).ru_minflt
for _ in range(20):
    step()
print(getrusage(RUSAGE_SELF).ru_minflt - before)
"""


def test_processes_that_plan_keep_the_memory_that_they_free() -> None:
    """Without it glibc gives it back in each step: 14,000 pages here."""
    command = [sys.executable, "-c", PAGES]
    done = subprocess.run(command, env=os.environ | PLANNING, capture_output=True, check=True)
    assert int(done.stdout) < 1_000


def test_errors_of_the_planner_come_across_as_they_are(
    solver: Solver, lemur_capture: PlanningProblem, settings: PlannerSettings
) -> None:
    target = Target(np.array([10.0, 0.0, 0.0]), lemur_capture.target.quaternion_xyzw)
    with pytest.raises(NoPlanFound) as too_far:
        solve(solver, replace(lemur_capture, target=target), settings)
    assert too_far.value.status is Status.GOAL_OUT_OF_REACH
    spheres = tuple(
        replace(sphere, shape=Solid("sphere", [5.0])) for sphere in lemur_capture.obstacles
    )
    with pytest.raises(InvalidInput, match="c1") as blocked:
        solve(solver, replace(lemur_capture, obstacles=spheres), settings)
    assert blocked.value.status is Status.START_IN_COLLISION


def test_a_budget_that_is_used_up_ends_the_search_and_nothing_else(
    solver: Solver, lemur_capture: PlanningProblem, settings: PlannerSettings
) -> None:
    with pytest.raises(NoPlanFound, match=r"time budget of 1e-06 s is used up") as end:
        solve(solver, lemur_capture, settings, 1e-6)
    assert end.value.status is Status.TIMED_OUT
    assert solve(solver, lemur_capture, settings).metrics.min_clearance >= 0.0


def test_it_tells_how_far_the_search_has_come(
    solver: Solver, longer: PlanningProblem, settings: PlannerSettings
) -> None:
    reports: list[Progress] = []
    answer = solve(solver, longer, settings, report=reports.append)
    assert reports
    assert {report.phase for report in reports} <= {"searching", "refining", "checking"}
    iterations = [report.iterations for report in reports]
    assert iterations == sorted(iterations)
    assert iterations[-1] <= answer.solver.rollouts


@pytest.mark.ci
def test_a_search_that_does_not_look_at_the_clock_is_ended_with_its_process(
    solver: Solver,
    lemur_capture: PlanningProblem,
    longer: PlanningProblem,
    settings: PlannerSettings,
) -> None:
    """A process that is stopped stands for one in the midst of a long iteration."""
    frozen, other = processes(solver)

    def freeze(_: Progress) -> None:
        os.kill(frozen, signal.SIGSTOP)

    with pytest.raises(NoPlanFound, match=r"\b3 s is used up within a single") as end:
        solve(solver, longer, settings, 3.0, report=freeze)
    assert end.value.status is Status.TIMED_OUT
    assert solve(solver, lemur_capture, settings).metrics.min_clearance >= 0.0
    assert processes(solver)[0] == other
    wait_for_end(frozen)


def test_a_process_that_is_silent_after_a_cancellation_is_left_and_replaced(
    solver: Solver,
    lemur_capture: PlanningProblem,
    longer: PlanningProblem,
    settings: PlannerSettings,
) -> None:
    (first, other), frozen = processes(solver), threading.Event()

    def freeze(_: Progress) -> None:
        os.kill(first, signal.SIGSTOP)
        frozen.set()

    def late() -> None:
        if frozen.is_set():
            raise Unlucky

    with pytest.raises(Unlucky):
        solve(solver, longer, settings, check=late, report=freeze)
    assert [child._process.pid for child in solver._children] == [first, other]
    assert solve(solver, lemur_capture, settings).metrics.min_clearance >= 0.0, "the other makes it"
    assert processes(solver)[0] == other
    wait_for_end(first)


def test_a_request_that_its_process_does_not_read_can_be_given_up(
    solver: Solver, lemur_capture: PlanningProblem, settings: PlannerSettings
) -> None:
    heavy: Any = Heavy(PlanningTask(lemur_capture, settings))
    frozen, looks = processes(solver)[0], iter(range(5))
    os.kill(frozen, signal.SIGSTOP)

    def look() -> None:
        if next(looks, None) is None:
            raise Unlucky

    with pytest.raises(Unlucky):
        solver.solve(heavy, Budget(LONG), time.monotonic(), look, nothing)
    assert solve(solver, lemur_capture, settings).metrics.min_clearance >= 0.0
    assert frozen not in processes(solver)


def test_a_search_is_ended_early_while_its_request_is_still_on_the_way(
    solver: Solver, lemur_capture: PlanningProblem, settings: PlannerSettings
) -> None:
    heavy: Any = Heavy(PlanningTask(lemur_capture, settings))
    with pytest.raises(NoPlanFound, match="cancelled"):
        solver.solve(heavy, Budget(LONG), time.monotonic(), nothing, nothing, lambda: True)


def test_the_budget_runs_from_when_it_is_told_to_have_begun(
    solver: Solver, lemur_capture: PlanningProblem, settings: PlannerSettings
) -> None:
    task, over = PlanningTask(lemur_capture, settings), time.monotonic() - 2 * LONG
    with pytest.raises(NoPlanFound) as end:
        solver.solve(task, Budget(LONG), over, nothing, nothing)
    assert end.value.status is Status.TIMED_OUT


@pytest.mark.law("NODE-10")
def test_given_up_at_any_moment_again_and_again_the_next_plan_is_made(
    solver: Solver,
    lemur_capture: PlanningProblem,
    longer: PlanningProblem,
    settings: PlannerSettings,
    times: Callable[[int, int], int],
) -> None:
    """Moments are numbers of looks at whether the plan is still wanted."""
    wanted, moments = solve(solver, lemur_capture, settings), random.Random(SEED)
    for _ in range(times(30, 300)):
        looks = iter(range(moments.choice([0, 1, 2, 3, 5, 10])))

        def look(looks: Iterator[int] = looks) -> None:
            if next(looks, None) is None:
                raise Unlucky

        with pytest.raises(Unlucky):
            solve(solver, longer, settings, check=look)
        if moments.random() < 0.2:
            assert same(solve(solver, lemur_capture, settings), wanted)
    assert same(solve(solver, lemur_capture, settings), wanted)


@pytest.mark.law("NODE-12")
def test_after_a_death_while_idle_the_other_plans_at_once(
    solver: Solver, lemur_capture: PlanningProblem, settings: PlannerSettings
) -> None:
    """Somebody asks how the solver is before the next plan, or nobody does."""
    for asked in (True, False):
        before, other = processes(solver)
        dead = solver._children[0]
        os.kill(before, signal.SIGKILL)
        wait_until(lambda dead=dead: dead.is_lost)
        if asked:
            assert solver.is_warm
        assert solve(solver, lemur_capture, settings).metrics.min_clearance >= 0.0
        assert solver._children[0]._process.pid == other
    assert not {before, other} >= set(processes(solver))


def test_a_budget_that_ends_while_a_solver_is_loaded_is_answered_then_with_that_cause(
    solver: Solver,
    lemur_capture: PlanningProblem,
    settings: PlannerSettings,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Both have died, and the new one is stopped before it is loaded: no grace can help it."""
    started, start = list[int](), subprocess.Popen
    processes(solver)

    def stopped(*arguments: Any, **options: Any) -> Any:
        process = start(*arguments, **options)
        os.kill(process.pid, signal.SIGSTOP)
        started.append(process.pid)
        return process

    with monkeypatch.context() as patch:
        patch.setattr(module.subprocess, "Popen", stopped)
        patch.setattr(module, "_LEAST_GRACE", math.inf)
        kill_both(solver)
        with pytest.raises(NoPlanFound, match=r"0\.5 s .* while no solver was ready") as end:
            solve(solver, lemur_capture, settings, 0.5, check=impatient(60.0))
    assert end.value.status is Status.TIMED_OUT
    assert "fewer points" not in str(end.value)
    for number in started:
        os.kill(number, signal.SIGCONT)
    assert solve(solver, lemur_capture, settings).metrics.min_clearance >= 0.0


def test_where_both_have_died_another_is_loaded(
    solver: Solver, lemur_capture: PlanningProblem, settings: PlannerSettings
) -> None:
    before = set(processes(solver))
    kill_both(solver)
    assert solve(solver, lemur_capture, settings).metrics.min_clearance >= 0.0
    assert not before & set(processes(solver))


def test_one_that_does_not_load_is_replaced(
    lemur_capture: PlanningProblem, settings: PlannerSettings
) -> None:
    with closing(Solver()) as solver:
        hanging = solver._children[0]._process.pid
        os.kill(hanging, signal.SIGSTOP)
        solver._children[0]._ready_by = time.monotonic()
        assert solve(solver, lemur_capture, settings).metrics.min_clearance >= 0.0
        wait_for_end(hanging)


@pytest.mark.law("NODE-12")
def test_a_plan_whose_process_is_killed_has_a_status_of_its_own_and_the_other_makes_the_next(
    solver: Solver,
    lemur_capture: PlanningProblem,
    longer: PlanningProblem,
    settings: PlannerSettings,
) -> None:
    first, other = processes(solver)

    def kill(_: Progress) -> None:
        with suppress(ProcessLookupError):
            os.kill(first, signal.SIGKILL)

    with pytest.raises(FfPlannerError, match="exit code -9") as death:
        solve(solver, longer, settings, report=kill)
    assert death.value.status is Status.SOLVER_DIED
    assert solve(solver, lemur_capture, settings).metrics.min_clearance >= 0.0
    assert processes(solver)[0] == other


def test_a_plan_is_interrupted_from_another_thread(
    solver: Solver, lemur_capture: PlanningProblem, settings: PlannerSettings
) -> None:
    begun, ended = threading.Event(), []
    long = replace(lemur_capture, points=5000)  # it takes seconds

    def solving() -> None:
        with pytest.raises(Interrupted):
            solve(solver, long, settings, report=lambda _: begun.set())
        ended.append(True)

    thread = threading.Thread(target=solving)
    thread.start()
    assert begun.wait(DEADLINE)
    solver.interrupt()
    thread.join(DEADLINE)
    assert ended
    assert solve(solver, lemur_capture, settings).metrics.min_clearance >= 0.0


def test_an_interruption_when_nothing_is_planned_does_nothing(
    solver: Solver, lemur_capture: PlanningProblem, settings: PlannerSettings
) -> None:
    solver.interrupt()
    assert solve(solver, lemur_capture, settings).metrics.min_clearance >= 0.0


def test_an_interruption_is_heard_from_the_check_on(
    solver: Solver, lemur_capture: PlanningProblem, settings: PlannerSettings
) -> None:
    with pytest.raises(Interrupted):
        solve(solver, lemur_capture, settings, check=solver.interrupt)
    assert solve(solver, lemur_capture, settings).metrics.min_clearance >= 0.0


@pytest.mark.parametrize("where", ["check", "report"])
def test_what_its_callbacks_raise_ends_the_plan(
    solver: Solver,
    lemur_capture: PlanningProblem,
    longer: PlanningProblem,
    settings: PlannerSettings,
    where: str,
) -> None:
    def no_more(*_: Any) -> None:
        raise Unlucky

    with pytest.raises(Unlucky):
        solve(solver, longer, settings, **{where: no_more})
    assert solve(solver, lemur_capture, settings).metrics.min_clearance >= 0.0


def test_an_error_that_nobody_foresaw_is_internal_and_ends_its_process_alone(
    solver: Solver, lemur_capture: PlanningProblem, settings: PlannerSettings
) -> None:
    (first, other), broken = processes(solver), PlanningTask(lemur_capture, settings)
    object.__setattr__(broken, "settings", None)
    with pytest.raises(FfPlannerError, match="the planner failed: AttributeError") as failure:
        solver.solve(broken, Budget(LONG), time.monotonic(), nothing, nothing)
    assert failure.value.status is Status.INTERNAL_ERROR
    wait_for_end(first)
    assert solve(solver, lemur_capture, settings).metrics.min_clearance >= 0.0
    assert processes(solver)[0] == other, "nobody knows what state the first was in"


def test_what_a_library_prints_does_not_garble_the_answers(solver: Solver) -> None:
    with pytest.raises(FfPlannerError, match="task is None: it must be a PlanningTask"):
        solver.solve(Loud(), Budget(LONG), time.monotonic(), nothing, nothing)  # type: ignore[arg-type]


def test_a_closed_worker_says_so(lemur_capture: PlanningProblem, settings: PlannerSettings) -> None:
    solver = Solver()
    solver.close()
    solver.close()
    with pytest.raises(Interrupted):
        solve(solver, lemur_capture, settings)
