# SPDX-License-Identifier: GPL-3.0-or-later
"""The project's chores: ``nox --list`` names them, ``nox -s test`` runs the one named test."""

import argparse
import ctypes
import os
import secrets
import shutil
import sys
import time
from pathlib import Path

import nox

nox.options.sessions = ["lint", "test"]
nox.options.reuse_venv = "yes"
nox.options.error_on_missing_interpreters = False

# pyenv keeps its Pythons off the PATH; Blender 5.2 needs 3.13, and the wheel is for all three.
PYENV = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv"))
for folder in sorted(PYENV.glob("versions/3.1[123].*/bin")):
    os.environ["PATH"] += os.pathsep + str(folder)

PYTHON = "3.11"

FUZZ_TESTS = ["tests/fuzz", "tests/addon/test_fuzz_operators.py", "tests/addon/test_memory.py"]

# Blender as a Python package, with the numpy that each version brings along.
BARE_BLENDER = {
    "4.2": ["bpy==4.2.23", "numpy==1.24.3"],
    "4.5": ["bpy==4.5.15", "numpy<2"],
    "5.0": ["bpy==5.0.1", "numpy<2"],
    "5.2": ["bpy==5.2.3", "numpy>=2.2,<2.4"],
}

# Blender's Python packages have hundreds of megabytes; each is downloaded once for all sessions.
WHEELS = Path(__file__).parent / ".nox" / "wheels"

PROJECT = nox.project.load_toml("pyproject.toml")["project"]

# For the manual and the compiled kernels, which the extension's zips carry.
BUILD = [*PROJECT["optional-dependencies"]["docs"], *PROJECT["optional-dependencies"]["kernels"]]

PYTEST = ["pytest>=8", "pytest-timeout>=2.3", "pytest-rerunfailures>=15"]

EXTRAS = ["files", "fields", "video", "cluster"]

# What is tested with the wheel: all that needs neither Blender nor a clone's files.
WHEEL_TESTS = ["tests/core", "tests/docs/test_docstrings.py"]

# What bpy links to, also when it runs without a window; Debian's packages.
SYSTEM_LIBRARIES = {
    "libX11.so.6": "libx11-6",
    "libXext.so.6": "libxext6",
    "libXfixes.so.3": "libxfixes3",
    "libXi.so.6": "libxi6",
    "libXrender.so.1": "libxrender1",
    "libXxf86vm.so.1": "libxxf86vm1",
    "libxkbcommon.so.0": "libxkbcommon0",
    "libSM.so.6": "libsm6",
    "libICE.so.6": "libice6",
    "libGL.so.1": "libgl1",
    "libgomp.so.1": "libgomp1",
}


def loads(library: str) -> bool:
    """Tell whether the system has a shared library."""
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True


def provide_system_libraries(session: nox.Session) -> None:
    """Install the libraries that bpy needs, or stop and name the command that does."""
    if not sys.platform.startswith("linux"):
        return
    missing = [package for library, package in SYSTEM_LIBRARIES.items() if not loads(library)]
    if not missing:
        return
    install = ["apt-get", "install", "--yes", "--no-install-recommends", *missing]
    if os.geteuid() != 0 or not shutil.which("apt-get"):
        session.error(
            "Blender's Python package needs system libraries that are missing here. Install them"
            f" and run this again: sudo {' '.join(install)}"
        )
    session.run_install("apt-get", "update", external=True)
    session.run_install(*install, external=True, env={"DEBIAN_FRONTEND": "noninteractive"})


def pip(session: nox.Session, *words: str, python: str = "python", tries: int = 3) -> None:
    """Run pip, and once more from the start where a download breaks off."""
    command = (python, "-m", "pip", *words)
    while True:
        tries -= 1
        try:
            session.run_install(*command, external=True, silent=True)
        except nox.command.CommandFailed:
            if tries == 0:
                raise
            session.warn("pip failed; it is tried again in 20 seconds")
            time.sleep(20)
        else:
            return


def install(session: nox.Session, *packages: str, python: str = "python") -> None:
    """Install packages, Blender's from the wheels that earlier sessions downloaded."""
    pip(session, "install", "--find-links", str(WHEELS), *packages, python=python)


