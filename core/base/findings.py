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
    """A sentence with fields in braces and their values, as in a `ShockError`.

    A value that is named as a setting is what the filter chose where that was left to it.
    """

    sentence: str
    values: dict[str, Any]

    def __str__(self) -> str:
        return self.sentence.format(**self.values)


class EdgeLengths(float):
    """A length of a mesh in mean edge lengths; as a text it says so, whatever the format.

    Parameters
    ----------
    value : float
    edge : float
        The mean edge length, in units of the mesh.

    Examples
    --------
    >>> from shock_filter.core.base.findings import EdgeLengths
    >>> f"{EdgeLengths(1.25, 0.1)}, {EdgeLengths(1.0, 0.1)}"
    '1.2 edge lengths, 1 edge length'
    """

    edge: float

    def __new__(cls, value: float, edge: float) -> "EdgeLengths":
        """Make a number with a unit."""
        self = super().__new__(cls, value)
        self.edge = edge
        return self

    def __format__(self, _: str) -> str:
        """Return the number and its unit."""
        number = f"{float(self):.2g}"
        return f"{number} edge length" if number == "1" else f"{number} edge lengths"


class Length(float):
    """A length in units of a mesh, which host programs write in those of the scene.

    Examples
    --------
    >>> from shock_filter.core.base.findings import Length
    >>> f"{Length(0.12345)}"
    '0.123'
    """

    of_mesh = True

    def __format__(self, _: str) -> str:
        """Return the number."""
        return f"{float(self):.3g}"


_listening: ContextVar[list[Finding] | None] = ContextVar("shock_filter_findings", default=None)


@contextmanager
def gathering() -> Iterator[list[Finding]]:
    """Gather the findings of the block; an enclosing `gathering` also gets them."""
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
