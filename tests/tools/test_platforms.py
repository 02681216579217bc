# SPDX-License-Identifier: GPL-3.0-or-later
"""Calls that only some systems have stand in few places, each guarded, which the docs list."""

import ast
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
POSIX_MODULES = {"fcntl", "grp", "posix", "pty", "pwd", "resource", "syslog", "termios", "tty"}
POSIX_NAMES = {
    *("O_CLOEXEC", "O_DIRECTORY", "O_NOFOLLOW", "O_NONBLOCK", "SIGALRM", "SIGHUP", "SIGKILL"),
    *("chown", "chroot", "fchmod", "fchown", "fork", "forkpty", "getegid", "geteuid", "getgid"),
    *("getloadavg", "getpgid", "getppid", "getuid", "killpg", "lchown", "mkfifo", "nice"),
    *("posix_spawn", "pread", "preexec_fn", "pwrite", "register_at_fork", "sched_getaffinity"),
    *("sched_setaffinity", "setpgid", "setsid", "statvfs", "sysconf", "uname", "wait3", "wait4"),
}

GUARDED = {
    ("core/base/parallel.py", "register_at_fork"),  # hasattr
    ("core/base/parallel.py", "sched_getaffinity"),  # except AttributeError
    ("core/files/staging.py", "O_NOFOLLOW"),  # after the import of fcntl
    ("core/files/staging.py", "fcntl"),  # except ImportError
}


def found_in(path):
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from POSIX_MODULES.intersection(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield from POSIX_MODULES & {node.module}
            yield from POSIX_NAMES.intersection(alias.name for alias in node.names)
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            if node.value.id in ("os", "signal"):
                yield from POSIX_NAMES & {node.attr}
        elif isinstance(node, ast.keyword):
            yield from POSIX_NAMES & {node.arg}


def test_only_guarded_places_call_what_windows_lacks():
    paths = [path for folder in ("core", "shock_addon") for path in (ROOT / folder).rglob("*.py")]
    found = {(path.relative_to(ROOT).as_posix(), name) for path in paths for name in found_in(path)}
    assert found == GUARDED


def test_the_docs_list_these_places():
    text = (ROOT / "docs" / "developing.md").read_text(encoding="utf-8")
    assert [place for place, name in GUARDED if f"`{place}`" not in text or name not in text] == []
