"""Planning of cases on a Dask cluster, in packets; packets of workers that died are sent again."""

from __future__ import annotations

import asyncio
import logging
import math
import sys
import threading
import time
from collections import deque
from collections.abc import Generator, Iterator
from concurrent.futures import CancelledError
from contextlib import contextmanager, suppress
from itertools import islice
from typing import Any

import dask
import distributed

from ff_planner_ros.campaign.cases import Case
from ff_planner_ros.campaign.environment import difference, environment
from ff_planner_ros.campaign.work import Outcome, run_cases
from ff_planner_ros.errors import FfPlannerError, InvalidInput, Status

# Cases that are sent at once, at most: what a scheduler costs for each falls, and so does how
# often results come.
_MOST_AT_ONCE = 8
# Packets that wait at the scheduler for each worker, so that none is ever idle.
_WAITING = 2
_DASHBOARD = 8787  # the port that users of Dask look for; only this machine sees it
_AUTHORITY, _OF_ROLE = "tls_ca_file", ("key", "cert")
# How often a packet may be on a worker when that dies, before Dask gives it up.
_DEATHS = 3
_LOOK_AFTER = 5.0  # [s] between two looks at whether workers of this machine are missing
_CONNECT, _RECONNECT, _PAUSE = 10.0, 600.0, 2.0  # [s] first, after a loss, and between attempts
_COUNT_AFTER = 1.0  # [s] between two looks at how many workers there are
_FETCH = 60.0  # [s] a result that is there takes a small part of it
# What asking a scheduler may end in that is not there any more.
_LOST = (OSError, TimeoutError, RuntimeError, CancelledError, asyncio.CancelledError)


@contextmanager
def local_cluster(workers: int | None, dashboard: bool) -> Iterator[str]:
    """Yield the address of a scheduler on this machine with `workers` processes (None: one a core).

    Whoever reaches a port of Dask's may run code as its user, so connections need TLS keys. These
    are made here and kept in memory, in Dask's configuration while the cluster runs.

    Raises:
        FfPlannerError: The processes do not start.
    """
    keys = distributed.Security.temporary()
    told = {"distributed.scheduler.allowed-failures": _DEATHS} | _as_configured(keys)
    if not dashboard:  # a page for everybody on this machine otherwise
        told |= {f"distributed.{kind}.http.routes": [] for kind in ("scheduler", "worker")}
    with dask.config.set(told), _started(workers, dashboard, keys) as cluster:
        if dashboard:
            print(f"dashboard: {cluster.dashboard_link}", file=sys.stderr)
        with _kept_complete(cluster, len(cluster.worker_spec)):
            yield cluster.scheduler_address


@contextmanager
def _kept_complete(cluster: distributed.LocalCluster, workers: int) -> Iterator[None]:
    """Restart workers that died while they started: Dask itself gives these up."""
    ended = threading.Event()

    def keep() -> None:
        while not ended.wait(_LOOK_AFTER):
            cluster.scale(workers)

    keeper = threading.Thread(target=keep, daemon=True)
    keeper.start()
    try:
        yield
    finally:
        ended.set()
        keeper.join()


def _as_configured(keys: distributed.Security) -> dict[str, Any]:
    """Return keys as entries of Dask's configuration, where clients here find them."""
    tls = "distributed.comm.tls"
    found: dict[str, Any] = {f"{tls}.ca-file": getattr(keys, _AUTHORITY)}
    for role in ("client", "scheduler", "worker"):
        found |= {f"{tls}.{role}.{what}": getattr(keys, f"tls_{role}_{what}") for what in _OF_ROLE}
    return found


def _started(
    workers: int | None, dashboard: bool, keys: distributed.Security
) -> distributed.LocalCluster:
    """Return a cluster whose workers run; if one dies at the start, try again."""
    quiet: dict[str, Any] = {"silence_logs": logging.CRITICAL}
    for _ in range(_DEATHS):
        try:
            return distributed.LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                processes=True,
                dashboard_address=f"127.0.0.1:{_DASHBOARD if dashboard else 0}",
                scheduler_kwargs={"dashboard": dashboard},
                security=keys,
                **quiet,
            )
        except (RuntimeError, OSError) as error:
            reason = str(error)
    raise FfPlannerError(Status.UNSUPPORTED, f"the workers on this machine do not start: {reason}")


def outcomes(
    address: str, jobs: Iterator[Case], total: int, workers: int = 1
) -> Iterator[list[Outcome] | Case]:
    """Yield outcomes of cases as they arrive; the case itself if several workers died on it.

    Args:
        address: Address of the scheduler; if the scheduler goes away, it is waited for.
        jobs: Cases, taken as workers become free.
        total: Number of `jobs`.
        workers: Number of workers to wait for before the first case is sent.

    Raises:
        InvalidInput: No scheduler answers, or a worker has other software.
        FfPlannerError: A worker fails on a packet, other than by dying.
    """
    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # what matters is told below
    again: deque[list[Case]] = deque()
    client = _connected(address, _CONNECT)
    try:
        _require_same_software(client, workers)
        while True:
            lost = yield from _on_client(client, jobs, total, again)
            if not lost:
                return
            print(f"ff-planner: note: the scheduler {address} went away", file=sys.stderr)
            _close(client)
            client = _connected(address, _RECONNECT)
    finally:
        _close(client)


