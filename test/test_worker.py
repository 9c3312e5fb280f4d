"""The solver in processes of its own."""

from __future__ import annotations

import math
import operator
import os
import random
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from robots import LEMUR_SCENARIO
from ros_processes import DEADLINE

from ff_planner_ros.common.process_environment import PLANNING
from ff_planner_ros.errors import FfPlannerError, Interrupted, InvalidInput, NoPlanFound, Status
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
from ff_planner_ros.ros.requests import solver_process
from ff_planner_ros.ros.requests import worker as module
from ff_planner_ros.ros.requests.solver_process import rehearsal
from ff_planner_ros.ros.requests.worker import Worker


@pytest.fixture(scope="module")
def settings() -> PlannerSettings:
    return load_parameters().planner


@pytest.fixture(scope="module")
def worker() -> Iterator[Worker]:
    with pytest.MonkeyPatch.context() as patch:
        for name in PLANNING:
            patch.setenv(name, "2")
        worker = Worker()
    with closing(worker):
        yield worker


@pytest.fixture(scope="module")
def longer(lemur_capture: PlanningProblem) -> PlanningProblem:
    """A plan of it takes so long that its progress is told."""
    return replace(lemur_capture, objective=Objective(0.0, 1.0))


SEED = 20260101
LONG = 600.0  # [s] a budget that no plan uses up


def nothing(*_: Any) -> None:
    """Neither check nor listen."""


def solve(
    worker: Worker,
    problem: PlanningProblem,
    settings: PlannerSettings,
    budget: float = LONG,
    check: Callable[[], None] = nothing,
    report: Callable[[Progress], None] = nothing,
) -> Plan:
    return worker.solve(
        PlanningTask(problem, settings), Budget(budget), time.monotonic(), check, report
    )


def impatient(seconds: float) -> Callable[[], None]:
    """Return a check that fails once nobody would wait any longer."""
    give_up = time.monotonic() + seconds

    def check() -> None:
        assert time.monotonic() < give_up, "nobody answers"

    return check


def server(worker: Worker) -> int:
    """Process number of the one that everything is loaded in."""
    return worker._servers[0]._process.pid


def spare_of(worker: Worker) -> int:
    """Process number of the one that takes its place, once it has loaded."""
    give_up = time.monotonic() + DEADLINE
    while not (worker.is_warm and len(worker._servers) == 2 and worker._servers[1].is_loaded):
        assert time.monotonic() < give_up
        time.sleep(0.1)
    return worker._servers[1]._process.pid


def children(worker: Worker) -> list[int]:
    """Process numbers of the forks of the one that everything is loaded in."""
    parent = server(worker)
    numbers = Path(f"/proc/{parent}/task/{parent}/children").read_text().split()
    return [int(number) for number in numbers]


def child(worker: Worker) -> int:
    """Process number of the one that makes the plan, or made the last one."""
    (number,) = children(worker)
    return number


def wait_for_end(process: int) -> None:
    """Wait until a process has ended; nobody may have asked for its exit code yet."""
    give_up = time.monotonic() + DEADLINE
    with suppress(FileNotFoundError, ProcessLookupError):
        while Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z":
            assert time.monotonic() < give_up
            time.sleep(0.01)


@pytest.fixture
def fresh(worker: Worker) -> Worker:
    """The worker, when no process has made a plan."""
    worker.wait_until_warm()
    for process in children(worker):
        os.kill(process, signal.SIGKILL)
        wait_for_end(process)
    return worker


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


class Kept:
    """Keeps memory where it is unpickled, as a library that leaks would."""

    def __reduce__(self) -> tuple[Any, ...]:
        return exec, (f"import builtins; builtins.kept = b'x' * {2 * solver_process._MOST_GROWTH}",)


class Leaking:
    """A task that leaves its process with much more memory."""

    def __init__(self, task: PlanningTask) -> None:
        self._task = task

    def __reduce__(self) -> tuple[Any, ...]:
        return operator.getitem, ((Kept(), self._task), 1)


class Unlucky(Exception):
    """Somebody has no use for the plan any more."""


def test_a_plan_is_the_same_to_the_last_bit_as_without_it(
    worker: Worker, lemur_capture: PlanningProblem, settings: PlannerSettings
) -> None:
    here = perform(PlanningTask(lemur_capture, settings))
    there = solve(worker, lemur_capture, settings)
    assert same(there, here)
    np.testing.assert_array_equal(there.xi, here.xi)


