# SPDX-License-Identifier: GPL-3.0-or-later
"""Make small deliberate faults, one at a time, and tell which of them the tests notice.

``python tools/mutants.py`` copies the tree, runs the tests of each faulty module on the copy as it
is, makes each fault of ``tools/mutants.toml`` there, and runs them again. A fault that no test
notices shows a test that is missing, unless the file gives the reason why it changes no result.
``--write`` puts the table of all faults into docs/developing.md.

Compiled kernels stay in the folder of the copies, so that a fault compiles only what it touches,
and a second run nearly nothing.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import queue
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple, TypeVar

ROOT = Path(__file__).resolve().parent.parent
FAULTS = Path(__file__).with_suffix(".toml")
PAGE = ROOT / "docs" / "developing.md"
_BEGIN, _END = "<!-- begin faults -->", "<!-- end faults -->"

_LEFT_OUT = shutil.ignore_patterns(".git", ".nox", ".venv", "__pycache__", "dist", "site", "images")
_LEAST_TIME, _SLOWER = 300.0, 10.0
"""Seconds after which tests are stopped, and times what they take without a fault."""

# By itself, numba would keep the kernels of each copy of the tree in a folder of their own.
_RUN_TESTS = """
import sys
from numba.core.caching import UserProvidedCacheLocator
UserProvidedCacheLocator.get_suitable_cache_subpath = lambda *_: ""
import pytest
sys.exit(pytest.main())
"""

Item = TypeVar("Item")
Answer = TypeVar("Answer")


class Fault(NamedTuple):
    """A text of a file, what takes its place, and the tests that are to notice."""

    name: str
    file: str
    before: str
    after: str
    tests: list[str]
    reason: str = ""

    @property
    def room(self) -> str:
        """The room of the core that the file is in."""
        return self.file.split("/")[1]

    def applied(self, text: str) -> str:
        """Return the file's text with the fault."""
        if text.count(self.before) != 1:
            raise SystemExit(
                f"The fault '{self.name}' is out of date: its text stands {text.count(self.before)}"
                f" times in {self.file}, and not once. Change {FAULTS.name}."
            )
        return text.replace(self.before, self.after)


class Result(NamedTuple):
    """How a run of tests ended: the first test that failed, or nothing, and how long it took."""

    noticed_by: str
    seconds: float


class Copy:
    """A copy of the tree, in which one fault at a time is made.

    Parameters
    ----------
    folder : Path
        Where it lies, under the package's name.
    kernels : Path
        The folder of compiled kernels of all copies.
    """

    def __init__(self, folder: Path, kernels: Path) -> None:
        self._tree, self._kernels = folder / "shock_filter", kernels
        shutil.rmtree(folder, ignore_errors=True)
        shutil.copytree(ROOT, self._tree, ignore=_LEFT_OUT, symlinks=True)
        self._environment = os.environ | {
            "PYTHONPATH": str(folder),
            "PYTHONDONTWRITEBYTECODE": "1",  # which would not see edits within a second
        }

    def test(self, tests: Iterable[str], limit: float = 3600.0) -> Result:
        """Run tests on the tree as it is."""
        return self._run(tests, self._kernels / "none", limit)

    def test_with(self, fault: Fault, limit: float) -> Result:
        """Run the tests of a fault with it."""
        path = self._tree / fault.file
        text = path.read_text(encoding="utf-8")
        kernels = self._kernels / re.sub(r"\W+", "-", fault.name)
        _link_newer(self._kernels / "none", kernels)
        path.write_text(fault.applied(text), encoding="utf-8")
        try:
            return self._run(fault.tests, kernels, limit)
        finally:
            path.write_text(text, encoding="utf-8")

    def _run(self, tests: Iterable[str], kernels: Path, limit: float) -> Result:
        names = [_test_path(test) for test in tests]
        words = ["-x", "-q", "--tb=no", "-rfE", "-p", "no:cacheprovider"]
        start = time.monotonic()
        process = subprocess.Popen(
            [sys.executable, "-c", _RUN_TESTS, *words, *names],
            cwd=self._tree,
            env=self._environment | {"NUMBA_CACHE_DIR": str(kernels)},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
        )
        try:
            output, _ = process.communicate(timeout=limit)
        except subprocess.TimeoutExpired:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.communicate()
            return Result(f"no end in {limit:.0f} s", time.monotonic() - start)
        return Result(_first_failure(process.returncode, output), time.monotonic() - start)


def _test_path(test: str) -> str:
    file, *names = test.split("::")
    return "::".join([f"tests/core/{file}.py", *names])


def _first_failure(code: int, output: str) -> str:
    if code == 0:
        return ""
    if code < 0:
        return f"a crash (signal {-code})"
    found = re.search(r"^(?:FAILED|ERROR) tests/core/(.*?)(?: - .*)?$", output, re.MULTILINE)
    if found is None:
        raise SystemExit(f"The tests could not be run:\n{output}")
    return re.sub(r"\[.*", "", found[1]).replace(".py", "")


def _link_newer(source: Path, target: Path) -> None:
    # Kernels are replaced as files, never written to.
    for path in source.rglob("*.nb*"):
        copy = target / path.relative_to(source)
        if not copy.exists() or copy.stat().st_mtime < path.stat().st_mtime:
            copy.parent.mkdir(parents=True, exist_ok=True)
            copy.unlink(missing_ok=True)
            os.link(path, copy)