def _connected(address: str, patience: float) -> distributed.Client:
    _require_keys(address)
    until = time.monotonic() + patience
    while True:
        try:
            return distributed.Client(
                address, timeout=_CONNECT, set_as_default=False, direct_to_workers=False
            )
        except (OSError, ValueError, TypeError, RuntimeError, ImportError) as error:
            if not isinstance(error, OSError) or time.monotonic() >= until:
                allowed = f"no scheduler answers there within {patience:g} s"
                raise InvalidInput(Status.OUT_OF_RANGE, "--scheduler", address, allowed) from None
        time.sleep(_PAUSE)


def _require_keys(address: str) -> None:
    """Refuse TLS without certificates, which Dask takes from its own configuration."""
    encrypted = bool(dask.config.get("distributed.comm.require-encryption"))
    reason = ""
    if encrypted and not address.startswith("tls://"):
        reason = "Dask's configuration requires encryption: the address must be tls://HOST:PORT"
    elif address.startswith("tls://"):
        try:
            if distributed.Security().get_connection_args("client").get("ssl_context") is None:
                reason = "none is there"
        except (OSError, ValueError, TypeError) as error:  # of ssl: OSErrors
            reason = str(getattr(error, "strerror", None) or error)
        if reason:
            reason = (
                f"TLS needs certificates, distributed.comm.tls of Dask's configuration: {reason}"
            )
    if reason:
        raise InvalidInput(Status.OUT_OF_RANGE, "--scheduler", address, reason)


def _close(client: distributed.Client) -> None:
    with suppress(Exception):  # what has gone away already is closed enough
        client.close(timeout=_PAUSE)


def _require_same_software(client: distributed.Client, workers: int) -> None:
    if len(client.scheduler_info(n_workers=-1)["workers"]) < workers:
        print(f"ff-planner: note: waiting for {workers} workers", file=sys.stderr)
        client.wait_for_workers(workers)
    for worker, found in client.run(difference, environment(), on_error="return").items():
        if isinstance(found, ImportError | AttributeError):
            found = f"it has no ff_planner_ros that can do campaigns ({found})"
        if found:
            raise _other_software(worker, str(found))


def _other_software(worker: str, differs: str) -> InvalidInput:
    allowed = f"its plans could be others: {differs}"
    return InvalidInput(Status.UNSUPPORTED, "worker", worker, allowed)


def _on_client(
    client: distributed.Client, jobs: Iterator[Case], total: int, again: deque[list[Case]]
) -> Generator[list[Outcome] | Case, None, bool]:
    """Yield outcomes until all are there or the scheduler is lost; return whether it is.

    The scheduler may go away at any time: a packet whose result did not come is sent again, and no
    other one is lost or has two results.
    """
    expected = environment()
    running: dict[distributed.Future[Any], list[Case]] = {}
    completed = distributed.as_completed(loop=client.loop, raise_errors=False)
    cores, counted = 1, -math.inf
    while True:
        if time.monotonic() >= counted + _COUNT_AFTER:
            cores, counted = _cores(client), time.monotonic()
        size = max(1, min(_MOST_AT_ONCE, total // (4 * cores)))
        while len(running) < _WAITING * cores + 1:
            packet = again.popleft() if again else list(islice(jobs, size))
            if not packet:
                break
            future = _sent(client, packet, expected)
            if future is None:
                again.appendleft(packet)
                break
            running[future] = packet
            completed.add(future)
        if not running:
            return bool(again)
        future = next(completed)
        result = _result(future, running.pop(future), again)
        if result is not None:
            yield result


def _sent(
    client: distributed.Client, packet: list[Case], expected: dict[str, str]
) -> distributed.Future[Any] | None:
    """Send a packet to be planned; None: nobody is there to take it."""
    if client.status == "running":
        with suppress(*_LOST):
            return client.submit(_on_worker, packet, expected, pure=False)
    return None


def _result(
    future: distributed.Future[Any], packet: list[Case], again: deque[list[Case]]
) -> list[Outcome] | Case | None:
    """Return the result of a packet; None: it is queued again, as a whole or case by case."""
    if future.status == "finished":
        try:
            worker, result = future.result(timeout=_FETCH)
        except _LOST:  # gone with the scheduler, between the two lines above
            again.append(packet)
            return None
        if isinstance(result, str):
            raise _other_software(worker, result)
        return list(result)
    if future.status != "error":  # cancelled or lost: the scheduler is not what it was
        again.append(packet)
        return None
    error = future.exception()
    if not isinstance(error, distributed.KilledWorker):
        raise FfPlannerError(Status.INTERNAL_ERROR, f"a worker cannot plan: {error}")
    if len(packet) == 1:
        return packet[0]
    again.extend([case] for case in packet)
    return None


def _cores(client: distributed.Client) -> int:
    """Return the number of the workers' threads; one if the scheduler does not answer."""
    threads = 0
    with suppress(*_LOST):
        threads = sum(client.nthreads().values())
    return max(1, threads)


def _on_worker(packet: list[Case], expected: dict[str, str]) -> tuple[str, list[Outcome] | str]:
    """Run on a worker: return its address, and its outcomes or how its software differs."""
    return distributed.get_worker().address, run_cases(packet, expected)
