# SPDX-License-Identifier: GPL-3.0-or-later
"""Findings: what filters notice during a run, gathered for reports without a parameter.

A front end opens ``with gathering() as findings:`` around a run; a filter calls `tell`. Findings of
other threads than the one that opened it are not gathered. Needs neither numpy nor numba.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any, NamedTuple


class Finding(NamedTuple):
    """A sentence with fields in braces and their values, as in a `ShockError`."""

    sentence: str
    values: dict[str, Any]

    def __str__(self) -> str:
        return self.sentence.format(**self.values)


_listening: ContextVar[list[Finding] | None] = ContextVar("shock_filter_findings", default=None)


@contextmanager
def gathering() -> Iterator[list[Finding]]:
    """Gather the findings of the block; an enclosing `gathering` gets them, too."""
    outer = _listening.get()
    found: list[Finding] = []
    token = _listening.set(found)
    try:
        yield found
    finally:
        _listening.reset(token)
        if outer is not None:
            outer += found


def is_gathered() -> bool:
    """Whether a `gathering` block is open."""
    return _listening.get() is not None


def tell(text: str, **values: Any) -> None:
    """Report a finding; each one is kept once in a run."""
    found = _listening.get()
    if found is not None and Finding(text, values) not in found:
        found.append(Finding(text, values))
