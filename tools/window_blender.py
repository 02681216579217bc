# SPDX-License-Identifier: GPL-3.0-or-later
"""Find a Blender that can open a window under a virtual screen, or make one.

``python3 tools/window_blender.py trixie FOLDER`` puts Debian 13's Blender 4.3 into a folder,
``sid`` the 5.2 of Debian's unstable: about 100 and 200 seconds, 1.2 GB each. Needs root on Debian.
The folder can be removed at any time: what is mounted into it is seen by its own processes only.
"""

from __future__ import annotations

import argparse
import os
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

SUITES = ["trixie", "sid"]
PROGRAMS = ["blender", "Xvfb", "xdotool"]
PACKAGES = ["blender", "python3-numpy", "xvfb", "xauth", "xdotool", "libgl1-mesa-dri", "libegl1"]
# Scripts that come with sid's Blender import these; its package does not ask for them.
EXTRA_PACKAGES = {"sid": ["python3-cattr", "python3-requests", "python3-zstandard"]}
SPACE = 3_000_000_000
MAKING_LIMIT = 900.0
"""Seconds for all steps of the making."""

SCREEN = """
mkdir -p /tmp/.X11-unix; cd "$HOME"; rm -f display
Xvfb -displayfd 3 -screen 0 1600x900x24 +extension GLX -nolisten tcp -fbdir . \
    3>display 2>xvfb.log &
for _ in $(seq 100); do [ -s display ] && break; sleep 0.1; done
DISPLAY=:$(cat display) "$@"; code=$?
kill $!; exit $code
"""
"""Runs a command on a screen of its own, whose picture lies in the home folder: Xvfb_screen0."""

CHROOT = """
mount -t proc proc "$1/proc" && mount -t tmpfs tmpfs "$1/tmp" && mount --bind "$2" "$1/mnt" || exit
root=$1; shift 2; exec chroot "$root" "$@"
"""
ISOLATED = ["unshare", "--mount", "--pid", "--fork", "--kill-child"]
"""Mounts and processes of what is started so end with it."""


class Unavailable(Exception):
    """Why there is no Blender with a window."""


@dataclass(frozen=True)
class WindowBlender:
    """A Blender that can open a window: in a folder with a system of its own, or installed.

    Attributes
    ----------
    root : Path or None
        The folder, if any.
    """

    root: Path | None

    def seen(self, work: Path) -> Path:
        """Return what Blender's own processes call the folder `work` that is handed to `run`."""
        return work if self.root is None else Path("/mnt")

    def run(
        self, work: Path, *command: str, screen: bool = False, limit: float = 60.0
    ) -> subprocess.CompletedProcess[str]:
        """Run a command that may write into `work`; after `limit` seconds it is killed.

        What it started is killed too. The return code is then negative.
        """
        if screen:
            command = ("sh", "-c", SCREEN, "sh", *command)
        home = self.seen(work)
        settings = {
            "HOME": home,
            "TMPDIR": home,  # where Blender reports its crashes
            "XDG_RUNTIME_DIR": home,
            "BLENDER_USER_RESOURCES": home / "resources",
            "LC_ALL": "C.UTF-8",
            "LIBGL_ALWAYS_SOFTWARE": "1",
            "GALLIUM_DRIVER": "llvmpipe",
        }
        command = ("env", *(f"{name}={value}" for name, value in settings.items()), *command)
        if self.root is not None:
            chroot = ("sh", "-c", CHROOT, "sh", str(self.root), str(work))
            command = (*ISOLATED, "--net", *chroot, *command)
        process = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
        )
        try:
            output, _ = process.communicate(timeout=limit)
        except (subprocess.TimeoutExpired, KeyboardInterrupt) as reason:
            os.killpg(process.pid, signal.SIGKILL)
            output, _ = process.communicate()
            if isinstance(reason, KeyboardInterrupt):
                raise
        return subprocess.CompletedProcess(command, process.returncode, output)

    def check(self, work: Path) -> None:
        """Start Blender on a screen; raises `Unavailable` if this system does not allow it."""
        done = self.run(work, "blender", "--version", screen=True)
        if done.returncode or not done.stdout.startswith("Blender"):
            last = (done.stdout.strip().splitlines() or ["no output"])[-1]
            raise Unavailable(f"it does not start: {last}")


def installed() -> WindowBlender:
    """Return the Blender on the PATH, which needs Xvfb and xdotool beside it."""
    missing = [program for program in PROGRAMS if shutil.which(program) is None]
    if missing:
        raise Unavailable(f"{' and '.join(missing)} cannot be found")
    return WindowBlender(None)


