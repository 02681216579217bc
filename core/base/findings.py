# SPDX-License-Identifier: GPL-3.0-or-later
"""What filters find out on their way, for reports: told to whoever gathers it, without a parameter.

A front end opens ``with gathering() as findings:`` around a run; a filter calls `tell`. Only what
the thread says that opened it is gathered. Needs neither numpy nor numba.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any, NamedTuple


class Finding(NamedTuple):
    """A sentence, with names in braces, and their values; as those of a `ShockError`."""

    sentence: str
    values: dict[str, Any]

    def __str__(self) -> str:
        return self.sentence.format(**self.values)


_listening: ContextVar[list[Finding] | None] = ContextVar("shock_filter_findings", default=None)


@contextmanager
def gathering() -> Iterator[list[Finding]]:
    """Gather what is told in the block; those who gather around it get it, too."""
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
    """Whether anybody listens."""
    return _listening.get() is not None


def tell(text: str, **values: Any) -> None:
    """Say what was found, once in a run."""
    found = _listening.get()
    if found is not None and Finding(text, values) not in found:
        found.append(Finding(text, values))
