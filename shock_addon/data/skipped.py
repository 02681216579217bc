# SPDX-License-Identifier: GPL-3.0-or-later
"""Reasons for leaving objects alone, in the language of the interface."""

from typing import TYPE_CHECKING

from bpy.app.translations import pgettext_rpt

from ...core.errors import ShockError

if TYPE_CHECKING:
    from ...core.base.findings import Finding

MOST_NAMES = 4
"""Most objects, and remarks on them, that a report lists one by one."""


class Skipped(Exception):
    """An object cannot be processed. The text is in the language of the interface.

    Parameters
    ----------
    reason : str
        Completes "Skipped NAME: ..." and names the fix, in lower case and without a period at the
        end. It may have fields such as ``{name}``.
    **values
        Values of the fields.
    """

    def __init__(self, reason: str, /, **values: object) -> None:
        super().__init__(reason)
        self.reason = reason
        self.values = values

    def __str__(self) -> str:
        return _said(self.reason, self.values)


class Refused(Skipped):
    """The run cannot start. The text is a sentence in the language of the interface."""


def skip_if(reason: str) -> None:
    """Raise `Skipped` if there is a reason."""
    if reason:
        raise Skipped(reason)


def explain(error: "ShockError | Refused | Finding", scale: float = 0.0) -> str:
    """Return an error or a finding as a sentence in the language of the interface.

    Parameters
    ----------
    error : ShockError, Refused or Finding
    scale : float
        Of the object in the scene, in whose units lengths are given; 0 where there is none.
    """
    if isinstance(error, Refused):
        return str(error)
    values = {name: _written(value, scale) for name, value in error.values.items()}
    return _said(error.sentence, values)


def _written(value: object, scale: float) -> object:
    """Return a length in the units of the scene; anything else as it is."""
    from .lengths import in_both, in_scene

    if hasattr(value, "edge"):
        return in_both(value, value.edge * scale)
    return in_scene(value * scale) if hasattr(value, "of_mesh") and scale > 0 else value


def as_reason(sentence: str) -> str:
    """Remove the final period, so that a sentence can be part of another one."""
    return sentence.rstrip(".。")


def _said(sentence: str, values: dict[str, object]) -> str:
    text = pgettext_rpt(sentence)
    return text.format(**values) if values else text


def sentences(left: list[tuple[str, str]]) -> list[str]:
    """Return one sentence for each reason, naming the objects that were left alone.

    Parameters
    ----------
    left : list of (str, str)
        Names and reasons, in the interface's language.
    """
    names: dict[str, list[str]] = {}
    for name, reason in left:
        names.setdefault(reason, []).append(name)
    return [
        pgettext_rpt(
            "Skipped {names}: {reason}."
            if len(alike) == 1
            else "Skipped {number:,} objects ({names}), each because {reason}."
        ).format(number=len(alike), names=listed(alike), reason=reason)
        for reason, alike in names.items()
    ]


def listed(names: list[str]) -> str:
    if len(names) <= MOST_NAMES:
        return ", ".join(names)
    return pgettext_rpt("{names} and {number:,} more").format(
        names=", ".join(names[: MOST_NAMES - 1]), number=len(names) - MOST_NAMES + 1
    )
