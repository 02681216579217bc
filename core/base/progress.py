# SPDX-License-Identifier: GPL-3.0-or-later
"""Progress of a run and cancelling, without a parameter that every function passes on.

A public function opens ``with reporting(progress):``; the functions that it calls divide the run
into nested phases, ``with phase(0.2, 0.5, "Tracing flow-lines"):``, and `ask` reports how much of
the phase is done. `parallel.run` and `parallel.blocks` call `ask` by themselves. Only the thread
that opened `reporting` reports. Needs neither numpy nor numba.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from contextvars import ContextVar
from typing import NamedTuple

from ..errors import Cancelled, InvalidSettings

ProgressCallback = Callable[[float, str], bool]


class _Phase(NamedTuple):
    report: Callable[[float, str], None]
    start: float
    stop: float
    message: str


_current: ContextVar[_Phase | None] = ContextVar("shock_filter_phase", default=None)


@contextmanager
def reporting(progress: ProgressCallback | None) -> Iterator[None]:
    """Report the progress of the block to a callback.

    Parameters
    ----------
    progress : callable or None
        ``progress(fraction, message) -> bool``; False cancels the run at once. Its fractions
        never fall. With None, the block reports to the callback of the caller, if any.

    Raises
    ------
    Cancelled
        If the callback cancels; it leaves the block.
    InvalidSettings
        If `progress` cannot be called.
    """
    if progress is None:
        yield
        return
    _check(progress)
    highest = 0.0

    def report(fraction: float, message: str) -> None:
        nonlocal highest
        highest = max(highest, fraction)
        token = _current.set(None)  # runs inside the callback are not part of this run
        try:
            answer = progress(highest, message)
        finally:
            _current.reset(token)
        # "is False" would let numpy's False pass.
        if answer is not None and not answer:
            raise Cancelled("The run was cancelled; nothing was changed.")

    token = _current.set(_Phase(report, 0.0, 1.0, ""))
    try:
        yield
        ask(1.0)
    finally:
        _current.reset(token)


def _check(progress: object) -> None:
    if not callable(progress):
        raise InvalidSettings(
            f"progress is {progress!r}; give a function of a fraction and a message."
        )


@contextmanager
def phase(start: float, stop: float, message: str) -> Iterator[None]:
    """Map the progress of the block to the fractions `start` to `stop` of the enclosing phase.

    Parameters
    ----------
    start, stop : float
        From 0 to 1. If they are equal, the block can be cancelled, but the bar does not move.
    message : str
        What is being done, shown to people.
    """
    outer = _current.get()
    if outer is None:
        yield
        return
    span = outer.stop - outer.start
    inner = _Phase(outer.report, outer.start + start * span, outer.start + stop * span, message)
    token = _current.set(inner)
    try:
        ask()
        yield
    finally:
        _current.reset(token)


def aside(message: str) -> AbstractContextManager[None]:
    """Let a block of little work be cancelled without moving the bar."""
    return phase(0.0, 0.0, message)


def ask(fraction: float = 0.0) -> None:
    """Report how much of the current phase is done; raises `Cancelled` if the callback cancels."""
    current = _current.get()
    if current is not None:
        current.report(current.start + fraction * (current.stop - current.start), current.message)


def part_of(
    progress: ProgressCallback | None, first: float, last: float
) -> ProgressCallback | None:
    """Return a callback that reports to a part of the whole, from `first` to `last`."""
    if progress is None:
        return None
    _check(progress)
    return lambda fraction, message: progress(first + (last - first) * fraction, message)


def one_of(
    progress: ProgressCallback | None, number: int, count: int, message: str
) -> AbstractContextManager[None]:
    """Report the progress of the block as one of `count` steps, for generators.

    While a generator waits it is outside its caller's phase: each step is reported by itself.
    """
    if progress is not None:
        _check(progress)

    def report(fraction: float, _: str) -> bool:
        return progress is None or progress((number + fraction) / count, message)

    return reporting(None if progress is None else report)