def test_after_other_plans_of_its_process_a_plan_is_the_same_to_the_last_bit(
    fresh: Worker, lemur_capture: PlanningProblem, settings: PlannerSettings
) -> None:
    tumbling = load_scenario(LEMUR_SCENARIO.with_name("lemur_tumbling.yaml"))
    first = {problem: solve(fresh, problem, settings) for problem in (lemur_capture, tumbling)}
    process = child(fresh)
    solve(fresh, replace(lemur_capture, points=500), settings)
    with pytest.raises(NoPlanFound):
        solve(fresh, lemur_capture, settings, 1e-6)
    for problem, plan in first.items():
        assert same(solve(fresh, problem, settings), plan)
    assert child(fresh) == process


def test_the_first_plan_is_made_by_a_process_that_has_planned(
    lemur_capture: PlanningProblem, settings: PlannerSettings
) -> None:
    with closing(Worker()) as worker:
        worker.wait_until_warm()
        process = child(worker)
        solve(worker, lemur_capture, settings)
        assert child(worker) == process


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
    process = solver_process._rehearsed()
    assert process.is_fit
    process.end()


def test_a_process_makes_a_bounded_number_of_plans_one_after_another(
    fresh: Worker, lemur_capture: PlanningProblem, settings: PlannerSettings
) -> None:
    solve(fresh, lemur_capture, settings)
    process = child(fresh)
    for _ in range(solver_process._MOST_PLANS - 1):
        assert children(fresh) == [process]
        solve(fresh, lemur_capture, settings)
    wait_for_end(process)
    solve(fresh, lemur_capture, settings)
    assert child(fresh) != process


def test_a_process_that_has_grown_makes_no_other_plan(
    fresh: Worker, lemur_capture: PlanningProblem, settings: PlannerSettings
) -> None:
    leaking: Any = Leaking(PlanningTask(lemur_capture, settings))
    fresh.solve(leaking, Budget(LONG), time.monotonic(), nothing, nothing)
    (process,) = children(fresh) or (None,)
    if process is not None:
        wait_for_end(process)
    solve(fresh, lemur_capture, settings)
    assert child(fresh) != process


@pytest.mark.law("NODE-10")
@pytest.mark.parametrize("how", ["interrupted", "given up"])
def test_a_plan_that_is_not_wanted_takes_its_process_with_it(
    fresh: Worker,
    lemur_capture: PlanningProblem,
    longer: PlanningProblem,
    settings: PlannerSettings,
    how: str,
) -> None:
    solve(fresh, lemur_capture, settings)
    process = child(fresh)

    def stop(_: Progress) -> None:
        assert children(fresh) == [process], "the process of the plan before makes this one"
        if how == "given up":
            raise Unlucky
        fresh.interrupt()

    with pytest.raises((Interrupted, Unlucky)):
        solve(fresh, longer, settings, report=stop)
    wait_for_end(process)
    assert solve(fresh, lemur_capture, settings).metrics.min_clearance >= 0.0
    assert child(fresh) != process


@pytest.mark.law("NODE-12")
def test_where_an_idle_process_has_died_another_makes_the_next_plan(
    fresh: Worker, lemur_capture: PlanningProblem, settings: PlannerSettings
) -> None:
    solve(fresh, lemur_capture, settings)
    process = child(fresh)
    os.kill(process, signal.SIGKILL)
    wait_for_end(process)
    assert solve(fresh, lemur_capture, settings).metrics.min_clearance >= 0.0
    assert child(fresh) != process


def test_an_idle_process_outlives_neither_its_server_nor_the_worker(
    lemur_capture: PlanningProblem, settings: PlannerSettings
) -> None:
    with closing(Worker()) as worker:
        solve(worker, lemur_capture, settings)
        idle = child(worker)
        os.kill(server(worker), signal.SIGKILL)
        wait_for_end(idle)
        solve(worker, lemur_capture, settings)
        idle = child(worker)
    wait_for_end(idle)


