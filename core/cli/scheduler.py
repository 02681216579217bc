# SPDX-License-Identifier: GPL-3.0-or-later
"""The Dask scheduler that hands out the files: one that runs, or one that is started here."""

from __future__ import annotations

import contextlib
import importlib
import logging
import signal
import threading
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
        ``tcp://host:port``, or ``local``: a worker for each core, of one thread each.

    Yields
    ------
    distributed.Client

    Raises
    ------
    ShockError
        Without Dask, or if no scheduler answers in time.
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
        logging.getLogger(name).setLevel(logging.CRITICAL)  # what matters is said here
    with contextlib.ExitStack() as stack:
        place: Any = address
        if address == _LOCAL:
            from ..base.parallel import thread_count

            security = _own_certificate(distributed)
            with _deaf_to_ctrl_c(), _nothing_on_the_web():  # workers are told when to stop
                local = distributed.LocalCluster(
                    n_workers=thread_count(),
                    threads_per_worker=1,
                    memory_limit=None,  # a large file may take what small ones leave
                    host="127.0.0.1",
                    security=security,
                    # With None, older versions of Dask listen for the network.
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
    """Leave out all pages, such as logs and metrics, of Dask's web servers, which ask nobody."""
    import dask

    places = ("distributed.scheduler.http.routes", "distributed.worker.http.routes")
    with dask.config.set({place: [] for place in places}):
        yield


@contextlib.contextmanager
def _deaf_to_ctrl_c() -> Iterator[None]:
    """Keep Ctrl-C, which a terminal sends to all, from threads and processes that start here."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    from multiprocessing import resource_tracker

    resource_tracker.ensure_running()  # or its start would let Ctrl-C in again
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _client(distributed: Any, place: Any) -> Any:
    """Connect in time: for what listens there and is no scheduler, Dask would wait for ever."""
    answers: list[Any] = []

    def connect() -> None:
        try:
            answers.append(distributed.Client(place, timeout=_PATIENCE - 0.5))
        except (OSError, ValueError, TypeError, RuntimeError, ImportError) as error:
            # Nobody there, no such address, no certificate, no library for it: said below.
            answers.append(error)

    thread = threading.Thread(target=connect, daemon=True)
    thread.start()
    thread.join(_PATIENCE)
    answer = answers[0] if answers else "it does not answer"
    if isinstance(answer, str | Exception):
        raise ShockError(
            f"There is no Dask scheduler at {place} ({answer}); start one with dask scheduler, or"
            " use --cluster local."
        )
    return answer
