# SPDX-License-Identifier: GPL-3.0-or-later
"""Wheels other than those that are known are refused, wherever they come from."""

import re
import zipfile

import build_extension
import pytest
import wheel_hashes
import write_wheel_hashes

REQUIREMENT = "pinned==1.0"
OFFLINE = ["--no-index", "--disable-pip-version-check"]


@pytest.fixture
def wheel(tmp_path):
    """Make the smallest wheel that pip takes, in a folder that stands for an index."""
    path = tmp_path / "index" / "pinned-1.0-py3-none-any.whl"
    path.parent.mkdir()
    about = {
        "METADATA": "Metadata-Version: 2.1\nName: pinned\nVersion: 1.0\n",
        "WHEEL": "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n",
        "RECORD": "",
    }
    with zipfile.ZipFile(path, "w") as archive:
        for name, text in about.items():
            archive.writestr(f"pinned-1.0.dist-info/{name}", text)
    return path


@pytest.fixture
def hashes(tmp_path, wheel):
    path = tmp_path / "wheels.txt"
    path.write_text(f"{REQUIREMENT} --hash=sha256:{wheel_hashes.digest(wheel)}\n")
    return path


def fetch(wheel, hashes, folder):
    words = [*OFFLINE, f"--find-links={wheel.parent}"]
    return wheel_hashes.download(REQUIREMENT, folder, words, hashes)


def test_a_known_wheel_is_downloaded(wheel, hashes, tmp_path):
    assert fetch(wheel, hashes, tmp_path / "got")
    assert (tmp_path / "got" / wheel.name).read_bytes() == wheel.read_bytes()


def test_another_wheel_of_the_same_version_is_refused(wheel, hashes, tmp_path, capfd):
    with zipfile.ZipFile(wheel, "a") as archive:
        archive.writestr("pinned.py", "print('not what was tested')")
    assert not fetch(wheel, hashes, tmp_path / "got")
    assert not list(tmp_path.glob("got/*.whl"))
    assert "DO NOT MATCH THE HASHES" in capfd.readouterr().err


def test_a_wheel_that_lay_there_is_looked_at_too(wheel, hashes):
    wheel_hashes.check(wheel, REQUIREMENT, hashes)
    wheel.write_bytes(wheel.read_bytes() + b"\0")
    with pytest.raises(SystemExit, match=r"is not the wheel of pinned==1\.0"):
        wheel_hashes.check(wheel, REQUIREMENT, hashes)


def test_hashes_of_all_that_is_downloaded_are_known_and_no_address():
    wanted = write_wheel_hashes.in_use()
    assert set(wanted) == set(build_extension.BLENDERS)
    for requirement in wanted:
        words = wheel_hashes.line_of(requirement).split()
        assert words[1:]
        assert all(re.fullmatch(r"--hash=sha256:[0-9a-f]{64}", word) for word in words[1:])
    with pytest.raises(SystemExit, match=r"run tools/write_wheel_hashes\.py"):
        wheel_hashes.line_of("scipy==0.1")


def test_the_chores_download_the_same_blenders(monkeypatch):
    text = (build_extension.ROOT / "noxfile.py").read_text(encoding="utf-8")
    assert set(re.findall(r"bpy==[0-9.]+", text)) == set(build_extension.BLENDERS)
