# SPDX-License-Identifier: GPL-3.0-or-later
"""What a release refuses, and that its files have the same bytes twice."""

import gzip
import hashlib
import io
import os
import subprocess
import tarfile

import pytest
import release

CHANGELOG = """# Changelog

## [2.0.0] - unreleased

- Not yet.

## [1.10.0] - 2026-11-23

### Added

- A thing.

## [1.9.0] - 2026-01-01

- Another.
"""


@pytest.fixture
def clone(tmp_path):
    """Return a repository with one commit, tagged v1.9.0, and another on it."""
    env = {
        **os.environ,
        **{
            f"GIT_{who}_{what}": "a@b"
            for who in ("AUTHOR", "COMMITTER")
            for what in ("NAME", "EMAIL")
        },
    }

    def git(*words):
        subprocess.run(["git", *words], cwd=tmp_path, env=env, check=True, capture_output=True)

    git("init")
    for number in "12":
        (tmp_path / "file").write_text(number)
        git("add", "file")
        git("commit", "-m", number)
        if number == "1":
            git("tag", "v1.9.0")
    return tmp_path


def test_clean_tree_passes_and_a_change_is_named(clone):
    release.check_clean(clone)
    (clone / "new file").write_text("")
    with pytest.raises(
        SystemExit, match=r"1 files differ from the last commit, such as .*new file"
    ):
        release.check_clean(clone)


def test_only_the_tested_commit_passes(clone, tmp_path_factory):
    tested = tmp_path_factory.mktemp("nox") / "tested"
    with pytest.raises(SystemExit, match=r"was not tested: run \.ci/run"):
        release.check_tested(clone, tested)
    tested.write_text(release.git(clone, "rev-parse", "HEAD") + "\n")
    release.check_tested(clone, tested)
    tested.write_text(release.git(clone, "rev-parse", "HEAD~1") + "\n")
    with pytest.raises(SystemExit, match="was not tested"):
        release.check_tested(clone, tested)


def test_version_has_to_be_above_all_that_are_out(clone):
    release.check_version(clone, "1.10.0")
    for version in ("1.9.0", "1.8.9"):
        with pytest.raises(SystemExit, match=r"is not above 1\.9\.0, which is out: raise it in"):
            release.check_version(clone, version)
    subprocess.run(["git", "tag", "v1.10.0"], cwd=clone, check=True)
    release.check_version(clone, "1.10.0")  # the same commit, once more


def test_without_git_there_is_a_sentence(tmp_path):
    with pytest.raises(SystemExit, match="A release needs a clone with git"):
        release.check_clean(tmp_path)


def test_notes_come_out_of_the_changelog():
    assert release.notes(CHANGELOG, "1.10.0") == (
        "# Shock Filter 1.10.0, 2026-11-23\n\n### Added\n\n- A thing.\n"
    )
    for version in ("2.0.0", "1.1.0"):
        with pytest.raises(SystemExit, match=rf"`## \[{version}\] - YEAR-MONTH-DAY`"):
            release.notes(CHANGELOG, version)


def test_texts_without_translation_are_refused(monkeypatch):
    done = subprocess.CompletedProcess([], 1)
    monkeypatch.setattr(subprocess, "run", lambda *_, **__: done)
    with pytest.raises(SystemExit, match="`nox -s translations` names them"):
        release.check_translations()


def test_a_failure_leaves_the_last_release(tmp_path, monkeypatch):
    monkeypatch.setattr(release, "RELEASE", tmp_path / "release")
    for name in ("check_clean", "check_tested", "check_version", "check_translations"):
        monkeypatch.setattr(release, name, lambda *_: None)
    monkeypatch.setattr(release, "notes", lambda *_: "news")
    (tmp_path / "release").mkdir()
    (tmp_path / "release" / "old").write_text("")

    def fail(folder, news):
        folder.mkdir()
        raise SystemExit("no")

    monkeypatch.setattr(release, "build_all", fail)
    with pytest.raises(SystemExit):
        release.main()
    assert [path.name for path in (tmp_path / "release").iterdir()] == ["old"]


def test_sdists_have_the_same_bytes_whoever_packs_them(tmp_path):
    for name, order, mtime, mode in (("a", "xy", 1, 0o600), ("b", "yx", 2, 0o664)):
        with gzip.open(tmp_path / name, "wb") as file, tarfile.open(fileobj=file, mode="w") as tar:
            for entry in order:
                info = tarfile.TarInfo(entry)
                info.mtime, info.mode, info.uid, info.uname, info.size = mtime, mode, mtime, name, 1
                tar.addfile(info, io.BytesIO(entry.encode()))
        release.make_reproducible(tmp_path / name)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()
    with tarfile.open(tmp_path / "a") as tar:
        assert [tar.extractfile(info).read() for info in tar] == [b"x", b"y"]


def test_sums_name_all_files(tmp_path):
    (tmp_path / "b").mkdir()
    (tmp_path / "b" / "c").write_bytes(b"1")
    (tmp_path / "a").write_bytes(b"2")
    release.write_sums(tmp_path)
    digest = [hashlib.sha256(content).hexdigest() for content in (b"2", b"1")]
    assert (tmp_path / "SHA256SUMS").read_text() == f"{digest[0]}  a\n{digest[1]}  b/c\n"
