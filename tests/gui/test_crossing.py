# SPDX-License-Identifier: GPL-3.0-or-later
"""Files with live results go from one Blender to another and back, and show the same to the bit.

Debian's 4.3 and 5.2 are wanted, in the folders that ``--debian`` puts them into. Files of 5 can be
opened by 4.5 at least, so the way back leads over the Python package, if that is 4.5.
"""

import json
import os
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest
import window_blender

ROOT = Path(__file__).resolve().parents[2]
INSIDE = Path(__file__).parent / "inside"
SCRIPTS = "live_file.py", "live_seen.py"
KINDS = {"position", ".corner_vert", ".edge_verts"}
LAST = "11"
"""The frame in which files are saved."""


@dataclass
class Place:
    """A Blender, and the folder that it sees."""

    blender: window_blender.WindowBlender
    work: Path

    def run(self, script, *files, limit=240.0):
        """Run one of the scripts in this folder, on files in it."""
        seen = self.blender.seen(self.work)
        start = ["blender", "-b", "--python-exit-code", "1", "--python", str(seen / script)]
        names = [str(seen / name) for name in files]
        done = self.blender.run(self.work, *start, "--", *names, limit=limit)
        assert done.returncode == 0, done.stdout

    def look(self, file, new):
        """Return what is seen of a file, which is saved with another name."""
        self.run("live_seen.py", file, "seen.json", new)
        return json.loads((self.work / "seen.json").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def places(tmp_path_factory, extension_zip):
    """Return both Blenders, each with and without the extension, by their suites."""
    found = {}
    for suite in window_blender.SUITES:
        folder = ROOT / ".nox" / f"blender-{suite}"
        if not (folder / "usr" / "bin" / "blender").exists() or os.geteuid() != 0:
            pytest.skip(f"Debian {suite}'s Blender is not there: --debian {suite} makes it")
        for kind in ("plain", "with"):
            work = tmp_path_factory.mktemp(f"{kind}_{suite}")
            (work / "resources").mkdir()
            for name in SCRIPTS:
                shutil.copy(INSIDE / name, work)
            found[kind, suite] = Place(window_blender.provide(suite, folder), work)
        place = found["with", suite]
        shutil.copy(extension_zip, place.work)
        name = str(place.blender.seen(place.work) / extension_zip.name)
        install = ["blender", "--command", "extension", "install-file", "-r", "user_default"]
        done = place.blender.run(place.work, *install, "--enable", name, limit=240.0)
        assert done.returncode == 0, done.stdout
    return found


def carry(name, start, *ends):
    for end in ends:
        shutil.copy(start.work / name, end.work / name)


@pytest.fixture(scope="module", params=["trixie", "sid"])
def crossing(request, places):
    """Make a file in one Blender, and open it in the other, with the extension and without."""
    maker = request.param
    (other,) = set(window_blender.SUITES) - {maker}
    home = places["with", maker]
    home.run("live_file.py", f"{maker}.blend")
    reports = {"home": home.look(f"{maker}.blend", f"{maker}-again.blend")}
    carry(f"{maker}.blend", home, places["plain", maker])
    reports["plain"] = places["plain", maker].look(f"{maker}.blend", f"{maker}-plain.blend")
    name = f"{maker}.blend"
    if maker == "sid":
        name = between(places["plain", maker].work, reports, f"{maker}-plain.blend")
        if name is None:
            pytest.skip("the bpy package is none that opens files of 5 and saves them for 4.3")
        carry(name, places["plain", maker], places["plain", other], places["with", other])
    else:
        carry(name, home, places["plain", other], places["with", other])
    reports["there"] = places["plain", other].look(name, f"{other}-new.blend")
    reports["there, with"] = places["with", other].look(name, f"{other}-with.blend")
    back = f"{other}-new.blend"
    if other == "sid":
        back = between(places["plain", other].work, reports, back)
    if back is not None:
        carry(back, places["plain", other], places["plain", maker], places["with", maker])
        reports["back"] = places["plain", maker].look(back, "end.blend")
        reports["back, with"] = places["with", maker].look(back, "end-with.blend")
    return reports


def between(work, reports, name):
    """Open a file in the package, and save it; None if that is a Blender that cannot."""
    code = "import bpy; print(*bpy.app.version[:2])"
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    if said.stdout.split()[:2] != ["4", "5"]:
        return None
    target, new = work / "between.json", name.replace(".blend", "-4.5.blend")
    run = [sys.executable, str(work / "live_seen.py"), "--", str(work / name), str(target)]
    done = subprocess.run([*run, str(work / new)], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    reports["between"] = json.loads(target.read_text(encoding="utf-8"))
    return new


def test_all_show_the_same_to_the_bit(crossing):
    home = crossing["home"]["seen"]
    assert {"Masked", "Keyed", "Copy"} <= home["1"].keys()
    assert all(each.keys() >= KINDS for frame in home.values() for each in frame.values())
    for where, report in crossing.items():
        for frame, objects in report["seen"].items():
            assert objects.keys() == home[frame].keys()
            wanted = dict(home[frame])
            if report["version"] < "5" and where in after_5(crossing):
                wanted["Keyed"] = home[LAST]["Keyed"]
            for name, digests in objects.items():
                assert digests == wanted[name], (where, report["version"], frame, name)


def after_5(crossing):
    """Name what shows files that 5.2 has saved.

    It keeps keys of a modifier's inputs where earlier ones do not look for them: these show the
    value of the frame in which the file was saved.
    """
    names = list(crossing)
    first = next(n for n, each in enumerate(crossing.values()) if each["version"] >= "5")
    return names[first:]


def test_live_results_and_keys_are_what_is_compared(crossing):
    seen, below = crossing["home"]["seen"], crossing["home"]["below"]
    assert len({frame["Keyed"]["position"] for frame in seen.values()}) == 3
    assert seen["1"]["Keyed"]["position"] == below["Keyed"]["position"]
    for name, attribute in (("Masked", "position"), ("Masked", "Paint"), ("Copy", "position")):
        assert seen["1"][name][attribute] != below[name][attribute], (name, attribute)
    assert any("sharp_edge" in each for each in seen["11"].values())


def test_the_extension_takes_the_results_as_fresh(crossing):
    for where in ("there, with", "back, with"):
        if where in crossing:
            states = crossing[where]["states"]
            assert {states[name] for name in ("Masked", "Keyed", "Copy")} == {"fresh"}, where