def install_blender(
    session: nox.Session, version: str, *packages: str, python: str = "python"
) -> None:
    """Install Blender as a Python package with its numpy, and further packages."""
    blender, numpy = BARE_BLENDER[version]
    wheel = f"{blender.replace('==', '-')}-*.whl"
    if not list(WHEELS.glob(wheel)):
        lines = (Path(__file__).parent / "tools" / "wheels.txt").read_text().splitlines()
        known = Path(session.create_tmp()) / "blender.txt"
        known.write_text(next(line for line in lines if line.split(" ")[0] == blender))
        words = ("--no-deps", "--require-hashes", "--requirement", str(known))
        pip(session, "download", *words, "--dest", str(WHEELS), python=python)
    install(session, blender, numpy, *packages, python=python)


@nox.session(python=PYTHON)
def demo(session: nox.Session) -> None:
    """Sharpen shapes, colors and a photo in Blender and show them before and after."""
    provide_system_libraries(session)
    install(session, "-e", ".[blender,files,demo]")
    session.run("python", "demo/run.py", *session.posargs)


@nox.session(python=PYTHON)
def test(session: nox.Session) -> None:
    """Run all tests on one Blender."""
    provide_system_libraries(session)
    install(session, "-e", ".[blender,files,fields,video,cluster,test,docs,training,kernels]")
    session.run("pytest", *(session.posargs or ["--numprocesses=2", "--dist=loadfile"]))
    if not session.posargs:
        session.notify("test_blender(4.5)")


@nox.session(python="3.13")
def test_newest(session: nox.Session) -> None:
    """Test the core with the newest libraries that the wheel allows."""
    extras = ",".join([*EXTRAS, "test"])
    install(session, "--upgrade", "--upgrade-strategy=eager", "-e", f".[{extras}]")
    session.run("pytest", *(session.posargs or ["tests/core"]))


@nox.session
@nox.parametrize(
    ("python", "blender"),
    [("3.11", "4.2"), ("3.11", "4.5"), ("3.11", "5.0"), ("3.13", "5.2")],
    ids=["4.2", "4.5", "5.0", "5.2"],
)
def test_blender(session: nox.Session, blender: str) -> None:
    """Install the extension's zip into each supported Blender and run it there."""
    provide_system_libraries(session)
    install_blender(session, blender, *PYTEST)
    if "SHOCK_FILTER_ZIPS_ARE_MADE" not in os.environ:  # `.ci/run` makes them once for all
        words = ("--session", "build", "--", "--platform", "linux-x64")
        session.run(sys.executable, "-m", "nox", *words, external=True)
    session.run("pytest", "tests/extension", *session.posargs)


@nox.session(python=PYTHON)
@nox.parametrize("debian", [None, "trixie", "sid"], ids=["path", "4.3", "5.2"])
def test_window(session: nox.Session, debian: str | None) -> None:
    """Use the extension in Blender's window: the one on the PATH, or Debian's 4.3 and 5.2."""
    provide_system_libraries(session)
    install_blender(session, "4.5", *PYTEST, *BUILD, "pillow>=11")
    choice = [f"--debian={debian}"] if debian else []
    session.run("pytest", "tests/gui", *choice, *session.posargs)


@nox.session(python=PYTHON)
def fuzz(session: nox.Session) -> None:
    """Look for failures with random input: ``nox -s fuzz -- --minutes 10``."""
    parser = argparse.ArgumentParser(prog="nox -s fuzz --")
    parser.add_argument("--minutes", type=float, default=10.0, help="begin no round after that")
    parser.add_argument("--seed", type=int, default=secrets.randbelow(2**32), help="of a round")
    parser.add_argument("--bounds", action="store_true", help="check all indices in kernels")
    options = parser.parse_args(session.posargs)
    provide_system_libraries(session)
    install(session, "-e", ".[blender,files,test]")
    env = {"SHOCK_FILTER_FUZZ": "long"}
    if options.bounds:
        env |= {"NUMBA_BOUNDSCHECK": "1", "NUMBA_CACHE_DIR": session.create_tmp()}
    end = time.monotonic() + 60 * options.minutes
    while True:
        again = f"--seed {options.seed}{' --bounds' if options.bounds else ''}"
        session.log(f"This round again: nox -s fuzz -- --minutes 0 {again}")
        session.run("pytest", *FUZZ_TESTS, f"--hypothesis-seed={options.seed}", env=env)
        options.seed += 1
        if time.monotonic() > end:
            break


