# SPDX-License-Identifier: GPL-3.0-or-later
"""The reason why an object is left alone."""


class Skipped(Exception):
    """An object cannot be worked on; the message completes "Skipped NAME: ..." and names the fix.

    The message starts in lower case and has no period at the end.
    """
