# SPDX-License-Identifier: GPL-3.0-or-later
"""The errors that the core raises; each message names the fix."""


class ShockError(Exception):
    """Base of all errors that Shock Filter raises on purpose.

    Parameters
    ----------
    sentence : str
        The message, with fields such as ``{count}`` for what differs each time.
    **values
        The values of the fields. They are kept apart so that the sentence can be translated; a
        message without values holds no fields.
    """

    def __init__(self, sentence: str = "", /, **values: object) -> None:
        super().__init__(sentence.format(**values) if values else sentence)
        self.sentence = sentence
        self.values = values


class InvalidMesh(ShockError, ValueError):
    """The mesh's arrays do not describe triangles in space."""


class InvalidSignal(ShockError, ValueError):
    """A signal or mask does not fit its mesh or image, or holds NaN or infinity."""


class InvalidSettings(ShockError, ValueError):
    """A setting is outside its range or contradicts another one."""


class SolverError(ShockError, RuntimeError):
    """A linear solve failed or stopped improving; no result is returned."""


class Cancelled(ShockError):
    """The progress callback returned False; nothing was changed."""


class InvalidUV(ShockError, ValueError):
    """Texture coordinates are missing or cannot be used."""


class KernelMissing(ShockError, NotImplementedError):
    """The library of compiled kernels lacks some types, and numba is not installed."""
