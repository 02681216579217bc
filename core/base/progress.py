# SPDX-License-Identifier: GPL-3.0-or-later
"""Progress of a run and canceling, without a parameter that every function hands on.

A public function opens ``with reporting(progress):``; what it calls divides the run into phases by
``with phase(0.2, 0.5, "Tracing flow-lines"):``, which nest; and `ask` tells how much of the phase
is done. `parallel.run` and `parallel.blocks` ask by themselves. Only the thread that opened
`reporting` reports. Needs neither numpy nor numba.
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
    """Report what happens in the block to a callback.

    Parameters
    ----------
    progress : callable or None
        ``progress(fraction, message) -> bool``; False cancels, and nothing at all goes on. Its
        fractions never fall. None reports to whom the caller reports.

    Raises
    ------
    Cancelled
        Out of the block, when the callback asks for it.
    InvalidSettings
        If it cannot be called.
    """
    if progress is None:
        yield
        return
    _check(progress)
    highest = 0.0

    def report(fraction: float, message: str) -> None:
        nonlocal highest
        highest = max(highest, fraction)
        token = _current.set(None)  # what the callback itself runs is not part of this run
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
    """Have the block cover the fractions `start` to `stop` of the phase that it stands in.

    Parameters
    ----------
    start, stop : float
        From 0 to 1. Where both are the same, the block asks whether to go on, and the bar rests.
    message : str
        What is being done, for people.
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
    """Have the block ask whether to go on while the bar rests, as its share is small."""
    return phase(0.0, 0.0, message)


def ask(fraction: float = 0.0) -> None:
    """Report how much of the current phase is done; raises `Cancelled` if that is wanted."""
    current = _current.get()
    if current is not None:
        current.report(current.start + fraction * (current.stop - current.start), current.message)


def part_of(
    progress: ProgressCallback | None, first: float, last: float
) -> ProgressCallback | None:
    """Return what reports a part of the whole, from one fraction to another."""
    if progress is None:
        return None
    _check(progress)
    return lambda fraction, message: progress(first + (last - first) * fraction, message)


def one_of(
    progress: ProgressCallback | None, number: int, count: int, message: str
) -> AbstractContextManager[None]:
    """Report what happens in the block as one of `count` steps, for generators.

    These do not stand in their caller's phase while they wait: each step is reported by itself.
    """
    if progress is not None:
        _check(progress)

    def report(fraction: float, _: str) -> bool:
        return progress is None or progress((number + fraction) / count, message)

    return reporting(None if progress is None else report)
