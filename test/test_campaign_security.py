"""A campaign's own cluster takes nobody without the keys of its run."""

import os
import socket
import ssl
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import dask
import distributed
import psutil
import pytest
from campaigns import study

from ff_planner_ros.campaign.cluster import local_cluster
from ff_planner_ros.campaign.run import run_campaign

PATIENCE = 10.0  # [s]
# What a stranger asks for who has read that `Client.run` runs any function.
TOUCHED = "touched_by_a_stranger"
PAGES = ("/", "/info/main/workers.html", "/json/identity.json", "/status", "/metrics", "/health")


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    with local_cluster(1, dashboard=False) as address:
        with distributed.Client(address, timeout=PATIENCE) as client:
            client.wait_for_workers(1)
        yield address


def listening() -> list[tuple[str, int]]:
    """Where this process and its children take connections."""
    here = psutil.Process()
    return [
        (str(one.laddr.ip), int(one.laddr.port))
        for process in (here, *here.children(recursive=True))
        for one in process.net_connections("tcp")
        if one.status == psutil.CONN_LISTEN
    ]


def touch(path: str) -> None:
    Path(path).touch()


@pytest.mark.law("FILE-04")
@pytest.mark.parametrize("keys", ["none", "his own"])
def test_a_stranger_runs_no_code_on_the_cluster(address: str, keys: str, tmp_path: Path) -> None:
    security = distributed.Security(require_encryption=False)
    told = address.replace("tls://", "tcp://")
    if keys == "his own":
        security, told = distributed.Security.temporary(), address
    with pytest.raises(OSError), distributed.Client(told, security=security, timeout=2.0) as client:  # noqa: PT011 (whatever it is, he is not let in)
        client.run_on_scheduler(touch, str(tmp_path / TOUCHED))
    assert not (tmp_path / TOUCHED).exists()


@pytest.mark.law("FILE-04")
@pytest.mark.usefixtures("address")
def test_every_port_of_the_cluster_asks_for_keys_or_tells_nothing() -> None:
    """A port that speaks no TLS is the one of HTTP, which has no pages."""
    found = listening()
    assert len(found) >= 3  # scheduler, nanny, worker
    guarded = 0
    for host, port in found:
        assert host in ("127.0.0.1", "::1")
        pages = [said(host, port, page) for page in PAGES]
        if all(page.startswith(b"HTTP/1.1 404") for page in pages):
            continue
        assert not any(page.startswith(b"HTTP") for page in pages), (port, pages)
        stranger = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
        stranger.check_hostname, stranger.verify_mode = False, ssl.CERT_NONE
        with (
            socket.create_connection((host, port), PATIENCE) as plain,
            pytest.raises(ssl.SSLError, match="CERTIFICATE_REQUIRED"),
            stranger.wrap_socket(plain) as tls,
        ):
            tls.recv(1)  # the server wants a certificate first
        guarded += 1
    assert guarded >= 3


def said(host: str, port: int, page: str) -> bytes:
    """What a port answers to who asks for a page."""
    with socket.create_connection((host, port), PATIENCE) as plain, suppress(ConnectionError):
        plain.sendall(f"GET {page} HTTP/1.0\r\n\r\n".encode())
        return plain.recv(100)
    return b""


def test_keys_are_others_in_each_run_and_gone_after_it() -> None:
    before = dask.config.get("distributed.comm.tls.client.key")
    with local_cluster(1, dashboard=False) as first:
        one = dask.config.get("distributed.comm.tls.client.key")
        assert first.startswith("tls://127.0.0.1:")
    with local_cluster(1, dashboard=False):
        assert dask.config.get("distributed.comm.tls.client.key") != one
    assert dask.config.get("distributed.comm.tls.client.key") == before
    assert not any("PRIVATE KEY" in value for value in os.environ.values())


@pytest.mark.ci
def test_a_campaign_plans_with_keys(tmp_path: Path) -> None:
    asked = study(tmp_path, variations={}, methods=[{"name": "ours"}])
    done = run_campaign(asked, tmp_path / "out", workers=1)
    assert (done.cases, done.rows, done.given_up) == (1, 1, ())
