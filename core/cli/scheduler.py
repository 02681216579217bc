# SPDX-License-Identifier: GPL-3.0-or-later
"""The Dask scheduler that distributes the files: a running one, or one that is started here."""

from __future__ import annotations

import asyncio
import contextlib
import importlib
import logging
import signal
from collections.abc import Iterator
from typing import Any

from ..errors import ShockError

_LOCAL = "local"
_PATIENCE = 3.5  # seconds for a scheduler to answer


@contextlib.contextmanager
def connected(address: str) -> Iterator[Any]:
    """Connect to the Dask scheduler at an address, or start one here with its workers.

    Parameters
    ----------
    address : str
        ``tcp://host:port``, or ``local``: one worker of one thread for each core.

    Yields
    ------
    distributed.Client

    Raises
    ------
    ShockError
        If Dask is missing, or no scheduler answers in time.
    """
    if not address:
        raise ShockError("--cluster is empty; give tcp://host:port, or local.")
    try:
        distributed = importlib.import_module("distributed")
    except ImportError as error:
        raise ShockError(
            "--cluster needs Dask; run: pip install 'shock-filter[cluster]'."
        ) from error
    for name in ("distributed", "distributed.client"):
        logging.getLogger(name).setLevel(logging.CRITICAL)  # errors are reported here
    with contextlib.ExitStack() as stack:
        place: Any = address
        if address == _LOCAL:
            from ..base.parallel import thread_count

            security = _own_certificate(distributed)
            with _deaf_to_ctrl_c(), _nothing_on_the_web():  # we stop the workers ourselves
                local = distributed.LocalCluster(
                    n_workers=thread_count(),
                    threads_per_worker=1,
                    memory_limit=None,  # a large file may use what small ones leave
                    host="127.0.0.1",
                    security=security,
                    # With None, older versions of Dask listen on the network.
                    dashboard_address="127.0.0.1:0",
                    worker_dashboard_address="127.0.0.1:0",
                    silence_logs=logging.CRITICAL,
                )
            place = stack.enter_context(local)
        yield stack.enter_context(_client(distributed, place))


def _own_certificate(distributed: Any) -> Any:
    """Make a certificate for this run, without which nobody can reach scheduler and workers.

    They listen on this machine only, but all its users could connect there, and run code as us.
    """
    try:
        return distributed.Security.temporary()
    except ImportError as error:
        raise ShockError(
            "--cluster local needs cryptography; run: pip install 'shock-filter[cluster]'."
        ) from error


@contextlib.contextmanager
def _nothing_on_the_web() -> Iterator[None]:
    """Disable all pages of Dask's web servers, such as logs and metrics, which need no login."""
    import dask

    places = ("distributed.scheduler.http.routes", "distributed.worker.http.routes")
    with dask.config.set({place: [] for place in places}):
        yield


@contextlib.contextmanager
def _deaf_to_ctrl_c() -> Iterator[None]:
    """Block Ctrl-C, which a terminal sends to all, in threads and processes that start here."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    from multiprocessing import resource_tracker

    resource_tracker.ensure_running()  # its start would unblock Ctrl-C
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _client(distributed: Any, place: Any) -> Any:
    """Connect to a cluster, or to an address where a scheduler answers.

    Dask's client sets itself as the default of the whole process before it is connected, and one
    that fails late leaves that behind. It would wait for ever for a program that listens and is no
    scheduler. So the address is asked first who is there.
    """
    try:
        if isinstance(place, str) and (who := asyncio.run(_who_answers(place))) != "Scheduler":
            raise ValueError(f"there is a {who}")
        return distributed.Client(place, timeout=_PATIENCE)
    except (OSError, ValueError, TypeError, RuntimeError, ImportError) as error:
        # Nobody there, no such address, no certificate, no library for it.
        raise ShockError(
            f"There is no Dask scheduler at {place} ({error or 'it does not answer'}); start one"
            " with dask scheduler, or use --cluster local."
        ) from error


async def _who_answers(address: str) -> str:
    """Ask an address what kind of Dask's servers it is."""
    from distributed import Security
    from distributed.core import rpc

    certificates = Security().get_connection_args("client")
    async with rpc(address, timeout=_PATIENCE - 0.5, connection_args=certificates) as there:
        about = await asyncio.wait_for(there.identity(), _PATIENCE)
    return about["type"]