def test_it_plans_in_the_environment_of_processes_that_plan(worker: Worker) -> None:
    """Several wait for each other where the machine has other work."""
    environment = Path(f"/proc/{server(worker)}/environ").read_bytes().split(b"\0")
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
    worker: Worker, lemur_capture: PlanningProblem, settings: PlannerSettings
) -> None:
    target = Target(np.array([10.0, 0.0, 0.0]), lemur_capture.target.quaternion_xyzw)
    with pytest.raises(NoPlanFound) as too_far:
        solve(worker, replace(lemur_capture, target=target), settings)
    assert too_far.value.status is Status.GOAL_OUT_OF_REACH
    spheres = tuple(replace(sphere, radius=5.0) for sphere in lemur_capture.obstacles)
    with pytest.raises(InvalidInput, match="c1") as blocked:
        solve(worker, replace(lemur_capture, obstacles=spheres), settings)
    assert blocked.value.status is Status.START_IN_COLLISION


def test_a_budget_that_is_used_up_ends_the_search_and_nothing_else(
    worker: Worker, lemur_capture: PlanningProblem, settings: PlannerSettings
) -> None:
    with pytest.raises(NoPlanFound, match=r"time budget of 1e-06 s is used up") as end:
        solve(worker, lemur_capture, settings, 1e-6)
    assert end.value.status is Status.TIMED_OUT
    assert solve(worker, lemur_capture, settings).metrics.min_clearance >= 0.0


def test_it_tells_how_far_the_search_has_come(
    worker: Worker, longer: PlanningProblem, settings: PlannerSettings
) -> None:
    reports: list[Progress] = []
    answer = solve(worker, longer, settings, report=reports.append)
    assert reports
    assert {report.phase for report in reports} <= {"searching", "refining", "checking"}
    iterations = [report.iterations for report in reports]
    assert iterations == sorted(iterations)
    assert iterations[-1] <= answer.solver.rollouts


@pytest.mark.ci
def test_a_search_that_does_not_look_at_the_clock_is_ended_with_its_process(
    worker: Worker,
    lemur_capture: PlanningProblem,
    longer: PlanningProblem,
    settings: PlannerSettings,
) -> None:
    """A process that is stopped stands for one in the midst of a long iteration."""
    before = server(worker)

    def freeze(_: Progress) -> None:
        os.kill(child(worker), signal.SIGSTOP)

    with pytest.raises(NoPlanFound, match=r"\b3 s is used up within a single") as end:
        solve(worker, longer, settings, 3.0, report=freeze)
    assert end.value.status is Status.TIMED_OUT
    assert solve(worker, lemur_capture, settings).metrics.min_clearance >= 0.0
    assert server(worker) == before, "only the plan's own process had to go"


def test_a_plan_that_is_no_longer_wanted_is_left_though_its_process_says_no_more(
    worker: Worker,
    lemur_capture: PlanningProblem,
    longer: PlanningProblem,
    settings: PlannerSettings,
) -> None:
    before, frozen = server(worker), threading.Event()

    def freeze(_: Progress) -> None:
        os.kill(child(worker), signal.SIGSTOP)
        frozen.set()

    def late() -> None:
        if frozen.is_set():
            raise Unlucky

    with pytest.raises(Unlucky):
        solve(worker, longer, settings, check=late, report=freeze)
    assert solve(worker, lemur_capture, settings).metrics.min_clearance >= 0.0
    assert server(worker) == before, "only the plan's own process had to go"


def test_a_search_is_ended_early_while_its_request_is_still_on_the_way(
    worker: Worker, lemur_capture: PlanningProblem, settings: PlannerSettings
) -> None:
    heavy: Any = Heavy(PlanningTask(lemur_capture, settings))
    with pytest.raises(NoPlanFound, match="cancelled"):
        worker.solve(heavy, Budget(LONG), time.monotonic(), nothing, nothing, lambda: True)


def test_the_budget_runs_from_when_it_is_told_to_have_begun(
    worker: Worker, lemur_capture: PlanningProblem, settings: PlannerSettings
) -> None:
    task, over = PlanningTask(lemur_capture, settings), time.monotonic() - 2 * LONG
    with pytest.raises(NoPlanFound) as end:
        worker.solve(task, Budget(LONG), over, nothing, nothing)
    assert end.value.status is Status.TIMED_OUT


