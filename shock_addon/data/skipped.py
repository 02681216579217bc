# SPDX-License-Identifier: GPL-3.0-or-later
"""The reason why an object is left alone, in the interface's language."""

from typing import TYPE_CHECKING

from bpy.app.translations import pgettext_rpt

from ...core.errors import ShockError

if TYPE_CHECKING:
    from ...core.base.findings import Finding

_MOST_NAMES = 4


class Skipped(Exception):
    """An object cannot be worked on; as text it is in the interface's language.

    Parameters
    ----------
    reason : str
        Completes "Skipped NAME: ..." and names the fix, in lower case and without a period at the
        end. It may have fields such as ``{name}``.
    **values
        What stands in the fields.
    """

    def __init__(self, reason: str, /, **values: object) -> None:
        super().__init__(reason)
        self.reason = reason
        self.values = values

    def __str__(self) -> str:
        return _said(self.reason, self.values)


class Refused(Skipped):
    """Nothing can be done at all; as text it is a whole sentence in the interface's language."""


def skip_if(reason: str) -> None:
    """Raise `Skipped` if there is a reason to."""
    if reason:
        raise Skipped(reason)


def explain(error: "ShockError | Refused | Finding") -> str:
    """Say in the interface's language what could not be done, or was found."""
    if isinstance(error, Refused):
        return str(error)
    return _said(error.sentence, error.values)


def as_reason(sentence: str) -> str:
    """Take the period from a sentence's end, so that it can stand in another one."""
    return sentence.rstrip(".。")


def _said(sentence: str, values: dict[str, object]) -> str:
    text = pgettext_rpt(sentence)
    return text.format(**values) if values else text


def sentences(left: list[tuple[str, str]]) -> list[str]:
    """Say in one sentence for each reason which objects were left alone.

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
        ).format(number=len(alike), names=_listed(alike), reason=reason)
        for reason, alike in names.items()
    ]


def _listed(names: list[str]) -> str:
    if len(names) <= _MOST_NAMES:
        return ", ".join(names)
    return pgettext_rpt("{names} and {number:,} more").format(
        names=", ".join(names[: _MOST_NAMES - 1]), number=len(names) - _MOST_NAMES + 1
    )