@nox.session(python=PYTHON)
def translations(session: nox.Session) -> None:
    """Ask for translations of all texts on screen, before a release."""
    provide_system_libraries(session)
    install(session, "-e", ".[blender,files,test]")
    session.run("pytest", "tests/release", *session.posargs)


@nox.session(python=PYTHON)
def lint(session: nox.Session) -> None:
    """Check style, formatting, types, and which room uses which."""
    install(session, "-e", ".[dev]", "numpy<2")  # types differ between versions of numpy
    session.run("ruff", "check")
    session.run("ruff", "format", "--check")
    # Both take a package's name from its folder, and the root may be called anything.
    link = Path(session.create_tmp()) / "shock_filter"
    link.unlink(missing_ok=True)
    link.symlink_to(Path(__file__).parent, target_is_directory=True)
    session.run("mypy", env={"MYPYPATH": str(link.parent)})
    rooms = ("lint-imports", "--no-cache", "--no-logo")
    session.run(*rooms, env={"PYTHONPATH": str(link.parent)})


@nox.session(python=PYTHON)
def build(session: nox.Session) -> None:
    """Build the extension's zips for all platforms."""
    install_blender(session, "4.5", *BUILD)  # bpy for its blender_ext.py
    session.run("python", "tools/build_extension.py", *session.posargs)


@nox.session(python=PYTHON)
def release(session: nox.Session) -> None:
    """Make all that people install, in dist/release, from a commit that .ci/run has passed."""
    provide_system_libraries(session)
    install(session, "-e", ".[blender,files,test,docs,kernels,release]")
    session.run("python", "tools/release.py", *session.posargs)


def build_wheel(session: nox.Session) -> Path:
    """Build the wheel into a folder of the session's, and return it."""
    shutil.rmtree("build", ignore_errors=True)  # setuptools would add what lay there before
    folder = Path(session.create_tmp())
    pip(session, "wheel", "--no-deps", "--wheel-dir", str(folder), ".")
    return next(folder.glob("*.whl"))


@nox.session
@nox.parametrize(
    ("python", "oldest"),
    [("3.11", False), ("3.12", False), ("3.13", False), ("3.11", True)],
    ids=["3.11", "3.12", "3.13", "oldest"],
)
def wheel(session: nox.Session, oldest: bool) -> None:
    """Test the wheel in an environment of its own, with the newest or oldest allowed libraries."""
    allowed = [f"{name.replace('>=', '==')}.*" for name in PROJECT["dependencies"] if oldest]
    built = build_wheel(session)
    install(session, f"{built}[files,fields,video,cluster,test]", *allowed)
    session.run("shock-filter", "--help", silent=True)
    session.run("pytest", *WHEEL_TESTS, *session.posargs)


@nox.session(python=PYTHON)
@nox.parametrize("extra", EXTRAS, ids=EXTRAS)
def wheel_extra(session: nox.Session, extra: str) -> None:
    """Test that an extra of the wheel names all that it needs."""
    install(session, f"{build_wheel(session)}[{extra}]", *PYTEST)
    session.run("pytest", f"tests/wheel/test_{extra}.py", *session.posargs)


@nox.session(python=PYTHON)
def docs(session: nox.Session) -> None:
    """Build the documentation as a site and as the extension's manual; broken links fail."""
    install(session, *PROJECT["optional-dependencies"]["docs"])
    session.run("python", "tools/build_docs.py", *session.posargs)


@nox.session(python=PYTHON)
def bench(session: nox.Session) -> None:
    """Measure speed and quality against the paper and other programs."""
    install(session, "-e", ".[bench,files]")
    session.run("python", "benchmarks/paper.py", *session.posargs)  # stops without --data
    session.run("python", "benchmarks/geometry.py", *session.posargs)
    session.run("python", "benchmarks/textures.py", *session.posargs)
    session.run("python", "benchmarks/denoise.py", *session.posargs)
    session.run("python", "benchmarks/gradient_domain.py", *session.posargs)
    session.run("python", "benchmarks/fields.py", *session.posargs)
    session.run("python", "benchmarks/advection.py", *session.posargs)


@nox.session(python=PYTHON)
def bench_blender(session: nox.Session) -> None:
    """Measure Adjust Last Operation, canceling and enabling in Blender."""
    provide_system_libraries(session)
    install(session, "-e", ".[blender]")
    session.run("python", "benchmarks/redo.py", *session.posargs)
    session.run("python", "benchmarks/jobs.py")
    session.run("python", "benchmarks/enabling.py")