@pytest.mark.law("NODE-10")
def test_given_up_at_any_moment_again_and_again_the_server_stays_and_the_next_plan_is_made(
    worker: Worker,
    lemur_capture: PlanningProblem,
    longer: PlanningProblem,
    settings: PlannerSettings,
    times: Callable[[int, int], int],
) -> None:
    """Moments are numbers of looks at whether the plan is still wanted."""
    solve(worker, lemur_capture, settings)
    before, moments = server(worker), random.Random(SEED)
    for _ in range(times(30, 300)):
        looks = iter(range(moments.choice([0, 1, 2, 3, 5, 10])))

        def look(looks: Iterator[int] = looks) -> None:
            if next(looks, None) is None:
                raise Unlucky

        with pytest.raises(Unlucky):
            solve(worker, longer, settings, check=look)
    assert solve(worker, lemur_capture, settings).metrics.min_clearance >= 0.0
    assert server(worker) == before


@pytest.mark.law("NODE-12")
def test_a_spare_is_kept_loaded_that_plans_at_once_after_a_death_while_idle(
    worker: Worker, lemur_capture: PlanningProblem, settings: PlannerSettings
) -> None:
    """Somebody asks how the solver is before the next plan, or nobody does."""
    for asked in (True, False):
        before, spare = server(worker), spare_of(worker)
        os.kill(before, signal.SIGKILL)
        worker._servers[0]._process.wait()
        if asked:
            assert worker.is_warm
        assert solve(worker, lemur_capture, settings).metrics.min_clearance >= 0.0
        assert server(worker) == spare
    assert spare_of(worker) not in (before, spare)


