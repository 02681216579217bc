# SPDX-License-Identifier: GPL-3.0-or-later
"""Make a release in ``dist/release/``: all that people install, or a sentence that says why not.

- ``repository/``: the zips of all platforms, and ``index.json``: an extension repository
- ``python/``: the wheel and the sdist, and the wheels of compiled kernels
- ``manual/``: the manual as pages
- ``NOTES.md``: what is new, out of CHANGELOG.md
- ``SHA256SUMS``: checksums of all files

Two releases of one commit have the same bytes, if made by the same Python and zlib.
"""

from __future__ import annotations

import gzip
import hashlib
import os
import re
import shutil
import subprocess
import sys
import tarfile
import tempfile
from pathlib import Path

import build_extension
import build_kernels
from build_extension import DIST, ROOT

RELEASE = DIST / "release"
TESTED = ROOT / ".nox" / "tested"
"""Holds the commit that `.ci/run` has passed."""

LONG_AGO = "315532800"
"""1980, as for zips, in seconds since 1970."""


def git(root: Path, *words: str) -> str:
    """Return what a git command says."""
    done = subprocess.run(["git", *words], cwd=root, capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f"A release needs a clone with git: {done.stderr.strip()}")
    return done.stdout.strip()


def check_clean(root: Path) -> None:
    """Refuse what is in no commit."""
    changed = git(root, "status", "--porcelain").splitlines()
    if changed:
        raise SystemExit(
            f"{len(changed)} files differ from the last commit, such as {changed[0][3:]}: commit or"
            " remove them."
        )


def check_tested(root: Path, tested: Path) -> None:
    """Refuse a commit that .ci/run has not passed."""
    head = git(root, "rev-parse", "HEAD")
    if not tested.is_file() or tested.read_text(encoding="utf-8").strip() != head:
        raise SystemExit("This commit was not tested: run .ci/run to its end, then this again.")


def check_version(root: Path, version: str) -> None:
    """Refuse a version that is not above those that other commits have as tags."""
    here = set(git(root, "tag", "--points-at", "HEAD", "--list", "v*").split())
    others = set(git(root, "tag", "--list", "v*").split()) - here
    newest = max(others, key=_order, default="v0")
    if _order(f"v{version}") <= _order(newest):
        raise SystemExit(
            f"Version {version} is not above {newest[1:]}, which is out: raise it in"
            f" {build_extension.MANIFEST}."
        )


def _order(tag: str) -> list[int]:
    return [int(number) for number in re.findall(r"\d+", tag)]


def notes(changelog: str, version: str) -> str:
    """Return what the changelog says of a version; refused where it has no date."""
    found = re.search(
        rf"^## \[{re.escape(version)}\] - (\d{{4}}-\d\d-\d\d)\n(.*?)(?=^## |\Z)",
        changelog,
        re.MULTILINE | re.DOTALL,
    )
    if found is None:
        raise SystemExit(
            f"CHANGELOG.md has no dated entry of this version: give it the heading"
            f" `## [{version}] - YEAR-MONTH-DAY`."
        )
    return f"# Shock Filter {version}, {found[1]}\n\n{found[2].strip()}\n"


def check_translations() -> None:
    """Refuse texts that a language lacks."""
    tests = str(ROOT / "tests" / "release")
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", tests]
    done = subprocess.run(command, cwd=ROOT, stdout=subprocess.DEVNULL)
    if done.returncode:
        raise SystemExit(
            "Texts on screen lack translations, or there are stale ones: `nox -s translations`"
            " names them."
        )


def build_python(target: Path) -> None:
    """Build the wheel and the sdist of the last commit, with fixed dates and rights."""
    target.mkdir()
    with tempfile.TemporaryDirectory() as folder:
        archive = Path(folder) / "commit.tar"
        git(ROOT, "archive", f"--output={archive}", "HEAD")
        source = Path(folder) / "source"
        with tarfile.open(archive) as files:
            files.extractall(source, filter="data")
        (source / "noxfile.py").unlink()  # a module beside the package's own would come along
        environment = {**os.environ, "SOURCE_DATE_EPOCH": LONG_AGO}
        command = [sys.executable, "-m", "build", "--no-isolation", f"--outdir={target}"]
        command.append(str(source))
        done = subprocess.run(command, env=environment, capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f"No wheel was built:\n{done.stdout}{done.stderr}")
    for wheel in target.glob("*.whl"):
        build_extension.make_reproducible(wheel)
    for sdist in target.glob("*.tar.gz"):
        make_reproducible(sdist)


def make_reproducible(sdist: Path) -> None:
    """Write a compressed tar anew: sorted, without dates, owners and the umask of who built it."""
    part = sdist.with_name(f".{sdist.name}")
    with (
        tarfile.open(sdist) as old,
        part.open("wb") as file,
        gzip.GzipFile("", "wb", mtime=0, fileobj=file) as compressed,
        tarfile.open(fileobj=compressed, mode="w", format=tarfile.PAX_FORMAT) as new,
    ):
        for entry in sorted(old.getmembers(), key=lambda entry: entry.name):
            entry.mtime, entry.pax_headers = int(LONG_AGO), {}
            entry.uid = entry.gid = 0
            entry.uname = entry.gname = ""
            entry.mode = 0o755 if entry.isdir() else 0o644
            new.addfile(entry, old.extractfile(entry) if entry.isfile() else None)
    part.replace(sdist)


def write_sums(folder: Path) -> None:
    """Write checksums of all files, as `sha256sum --check SHA256SUMS` reads them."""
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    lines = [
        f"{hashlib.sha256(path.read_bytes()).hexdigest()}  {path.relative_to(folder).as_posix()}\n"
        for path in files
    ]
    (folder / "SHA256SUMS").write_text("".join(lines), encoding="utf-8", newline="\n")


def build_all(folder: Path, news: str) -> None:
    """Build all parts into a new folder."""
    os.environ["SOURCE_DATE_EPOCH"] = LONG_AGO  # for the manual
    repository = folder / "repository"
    repository.mkdir(parents=True)
    shutil.rmtree(ROOT / build_extension.MANUAL, ignore_errors=True)
    build_extension.build_manual()
    for platform in build_extension.PLATFORMS:
        build_extension.build(platform, repository / build_extension.zip_name(platform))
    build_extension.make_repository(repository)
    build_python(folder / "python")
    for platform in build_extension.PLATFORMS:
        shutil.copy(build_kernels.build(platform), folder / "python")
    shutil.copytree(ROOT / build_extension.MANUAL, folder / "manual")
    (folder / "NOTES.md").write_text(news, encoding="utf-8")
    write_sums(folder)


def main() -> None:
    """Check, build beside the last release, and put the new one in its place."""
    version = build_extension.version()
    check_clean(ROOT)
    check_version(ROOT, version)
    news = notes((ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), version)
    check_translations()
    check_tested(ROOT, TESTED)
    part = RELEASE.with_name("release.part")
    shutil.rmtree(part, ignore_errors=True)
    build_all(part, news)
    shutil.rmtree(RELEASE, ignore_errors=True)
    part.rename(RELEASE)
    print(f"Shock Filter {version} is in {RELEASE}.")


if __name__ == "__main__":
    main()
