# SPDX-License-Identifier: GPL-3.0-or-later
"""The reason why an object is left alone."""

from bpy.app.translations import pgettext_rpt

_MOST_NAMES = 4


class Skipped(Exception):
    """An object cannot be worked on; the message completes "Skipped NAME: ..." and names the fix.

    The message starts in lower case and has no period at the end.
    """


def sentences(left: list[tuple[str, str]]) -> list[str]:
    """Say in one sentence for each reason which objects were left alone.

    Parameters
    ----------
    left : list of (str, str)
        Names and reasons.
    """
    names: dict[str, list[str]] = {}
    for name, reason in left:
        names.setdefault(reason, []).append(name)
    return [
        pgettext_rpt(
            "Skipped {names}: {reason}."
            if len(alike) == 1
            else "Skipped {number:,} objects ({names}), each because {reason}."
        ).format(number=len(alike), names=_listed(alike), reason=pgettext_rpt(reason))
        for reason, alike in names.items()
    ]


def _listed(names: list[str]) -> str:
    if len(names) <= _MOST_NAMES:
        return ", ".join(names)
    return pgettext_rpt("{names} and {number:,} more").format(
        names=", ".join(names[: _MOST_NAMES - 1]), number=len(names) - _MOST_NAMES + 1
    )
