# SPDX-License-Identifier: GPL-3.0-or-later
"""The command line, shared by ``shock-filter`` and Blender.

A backend reads, filters and writes one file; everything else (flags, several inputs, progress,
messages, exit codes) is here. Numerics and file formats are imported with the first file.
May use all of `core`.
"""

from __future__ import annotations

from collections.abc import Sequence

from ..errors import InvalidSettings
from .commands import COMMANDS, TEXTURE_MASK, Backend, Command
from .file_backend import FileBackend
from .inputs import UsageError, files_of
from .parsing import build_parser, read_settings, refuse_unknown
from .running import DONE, FAILED, INTERRUPTED, Job, run_all

__all__ = [
    "COMMANDS",
    "DONE",
    "FAILED",
    "INTERRUPTED",
    "TEXTURE_MASK",
    "Backend",
    "Command",
    "FileBackend",
    "build_parser",
    "main",
]


def main(arguments: Sequence[str] | None = None, backend: Backend | None = None) -> int:
    """Run the command line.

    Parameters
    ----------
    arguments : sequence of str, optional
        The words after the program's name; if left out, those of ``sys.argv``.
    backend : Backend, optional
        Reads, filters and writes; :class:`FileBackend` if left out.

    Returns
    -------
    int
        The exit code: 0, 1 or 130. Usage errors raise ``SystemExit(2)``.
    """
    backend = backend or FileBackend()
    parser = build_parser(backend)
    options, unknown = parser.parse_known_args(arguments)
    try:
        refuse_unknown(options, unknown)
        settings = read_settings(options)
        files = files_of(options)
    except (InvalidSettings, UsageError) as error:
        parser.error(str(error))
    job = Job(backend, settings, options)
    if options.cluster is not None:
        from .cluster import run_on_cluster

        return run_on_cluster(job, files)
    return run_all(job, files)