def test_a_budget_that_ends_while_a_solver_is_loaded_is_answered_then_with_that_cause(
    worker: Worker,
    lemur_capture: PlanningProblem,
    settings: PlannerSettings,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Both have died, and the new one is stopped before it is loaded: no grace can help it."""
    started, start = list[int](), subprocess.Popen
    both = {spare_of(worker), server(worker)}

    def stopped(*arguments: Any, **options: Any) -> Any:
        process = start(*arguments, **options)
        os.kill(process.pid, signal.SIGSTOP)
        started.append(process.pid)
        return process

    with monkeypatch.context() as patch:
        patch.setattr(module.subprocess, "Popen", stopped)
        patch.setattr(module, "_LEAST_GRACE", math.inf)
        for number in both:
            os.kill(number, signal.SIGKILL)
        with pytest.raises(
            NoPlanFound, match=r"0\.5 s .* while a new solver has been loading"
        ) as end:
            solve(worker, lemur_capture, settings, 0.5, check=impatient(60.0))
    assert end.value.status is Status.TIMED_OUT
    assert "fewer points" not in str(end.value)
    for number in started:
        os.kill(number, signal.SIGCONT)
    assert solve(worker, lemur_capture, settings).metrics.min_clearance >= 0.0


def test_where_both_have_died_another_is_loaded(
    worker: Worker, lemur_capture: PlanningProblem, settings: PlannerSettings
) -> None:
    both = {spare_of(worker), server(worker)}
    for number in both:
        os.kill(number, signal.SIGKILL)
    assert solve(worker, lemur_capture, settings).metrics.min_clearance >= 0.0
    assert server(worker) not in both


@pytest.mark.ci
def test_a_server_that_hangs_is_replaced(
    worker: Worker,
    lemur_capture: PlanningProblem,
    settings: PlannerSettings,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(module, "_BEGINNING", 3.0)
    monkeypatch.setattr(module, "_LEAST_GRACE", 0.5)
    solve(worker, lemur_capture, settings)
    before = server(worker)
    os.kill(before, signal.SIGSTOP)
    with pytest.raises(NoPlanFound, match=r"0\.01 s .* before the solver began, which hangs"):
        solve(worker, lemur_capture, settings, 0.01)
    assert solve(worker, lemur_capture, settings).metrics.min_clearance >= 0.0
    assert server(worker) != before


def test_a_plan_whose_process_is_killed_has_a_status_of_its_own(
    worker: Worker,
    lemur_capture: PlanningProblem,
    longer: PlanningProblem,
    settings: PlannerSettings,
) -> None:
    killed: list[int] = []

    def kill(_: Progress) -> None:
        if not killed:
            killed.append(child(worker))
            os.kill(killed[0], signal.SIGKILL)

    with pytest.raises(FfPlannerError, match="exit code -9") as death:
        solve(worker, longer, settings, report=kill)
    assert death.value.status is Status.SOLVER_DIED
    assert solve(worker, lemur_capture, settings).metrics.min_clearance >= 0.0
    assert child(worker) not in killed


def test_a_server_that_is_killed_is_replaced_and_the_plan_is_not_lost(
    worker: Worker,
    lemur_capture: PlanningProblem,
    longer: PlanningProblem,
    settings: PlannerSettings,
) -> None:
    before = server(worker)

    def kill(_: Progress) -> None:
        os.kill(before, signal.SIGKILL)

    assert solve(worker, longer, settings, report=kill).metrics.min_clearance >= 0.0
    assert solve(worker, lemur_capture, settings).metrics.min_clearance >= 0.0
    assert server(worker) != before


@pytest.mark.ci
def test_a_server_that_is_killed_between_two_plans_is_replaced_before_the_next_plan(
    worker: Worker, lemur_capture: PlanningProblem, settings: PlannerSettings
) -> None:
    solve(worker, lemur_capture, settings)
    before = server(worker)
    os.kill(before, signal.SIGKILL)
    assert solve(worker, lemur_capture, settings).metrics.min_clearance >= 0.0
    assert server(worker) != before


def test_a_plan_is_interrupted_from_another_thread(
    worker: Worker, lemur_capture: PlanningProblem, settings: PlannerSettings
) -> None:
    before, begun, ended = server(worker), threading.Event(), []
    long = replace(lemur_capture, points=5000)  # it takes seconds

    def solving() -> None:
        with pytest.raises(Interrupted):
            solve(worker, long, settings, report=lambda _: begun.set())
        ended.append(True)

    thread = threading.Thread(target=solving)
    thread.start()
    assert begun.wait(DEADLINE)
    worker.interrupt()
    thread.join(DEADLINE)
    assert ended
    assert solve(worker, lemur_capture, settings).metrics.min_clearance >= 0.0
    assert server(worker) == before, "only the plan's own process had to go"


def test_an_interruption_when_nothing_is_planned_does_nothing(
    worker: Worker, lemur_capture: PlanningProblem, settings: PlannerSettings
) -> None:
    worker.interrupt()
    assert solve(worker, lemur_capture, settings).metrics.min_clearance >= 0.0


def test_an_interruption_is_heard_from_the_check_on(
    worker: Worker, lemur_capture: PlanningProblem, settings: PlannerSettings
) -> None:
    with pytest.raises(Interrupted):
        solve(worker, lemur_capture, settings, check=worker.interrupt)
    assert solve(worker, lemur_capture, settings).metrics.min_clearance >= 0.0


@pytest.mark.parametrize("where", ["check", "report"])
def test_what_its_callbacks_raise_ends_the_plan(
    worker: Worker,
    lemur_capture: PlanningProblem,
    longer: PlanningProblem,
    settings: PlannerSettings,
    where: str,
) -> None:
    def no_more(*_: Any) -> None:
        raise Unlucky

    with pytest.raises(Unlucky):
        solve(worker, longer, settings, **{where: no_more})
    assert solve(worker, lemur_capture, settings).metrics.min_clearance >= 0.0


def test_an_error_that_nobody_foresaw_is_internal_and_ends_its_process_alone(
    fresh: Worker, lemur_capture: PlanningProblem, settings: PlannerSettings
) -> None:
    solve(fresh, lemur_capture, settings)
    process, broken = child(fresh), PlanningTask(lemur_capture, settings)
    object.__setattr__(broken, "settings", None)
    with pytest.raises(FfPlannerError, match="the planner failed: AttributeError") as failure:
        fresh.solve(broken, Budget(LONG), time.monotonic(), nothing, nothing)
    assert failure.value.status is Status.INTERNAL_ERROR
    assert solve(fresh, lemur_capture, settings).metrics.min_clearance >= 0.0
    assert child(fresh) != process, "nobody knows what state it was in"


def test_what_a_library_prints_does_not_garble_the_answers(worker: Worker) -> None:
    with pytest.raises(FfPlannerError, match="task is None: it must be a PlanningTask"):
        worker.solve(Loud(), Budget(LONG), time.monotonic(), nothing, nothing)  # type: ignore[arg-type]


def test_a_closed_worker_says_so(lemur_capture: PlanningProblem, settings: PlannerSettings) -> None:
    worker = Worker()
    worker.close()
    worker.close()
    with pytest.raises(Interrupted):
        solve(worker, lemur_capture, settings)
