# SPDX-License-Identifier: GPL-3.0-or-later
"""Run a command again and again, killed before each thing that it does to the disk; then resume it.

``python killed_runs.py FOLDER SCENARIO`` prints what was wrong, and how many kills there were; with
"at once" as the scenario, what several runs in one folder said.
Processes are forked from one that has compiled all, so that each takes some milliseconds only.
"""

import contextlib
import gc
import io
import itertools
import json
import os
import shutil
import sys
import traceback
from pathlib import Path

import numpy as np
from PIL import Image
from shock_filter.core import cli
from shock_filter.core.files import staging

KILLED, AT_OPEN = 77, 78
WRITES = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND
CHANGES = {
    *("os.chmod", "os.link", "os.mkdir", "os.remove", "os.rename", "os.rmdir", "os.symlink"),
    *("os.truncate", "os.utime"),
}
PICTURES = ["sharpen-image", "in/*.png", "out/", "--time", "4", "--resume"]
GEOMETRY = ["--where", "everywhere", "--time", "4"]
PICTURE = ["sharpen-image", "in/a.png", "out/", "--time", "4", "--resume"]
MODEL = ["sharpen-geometry", "in/model.gltf", "out/model.gltf", *GEOMETRY, "--resume"]
FRAMES = ["visualize-flow", "in/flow.npy", "out/frames", "--frames", "3", "--resume"]
ZARR = ["sharpen-image", "in/big.zarr", "out/big.zarr", "--time", "4", "--resume"]
IN_PLACE = ["sharpen-geometry", "out/model.gltf", "out/model.gltf", *GEOMETRY, "--overwrite"]
ZARR_IN_PLACE = ["sharpen-image", "out/big.zarr", "out/big.zarr", "--time", "4", "--overwrite"]
BACKEND = cli.FileBackend()
PARSER = cli.build_parser(BACKEND)
ANOTHER = ["sharpen-image", "in/a.png", "out/another.png", "--time", "4", "--overwrite"]


def pictures():
    Path("in").mkdir()
    Path("out").mkdir()
    for number, name in enumerate("ab"):
        pixels = np.random.default_rng(number).integers(0, 256, (8, 8), np.uint8)
        Image.fromarray(pixels).save(f"in/{name}.png")


def model(folder="in"):
    """A bent sheet with two buffers and a texture in files of their own."""
    rows, columns = np.mgrid[:4, :4]
    points = np.stack([rows, columns, abs(rows - 1.5) ** 1.5], axis=2).reshape(-1, 3)
    points = points.astype("<f4")
    a = (4 * np.arange(3)[:, None] + np.arange(3)).reshape(-1)
    faces = np.concatenate([[a, a + 1, a + 5], [a, a + 5, a + 4]], axis=1).T.astype("<u2")
    blocks = {"points.bin": points.tobytes(), "faces.bin": faces.tobytes()}
    tree = {
        "asset": {"version": "2.0"},
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 16, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5123, "count": faces.size, "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": k, "byteLength": len(block)} for k, block in enumerate(blocks.values())
        ],
        "buffers": [{"uri": name, "byteLength": len(block)} for name, block in blocks.items()],
        "images": [{"uri": "textures/t.png"}],
    }
    Path(folder, "textures").mkdir()
    shutil.copyfile("in/a.png", f"{folder}/textures/t.png")
    for name, block in blocks.items():
        Path(folder, name).write_bytes(block)
    Path(folder, "model.gltf").write_text(json.dumps(tree))


def flow():
    np.save("in/flow.npy", np.ones((4, 4, 2)))


def zarr(folder="in"):
    from zarr import open_array

    pixels = np.random.default_rng(0).integers(0, 256, (8, 8), np.uint8)
    array = open_array(f"{folder}/big.zarr", mode="w", shape=(8, 8), chunks=(8, 8), dtype="u1")
    array[...] = pixels


def made_before(commands):
    for command in commands:
        assert run([*command, "--time", "5"]) == 0


class Scenario:
    """What is made at the start, what is run and killed, and what is run then."""

    def __init__(self, start, commands, then=None):
        self.start, self.commands, self.then = start, commands, then or commands


def start_new():
    pictures()
    model()


def start_again():
    start_new()
    made_before([PICTURE, MODEL])


def start_in_place():
    pictures()
    model("out")


def start_frames():
    pictures()
    flow()


def start_zarr():
    pictures()
    zarr()


def start_zarr_again():
    start_zarr()
    made_before([ZARR])


def start_zarr_in_place():
    pictures()
    zarr("out")