def read_faults(chosen: list[str]) -> list[Fault]:
    """Read the faults, those of some rooms or with some words in their names."""
    rows = tomllib.loads(FAULTS.read_text(encoding="utf-8"))["fault"]
    faults = [Fault(**row) for row in rows]
    for fault in faults:
        fault.applied((ROOT / fault.file).read_text(encoding="utf-8"))
    if not chosen:
        return faults
    return [
        fault
        for fault in faults
        if any(word == fault.room or word in fault.name or word in fault.file for word in chosen)
    ]


def tried(faults: list[Fault], jobs: int, folder: Path) -> dict[str, Result]:
    """Run the tests without a fault, then with each one; returns the results by names."""
    copies: queue.SimpleQueue[Copy] = queue.SimpleQueue()
    for number in range(jobs):
        copies.put(Copy(folder / f"copy-{number}", folder / "kernels"))

    def each(items: list[Item], test: Callable[[Copy, Item], Answer]) -> list[Answer]:
        def with_copy(item: Item) -> Answer:
            copy = copies.get()
            try:
                return test(copy, item)
            finally:
                copies.put(copy)

        with ThreadPoolExecutor(jobs) as pool:
            futures = [pool.submit(with_copy, item) for item in items]
            try:
                return [future.result() for future in futures]
            except BaseException:
                pool.shutdown(cancel_futures=True)
                raise

    def test_clean(copy: Copy, test: str) -> Result:
        result = copy.test([test])
        if result.noticed_by:
            raise SystemExit(f"Without any fault, this fails: {result.noticed_by}")
        print(f"passes without a fault: {test} ({result.seconds:.0f} s)", flush=True)
        return result

    tests = sorted({test for fault in faults for test in fault.tests})
    clean = dict(zip(tests, each(tests, test_clean), strict=True))

    def test_fault(copy: Copy, fault: Fault) -> Result:
        usual = sum(clean[test].seconds for test in fault.tests)
        result = copy.test_with(fault, _LEAST_TIME + _SLOWER * usual)
        told = result.noticed_by or ("not noticed: equivalent" if fault.reason else "NOT NOTICED")
        print(f"{fault.file}: {fault.name}: {told} ({result.seconds:.0f} s)", flush=True)
        return result

    return dict(zip([fault.name for fault in faults], each(faults, test_fault), strict=True))


def table(faults: list[Fault], results: dict[str, Result]) -> str:
    """Return what the page shows: how many were noticed, by what, and the reasons of others."""
    noticed = [fault for fault in faults if results[fault.name].noticed_by]
    others = [fault for fault in faults if not results[fault.name].noticed_by]
    lines = [f"Of {len(faults)} faults, {len(noticed)} are noticed.", ""]
    lines += ["| file | fault | noticed by |", "|---|---|---|"]
    for fault in noticed:
        by = results[fault.name].noticed_by
        by = f"`{by}`" if "::" in by else by
        lines.append(f"| `{fault.file.removeprefix('core/')}` | {fault.name} | {by} |")
    if others:
        lines += ["", "No test notices these. The reason explains why results do not differ:", ""]
        lines += ["| file | fault | reason |", "|---|---|---|"]
        for fault in others:
            reason = fault.reason or "**none is known: a test is missing**"
            lines.append(f"| `{fault.file.removeprefix('core/')}` | {fault.name} | {reason} |")
    return "\n".join(lines)


def write_page(text: str) -> None:
    """Put the table into the page, between its markers."""
    before, _, rest = PAGE.read_text(encoding="utf-8").partition(_BEGIN)
    _, _, after = rest.partition(_END)
    PAGE.write_text(f"{before}{_BEGIN}\n\n{text}\n\n{_END}{after}", encoding="utf-8")


def main() -> int:
    """Try the faults; fails if one is not noticed that has no reason."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", nargs="+", default=[], metavar="WORD",
                        help="rooms, or parts of names and files")  # fmt: skip
    parser.add_argument("--jobs", type=int, default=1, help="how many at once (default: 1)")
    parser.add_argument("--list", action="store_true", help="print the faults, try none")
    parser.add_argument("--write", action="store_true", help="write the table of all faults")
    parser.add_argument("--folder", type=Path, help="of copies and kernels, kept for later runs",
                        default=Path(tempfile.gettempdir(), "shock-filter-faults"))  # fmt: skip
    options = parser.parse_args()
    if options.write and options.only:
        parser.error("--write needs all faults, without --only")
    faults = read_faults(options.only)
    if options.list:
        for fault in faults:
            print(f"{fault.file}: {fault.name} ({', '.join(fault.tests)})")
        return 0
    results = tried(faults, options.jobs, options.folder.absolute())
    if options.write:
        write_page(table(faults, results))
    missing = [fault for fault in faults if not fault.reason and not results[fault.name].noticed_by]
    noticed = sum(bool(result.noticed_by) for result in results.values())
    print(f"{noticed} of {len(faults)} faults are noticed.")
    for fault in missing:
        print(f"NOT NOTICED: {fault.file}: {fault.name}")
    return int(bool(missing))


if __name__ == "__main__":
    sys.exit(main())
