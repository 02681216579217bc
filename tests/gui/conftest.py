# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender under a virtual screen, with the extension's zip installed in it.

``pytest tests/gui`` takes the Blender on the PATH; ``--debian trixie`` (or ``sid``) makes one from
Debian's packages, in ``--folder``. Where neither can be had, one line says so and nothing fails.
"""

from __future__ import annotations

import json
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import build_extension
import pytest
import window_blender
from publishing import publish_newer

ROOT = Path(__file__).resolve().parents[2]
LIMIT = 420.0
BUILDING_LIMIT = 1500.0  # of the zip, beside other tests


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the choice of Blender, and where pictures go."""
    parser.addoption("--debian", choices=window_blender.SUITES, help="a Debian suite's Blender")
    parser.addoption("--folder", type=Path, help="where that Blender is, or is put")
    parser.addoption("--pictures", type=Path, help="where to put pictures of all modes")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Leave time for making a Blender; each of its processes has a limit of its own."""
    for item in items:
        item.add_marker(pytest.mark.timeout(window_blender.MAKING_LIMIT + BUILDING_LIMIT + LIMIT))


def find_blender(config: pytest.Config) -> window_blender.WindowBlender:
    """Return the Blender to test in, made if it is asked for; raises `Unavailable`."""
    suite = config.getoption("--debian", None)
    if suite is None:
        return window_blender.installed()
    folder = config.getoption("--folder", None) or ROOT / ".nox" / f"blender-{suite}"
    return window_blender.provide(suite, folder)


def pytest_sessionstart(session: pytest.Session) -> None:
    """End the run with the reason why there is no Blender, before any worker starts."""
    if hasattr(session.config, "workerinput") or session.config.option.collectonly:
        return
    try:
        with tempfile.TemporaryDirectory() as folder:
            find_blender(session.config).check(Path(folder))
    except window_blender.Unavailable as reason:
        suite = session.config.getoption("--debian", None)
        what = f"Debian {suite}'s Blender" if suite else "the Blender on the PATH"
        pytest.exit(f"The window tests were not run with {what}: {reason}.", returncode=0)


@pytest.fixture(scope="session")
def blender(request: pytest.FixtureRequest):
    """Return the Blender to test in."""
    return find_blender(request.config)


@pytest.fixture(scope="session")
def work(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder for all that Blender reads and writes, with the scenarios in it."""
    folder = tmp_path_factory.mktemp("blender")
    (folder / "resources").mkdir()
    shutil.copytree(Path(__file__).parent / "inside", folder / "inside")
    return folder


@contextmanager
def _alone(path: Path) -> Iterator[None]:
    """Let one worker in at a time."""
    import fcntl  # where windows are tested

    with path.open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield


@pytest.fixture(scope="session")
def versions(blender, work: Path) -> dict[str, str]:
    """Return the versions of Blender and of its Python."""
    code = "import bpy,sys; print('VERSIONS', bpy.app.version_string, *sys.version_info[:2])"
    done = blender.run(work, "blender", "-b", "--factory-startup", "--python-expr", code)
    line = next(line for line in done.stdout.splitlines() if line.startswith("VERSIONS"))
    *words, major, minor = line.split()[1:]
    return {"blender": words[0], "python": f"{major}.{minor}"}


@pytest.fixture(scope="session")
def extension_zip(tmp_path_factory) -> Path:
    """Return the extension's zip, which one worker builds."""
    folder = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        folder = folder.parent
    target = folder / "extension.zip"
    with _alone(folder / "extension.lock"):
        if not target.exists():
            build_extension.build("linux-x64", target)
    return target


@pytest.fixture(scope="session")
def installed(blender, work: Path, extension_zip: Path) -> None:
    """Install and enable the extension's zip from the command line, as users do."""
    shutil.copy(extension_zip, work)  # a link would lead out of Blender's system
    zip_seen = str(blender.seen(work) / extension_zip.name)
    install = ["blender", "--command", "extension", "install-file", "-r", "user_default"]
    done = blender.run(work, *install, "--enable", zip_seen, limit=240.0)
    assert done.returncode == 0, done.stdout


@pytest.fixture(scope="module")
def fresh(blender, extension_zip: Path, tmp_path_factory) -> dict:
    """Return the report of a person who has a release, and a Blender without the extension."""
    work = tmp_path_factory.mktemp("fresh")
    (work / "resources").mkdir()
    shutil.copytree(Path(__file__).parent / "inside", work / "inside")
    shutil.copy(extension_zip, work)  # a link would lead out of Blender's system
    for name in ("releases", "newer"):
        (work / name).mkdir()
    shutil.copy(extension_zip, work / "releases")
    build_extension.make_repository(work / "releases")
    publish_newer(work / "extension.zip", work / "newer")
    return _play(blender, work, "installing")


@pytest.fixture(scope="session")
def play(blender, work: Path, installed, versions, request) -> Callable[[str], dict]:
    """Return a function that runs a scenario in Blender, once, and returns its report."""
    reports: dict[str, dict] = {}
    crashed: set[str] = set()

    def play_once(name: str) -> dict:
        if name not in reports:
            target = request.config.getoption("--pictures", None)
            report = _play(blender, work, name, keep=target is not None)
            if report["code"] not in (0, 1) and name not in crashed:
                crashed.add(name)  # Blender itself; a test that runs again plays once more
                shutil.rmtree(work / name)
                return report
            reports[name] = report
            if target:
                _keep_pictures(work / name, target, ".".join(versions["blender"].split(".")[:2]))
        return reports[name]

    return play_once


def _play(blender, work: Path, name: str, keep: bool = False) -> dict:
    (work / name).mkdir()
    seen = blender.seen(work)
    window = ["--window-geometry", "0", "0", "1600", "900"]
    script = ["--python-exit-code", "1", "--python", str(seen / "inside" / "play.py")]
    targets = [name, str(seen / name / "report.json"), str(seen / name)]
    targets += ["kept"] if keep else []
    done = blender.run(work, "blender", *window, *script, "--", *targets, screen=True, limit=LIMIT)
    path = work / name / "report.json"
    report = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    output = done.stdout
    for crash in work.glob("*.crash.txt"):
        output += crash.read_text(encoding="utf-8", errors="replace")
        crash.unlink()
    report.update(code=done.returncode, output=output)
    report["said"] = f"{report.get('traceback')}\nBlender's output:\n{output}"
    return report


def _keep_pictures(source: Path, target: Path, version: str) -> None:
    import numpy as np
    from PIL import Image

    target.mkdir(parents=True, exist_ok=True)
    for path in sorted(source.glob("*.npy")):
        image = Image.fromarray(np.load(path)).quantize(48, dither=Image.Dither.NONE)
        image.save(target / f"{version}-{path.stem}.png", optimize=True)
    for folder in sorted(source.glob("*loop")):
        frames = [Image.fromarray(np.load(path)) for path in sorted(folder.glob("*.npy"))]
        small = [frame.resize((frame.width * 3 // 5, frame.height * 3 // 5)) for frame in frames]
        options = {"duration": 350, "loop": 0, "quality": 60, "method": 6}
        path = target / f"{version}-{folder.name}.webp"
        small[0].save(path, save_all=True, append_images=small[1:], **options)