SCENARIOS = {
    "new": Scenario(start_new, [PICTURES, MODEL]),
    "again": Scenario(start_again, [PICTURE, MODEL]),
    "frames": Scenario(start_frames, [FRAMES]),
    "zarr": Scenario(start_zarr_again, [ZARR]),
    "in place": Scenario(start_in_place, [IN_PLACE], [ANOTHER]),
    "zarr in place": Scenario(start_zarr_in_place, [ZARR_IN_PLACE], [ANOTHER]),
}
"""In place the run is not repeated: a later one in that folder leaves all old or all new."""


class Killer:
    """Ends the process before its n-th change of the disk, or with half of it done."""

    def __init__(self, number, is_half):
        self.left, self.is_half, self.root = number, is_half, os.getcwd()
        sys.addaudithook(self)

    def __call__(self, event, given):
        if event == "open":
            path, _, flags = given
            if isinstance(path, int) or not (flags or 0) & WRITES:
                return
            if not os.path.abspath(os.fsdecode(path)).startswith(self.root):
                return
        elif event not in CHANGES:
            return
        self.left -= 1
        if self.left >= 0:
            return
        if self.is_half:
            self.left = sys.maxsize
            with contextlib.suppress(OSError):  # a folder, for a file without a name
                opened = os.open(path, flags, 0o666)
                os.write(opened, b"\n" if flags & os.O_APPEND else b"")
        os._exit(AT_OPEN if event == "open" else KILLED)


def run(command):
    staging._tidy.cache_clear()
    with contextlib.redirect_stdout(io.StringIO()):
        return cli.main(command, BACKEND)


def run_all(commands, number=None, is_half=False):
    """Run commands in a process of their own; returns its exit code."""
    child = os.fork()
    if child == 0:
        code = 99
        try:
            if number is None:
                staging._NEW = 0.0
            else:
                Killer(number, is_half)
            code = max(run(command) for command in commands)
        except BaseException:
            traceback.print_exc()
        os._exit(code)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def found():
    """All files in the output's folder; of records, their names."""
    files = sorted(path for path in Path("out").rglob("*") if path.name != "another.png")
    return {
        str(path): None
        if path.is_dir() or path.parent.name == ".shock-filter"
        else path.read_bytes()
        for path in files
    }


@contextlib.contextmanager
def beginning(folder, start):
    """A copy of the files at the start, with their times."""
    shutil.copytree(start, folder, symlinks=True)
    os.chdir(folder)
    try:
        yield
    finally:
        os.chdir(folder.parent)
        shutil.rmtree(folder)


def main(folder, name):
    scenario = SCENARIOS[name]
    start = folder / "start"
    start.mkdir()
    os.chdir(start)
    scenario.start()
    old = found()
    # All kills happen at one place, as records hold the names of what is read.
    place = folder / "place"
    with beginning(place, start):
        for command in scenario.commands:
            assert run(command) == 0  # here, so that all is compiled before the first fork
        new = found()
    assert old != new
    wanted = [new] if scenario.then is scenario.commands else [old, new]
    gc.freeze()  # no page is copied for it in a child
    faults = []
    for number in itertools.count():
        for is_half in (False, True):
            with beginning(place, start):
                killed = run_all(scenario.commands, number, is_half)
                if killed not in (KILLED, AT_OPEN):
                    print(json.dumps({"kills": number, "faults": faults, "code": killed}))
                    return
                between = sorted(found())
                code = run_all(scenario.then)
                if code != 0 or found() not in wanted:
                    faults.append([number, is_half, code, between, sorted(found())])
            if killed == KILLED:  # nothing but files that are opened can be half done
                break


def at_once(folder, count=3, times=5):
    """Resume one folder by several processes at once, again and again."""
    codes, texts = [], ""
    for number in range(times):
        place = folder / str(number)
        place.mkdir()
        os.chdir(place)
        start_new()
        warm = number == 0 and [run(command) for command in (PICTURES, MODEL)]
        if warm:
            shutil.rmtree("out")
            Path("out").mkdir()
        children = []
        for _ in range(count):
            child = os.fork()
            if child == 0:
                with open("said", "a") as said, contextlib.redirect_stderr(said):
                    os._exit(max(run(command) for command in (PICTURES, MODEL)))
            children.append(child)
        codes += [os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) for child in children]
        texts += Path("said").read_text()
        left = sorted(path.name for path in Path("out").iterdir())
        codes += [run(PICTURES), run(MODEL)]
    print(json.dumps({"codes": codes, "said": texts, "left": left}))


if __name__ == "__main__":
    cli.build_parser = lambda _: PARSER  # which would take half of the time of a run
    os.fsync = lambda _: None  # what a process wrote stays though it ends
    if sys.argv[2] == "at once":
        at_once(Path(sys.argv[1]).resolve())
    else:
        main(Path(sys.argv[1]).resolve(), sys.argv[2])
