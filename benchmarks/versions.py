# SPDX-License-Identifier: GPL-3.0-or-later
"""Compare an earlier commit with this tree: seconds, longest wait for Esc, memory, enabling.

Both run the same public functions on the same arrays, in fresh processes by turns, so that a
machine whose speed drifts treats them alike. Needs git; enabling also needs bpy.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
SLOWEST = 1.05
ROUNDS = 5
RUNS = 3

# name: (what is sharpened, array of the input, runs in one process)
MESHES = {
    "geometry at its default, 134 K vertices": ("igea.ply", 0, False),
    "geometry at its default, 2.15 M vertices": ("igea.ply", 2, False),
    "geometry, 134 K vertices": ("igea.ply", 0, False),
    "geometry, 2.15 M vertices": ("igea.ply", 2, False),
    "geometry, 200 K vertices, thin triangles": ("dragon_50k.obj", 1, False),
    "geometry, 134 K vertices in random order": ("igea.ply", 0, True),
    "normals, 134 K vertices": ("igea.ply", 0, False),
    "colors, 134 K vertices": ("igea.ply", 0, False),
    "corner colors, 134 K vertices": ("igea.ply", 0, False),
    "denoising geometry, 35 K vertices": ("bunny.obj", 0, False),
    "denoising colors, 35 K vertices": ("bunny.obj", 0, False),
}


def work(case: str, arrays: dict[str, np.ndarray]) -> Callable[[Callable | None], object]:
    """Return what a case does, given a progress callback."""
    from shock_filter import core

    long = core.GeometrySettings(time=4096.0)
    if case.startswith("image"):
        settings = core.ImageSettings(time=1024.0)
        return lambda p: core.sharpen_image(arrays["image"], settings, progress=p)
    if case.startswith("denoising an image"):
        return lambda p: core.beltrami_image(arrays["image"], progress=p)
    vertices, faces = arrays["vertices"], arrays["faces"]
    if case.startswith("geometry at its default"):
        return lambda p: core.sharpen_geometry(
            core.TriangleMesh(vertices, faces, progress=p), progress=p
        )
    if case.startswith("geometry"):
        return lambda p: core.sharpen_geometry(
            core.TriangleMesh(vertices, faces, progress=p), long, mask=None, progress=p
        )
    if case.startswith("normals"):
        return lambda p: core.sharpen_normals(
            core.TriangleMesh(vertices, faces, progress=p), long, progress=p
        )
    if case.startswith("denoising geometry"):
        return lambda p: core.denoise_geometry(
            core.TriangleMesh(vertices, faces, progress=p), progress=p
        )
    if case.startswith("texture"):
        uv, image = arrays["uv"], arrays["image"]
        texture = core.TextureSettings(time=1024.0)
        return lambda p: core.sharpen_texture(
            core.TriangleMesh(vertices, faces, progress=p), uv, image, texture, progress=p
        )
    span = np.ptp(vertices, axis=0).max()
    colors = 0.5 + 0.5 * np.tanh(4 * np.sin(40 * vertices / span))
    settings = core.ShockSettings(time=4096.0)
    if case.startswith("denoising colors"):
        return lambda p: core.beltrami_vertex_signal(
            core.TriangleMesh(vertices, faces, progress=p), colors, progress=p
        )
    if case.startswith("corner colors"):
        return lambda p: core.sharpen_corner_signal(
            core.TriangleMesh(vertices, faces, progress=p),
            colors[faces],
            settings,
            mask=None,
            progress=p,
        )
    return lambda p: core.sharpen_vertex_signal(
        core.TriangleMesh(vertices, faces, progress=p), colors, settings, mask=None, progress=p
    )


def run_case(case: str, path: Path, runs: int) -> dict[str, float]:
    """Run a case in this process: seconds, longest wait for Esc, peak memory."""
    with np.load(path) as stored:
        arrays = {name: stored[name] for name in stored.files}
    function = work(case, arrays)
    function(None)  # loads or compiles the kernels
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    seconds, waits = [], []
    for _ in range(runs):
        asked = [time.perf_counter()]
        function(lambda fraction, message, asked=asked: asked.append(time.perf_counter()) or True)
        asked.append(time.perf_counter())
        seconds.append(asked[-1] - asked[0])
        waits.append(max(np.diff(asked)))
    return {"seconds": min(seconds), "wait": min(waits), "peak": peak}


def store(data: Path, scratch: Path, only: str) -> dict[str, Path]:
    """Write the arrays of all cases; return the file of each."""
    import common
    from texture_models import save_model

    files: dict[str, Path] = {}
    for case, (name, subdivisions, shuffle) in MESHES.items():
        if only not in case:
            continue
        path = scratch / f"{Path(name).stem}-{subdivisions}-{shuffle}.npz"
        if not path.exists():
            common.in_own_process(common.save_mesh, path, data, name, subdivisions, shuffle)
        files[case] = path
    photo = common.load_image(data, "flower.jpg")
    tall = np.tile(photo, (-(-1368 // photo.shape[0]), -(-1824 // photo.shape[1]), 1))
    files["image, 1368 x 1824 x 3"] = scratch / "image.npz"
    np.savez(files["image, 1368 x 1824 x 3"], image=tall[:1368, :1824])
    files["denoising an image, 512 x 512 x 3"] = scratch / "small.npz"
    np.savez(files["denoising an image, 512 x 512 x 3"], image=tall[:512, :512])
    files["texture, 1024 x 1024"] = scratch / "texture.npz"
    common.in_own_process(save_model, files["texture, 1024 x 1024"], data, "WaterBottle", 1024)
    return files


def in_tree(place: Path, *arguments: str) -> str:
    """Run this file in a process that imports the package from a place; return what it prints."""
    env = {**os.environ, "PYTHONPATH": str(place)}
    done = subprocess.run(
        [sys.executable, __file__, *arguments], env=env, capture_output=True, text=True, check=True
    )
    return done.stdout.splitlines()[-1]


def enabling(place: Path) -> float:
    """Milliseconds that enabling takes in a fresh bpy."""
    from enabling import CODE

    env = {**os.environ, "PYTHONPATH": str(place)}
    done = subprocess.run(
        [sys.executable, "-c", CODE], env=env, capture_output=True, text=True, check=True
    )
    (line,) = (line for line in done.stdout.splitlines() if line.startswith("MS "))
    return sum(map(float, line.split()[1:]))


def compare(places: dict[str, Path], data: Path, rounds: int, only: str) -> list[list[str]]:
    """Measure all cases in both trees by turns; return the rows of the table."""
    rows = []
    with tempfile.TemporaryDirectory() as scratch:
        for case, path in store(data, Path(scratch), only).items():
            if only not in case:
                continue
            found: dict[str, list[dict[str, float]]] = {name: [] for name in places}
            for turn in range(rounds + 1):
                for name, place in places.items():
                    runs = str(RUNS if turn else 1)
                    result = json.loads(in_tree(place, "--case", case, str(path), runs))
                    if turn:  # the first compiles
                        found[name].append(result)
            old, new = (
                {key: statistics.median(run[key] for run in runs) for key in runs[0]}
                for runs in found.values()
            )
            ratio = statistics.median(
                b["seconds"] / a["seconds"] for a, b in zip(*found.values(), strict=True)
            )
            rows.append([
                case, f"{old['seconds']:.3f}", f"{new['seconds']:.3f}", f"{ratio:.2f}",
                f"{1e3 * old['wait']:.0f}", f"{1e3 * new['wait']:.0f}",
                f"{old['peak']:.0f}", f"{new['peak']:.0f}",
            ])  # fmt: skip
            print("; ".join(rows[-1]), flush=True)
    return rows


def main() -> None:
    """Print the table, or write it into a page."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--case", nargs=3, metavar=("NAME", "FILE", "RUNS"), help=argparse.SUPPRESS)
    parser.add_argument("--old", default="HEAD", metavar="COMMIT", help="what to compare with")
    parser.add_argument(
        "--data", type=Path, metavar="FOLDER", help="what holds meshes/ and images/"
    )
    parser.add_argument("--write", type=Path, metavar="PAGE", help="put the table into this page")
    parser.add_argument("--rounds", type=int, default=ROUNDS, help="turns; %(default)s")
    parser.add_argument("--only", default="", metavar="TEXT", help="cases whose names hold it")
    options = parser.parse_args()
    if options.case:
        case, path, runs = options.case
        print(json.dumps(run_case(case, Path(path), int(runs))))
        return
    import common
    from report import Page, Target, table, targets

    with tempfile.TemporaryDirectory() as scratch:
        places = {name: Path(scratch, name) for name in ("old", "new")}
        for place in places.values():
            place.mkdir()
        tree = places["old"] / "shock_filter"
        subprocess.run(
            ["git", "-C", ROOT, "worktree", "add", "--detach", "--quiet", tree, options.old],
            check=True,
        )
        (places["new"] / "shock_filter").symlink_to(ROOT, target_is_directory=True)
        try:
            rows = compare(places, options.data, options.rounds, options.only)
            starts = {
                name: statistics.median(enabling(place) for _ in range(7))
                for name, place in places.items()
            }
        finally:
            subprocess.run(["git", "-C", ROOT, "worktree", "remove", "--force", tree], check=True)
    head = [
        "",
        "old, s",
        "new, s",
        "new / old",
        "old: longest wait, ms",
        "new",
        "old: peak, MB",
        "new",
    ]
    goals = [Target(f"{row[0]}: new / old", float(row[3]), SLOWEST) for row in rows]
    goals.append(Target("milliseconds for enabling", starts["new"], 20.0, "{:.1f}"))
    page = Page(options.write)
    page.write("versions", table(head, rows) + "\n\n" + targets(goals))
    print(f"Enabling: {starts['old']:.1f} ms old, {starts['new']:.1f} ms new")
    page.write("machine", common.machine())


if __name__ == "__main__":
    main()