def provide(suite: str, folder: Path) -> WindowBlender:
    """Return the Blender of a Debian suite, which is put into `folder` unless it is there."""
    if os.geteuid() != 0:
        raise Unavailable("only root can use a Debian system in a folder")
    folder = folder.resolve()
    if not (folder / "usr" / "bin" / "blender").exists():
        part = folder.with_name(folder.name + ".part")
        shutil.rmtree(part, ignore_errors=True)
        _make(suite, part)
        part.rename(folder)
    return WindowBlender(folder)


def _make(suite: str, folder: Path) -> None:
    if shutil.which("apt-get") is None:
        raise Unavailable("one can be made on Debian only")
    mirrors = subprocess.run(
        ["apt-get", "indextargets", "--format", "$(REPO_URI)", "Origin: Debian", "Label: Debian"],
        capture_output=True,
        text=True,
    ).stdout.split()
    if not mirrors:
        raise Unavailable("this system has no Debian package source (try `apt-get update`)")
    folder.parent.mkdir(parents=True, exist_ok=True)
    if shutil.disk_usage(folder.parent).free < SPACE:
        raise Unavailable(f"{folder.parent} has less than {SPACE / 1e9:.0f} GB left")
    end = time.monotonic() + MAKING_LIMIT
    if shutil.which("debootstrap") is None:
        _step(end, "apt-get", "update")
        _step(end, "apt-get", "install", "--yes", "--no-install-recommends", "debootstrap")
    keyring = "/usr/share/keyrings/debian-archive-keyring.gpg"
    _step(
        end,
        *ISOLATED,
        *("debootstrap", "--variant=minbase", f"--keyring={keyring}", suite),
        *(str(folder), mirrors[0]),
    )
    _fill(suite, folder, end)


def _fill(suite: str, folder: Path, end: float) -> None:
    """Install Blender into a fresh system, without documentation and with its translations."""
    shutil.copy("/etc/resolv.conf", folder / "etc" / "resolv.conf")
    no_services = folder / "usr" / "sbin" / "policy-rc.d"
    no_services.write_text("#!/bin/sh\nexit 101\n", encoding="utf-8")
    no_services.chmod(0o755)
    (folder / "etc" / "dpkg" / "dpkg.cfg.d" / "small").write_text(
        "path-exclude=/usr/share/doc/*\npath-exclude=/usr/share/man/*\n"
        "path-exclude=/usr/share/locale/*\n"
        "path-include=/usr/share/locale/languages\n"
        "path-include=/usr/share/locale/*/LC_MESSAGES/blender.mo\n",
        encoding="utf-8",
    )
    packages = [*PACKAGES, *EXTRA_PACKAGES.get(suite, [])]
    # Clocks differ, and a package source may be a day old.
    options = ["-o", "Acquire::Check-Valid-Until=false", "-o", "Acquire::Retries=3"]
    for step in (
        ["apt-get", *options, "update"],
        ["apt-get", *options, "install", "--yes", "--no-install-recommends", *packages],
        ["apt-get", "clean"],
    ):
        environment = ["env", "DEBIAN_FRONTEND=noninteractive", "LC_ALL=C"]
        inside = ("sh", "-c", CHROOT, "sh", str(folder), str(folder / "mnt"))
        _step(end, *ISOLATED, *inside, *environment, *step)


def _step(end: float, *command: str) -> None:
    """Run one step of the making; its failure is no error, but there is no Blender then.

    It is stopped when `time.monotonic` reaches `end`.
    """
    try:
        done = subprocess.run(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            timeout=max(end - time.monotonic(), 0.0),
        )
    except subprocess.TimeoutExpired:
        limit = f"{MAKING_LIMIT:.0f} s after the beginning"
        raise Unavailable(f"`{' '.join(command)}` was still running {limit}") from None
    if done.returncode:
        last = (done.stdout.strip().splitlines() or ["no output"])[-1]
        raise Unavailable(f"`{' '.join(command)}` failed: {last}")


def main() -> None:
    """Make what the command line asks for."""
    parser = argparse.ArgumentParser(description="Put a Blender with a window into a folder.")
    parser.add_argument("suite", choices=SUITES)
    parser.add_argument("folder", type=Path)
    arguments = parser.parse_args()
    try:
        blender = provide(arguments.suite, arguments.folder)
    except Unavailable as reason:
        sys.exit(f"There is no Blender: {reason}.")
    print(blender.run(arguments.folder / "mnt", "blender", "--version").stdout.splitlines()[0])


if __name__ == "__main__":
    main()
