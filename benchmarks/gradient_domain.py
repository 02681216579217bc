# SPDX-License-Identifier: GPL-3.0-or-later
"""Compare the gradient-domain filter of textures with Lagrange's, which solves the same equations.

``python benchmarks/gradient_domain.py --data FOLDER`` measures all and prints tables. Without
data, a generated ball is used.
"""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import common
import numpy as np
import peers
from PIL import Image
from report import Target, table, targets
from shock_filter import core
from shock_filter.core.elements.matrices import TextureSpace
from texture_layouts import cut, plane
from texture_models import BALL, Model, ball, find_seams, names, read_model, save_model

SIZES = {1024: (0.7, 0.3, 1.2, 0.35), 2048: (2.8, 1.2, 5.0, 0.9)}
"""Per width of the image in texels, most seconds for the set-up, for new gains and end to end, and
most gibibytes above the process before."""

LARGEST = 4096
"""Width of the image that one run of ``--all`` filters in `MOST` gibibytes, all told."""

MOST = 4.0

GAINS = [0.0, 3.0]
WEIGHT = 1e3
"""Lagrange's weight of the values, on a surface of unit area."""

RATIO = 30.0
GIBIBYTE = 2.0**30


def chosen(job: common.Job) -> list[str]:
    """Return the models: one, or with ``--all`` all of them."""
    return names(job.data) if job.everything or not job.data else ["blub"]


def stored(job: common.Job, name: str, size: int) -> Path:
    """Make a model in its own process; return its file."""
    path = job.scratch / f"{name}-{size}.npz"
    if not path.exists():
        common.in_own_process(save_model, path, job.data, name, size)
    return path


def warm_up() -> None:
    """Load or compile all kernels."""
    tiny = ball(32, steps=2)
    for image in (tiny.image, tiny.image.astype(np.float32) / 255):
        solver = core.TextureSolver(tiny.mesh(), tiny.uv, image)
        solver.filtered()
        solver.filtered(np.full(image.shape[:2], 2.0))


def timed_run(path: Path, runs: int) -> dict[str, float]:
    """Set up and filter a stored model: the least seconds of each; and bytes."""
    warm_up()
    model = read_model(path)
    mesh = model.mesh()
    painted = np.full(model.image.shape[:2], 2.0)
    painted[: len(painted) // 2] = 0.5
    before = common.peak_memory()
    found: dict[str, float] = {}

    def timed(what: str, call: Any) -> Any:
        start = time.perf_counter()
        result = call()
        found[what] = min(time.perf_counter() - start, found.get(what, np.inf))
        return result

    for _ in range(runs):
        solver = timed("set-up", lambda: core.TextureSolver(mesh, model.uv, model.image))
        timed("first", solver.filtered)
        timed("painted", lambda solver=solver: solver.filtered(painted))
        timed("slider", lambda solver=solver: solver.filtered(1.5))
        del solver
    timed("whole", lambda: core.filter_texture(mesh, model.uv, model.image))
    most = common.peak_memory()
    return found | {"bytes": most - before, "whole bytes": most}


def speed(job: common.Job) -> None:
    """Seconds and memory by model and size."""
    rows, bounds = [], []
    for name in chosen(job):
        for size, (set_up, again, whole, memory) in SIZES.items():
            found = common.in_own_process(timed_run, stored(job, name, size), 2)
            columns = ("set-up", "first", "painted", "slider", "whole")
            rows.append([name, f"{size}²", *(f"{found[what]:.2f}" for what in columns)])
            rows[-1].append(f"{found['bytes'] / GIBIBYTE:.2f}")
            if name in ("blub", BALL):
                bounds += [
                    Target(f"{name}, {size}²: seconds for the set-up", found["set-up"], set_up),
                    Target(f"{name}, {size}²: seconds for new gains", found["painted"], again),
                    Target(f"{name}, {size}²: seconds end to end", found["whole"], whole),
                    Target(f"{name}, {size}²: GiB", found["bytes"] / GIBIBYTE, memory),
                ]
    if job.everything:
        name = "blub" if job.data else BALL
        found = common.in_own_process(timed_run, stored(job, name, LARGEST), 1)
        rows.append([name, f"{LARGEST}²", *(f"{found[what]:.2f}" for what in columns)])
        rows[-1].append(f"{found['bytes'] / GIBIBYTE:.2f}")
        whole = found["whole bytes"] / GIBIBYTE
        bounds.append(Target(f"{name}, {LARGEST}²: GiB of the process", whole, MOST))
    head = ["model", "image", "set-up, s", "first result, s", "painted gains, s"]
    head += ["another gain, s", "end to end, s", "memory, GiB"]
    text = "Three channels of uint8, default settings; best of two runs, in a process each."
    job.page.write("speed", "\n\n".join([text, table(head, rows), targets(bounds)]))


def run_of(path: Path, gain: float, ours: bool, out: Path) -> dict[str, Any]:
    """Filter a stored model by one of both programs: clocks, memory, and the image in a file."""
    model = read_model(path)
    mesh = model.mesh()
    pixels = model.image.astype(np.float32) / 255
    atlas = core.TextureAtlas(mesh, model.uv, size=pixels.shape[:2])
    radius = float(np.sqrt(TextureSpace(atlas).area / WEIGHT))
    if ours:
        warm_up()
    before = common.peak_memory()
    wall, processor = time.perf_counter(), time.process_time()
    if ours:
        settings = core.FilterSettings(gain=gain, radius=radius, seams="continue")
        image = core.filter_texture(mesh, model.uv, pixels, settings)
    else:
        given = model.vertices, model.faces, model.uv, model.image
        try:
            image, _ = peers.filter_texture(*given, gain, WEIGHT)
        except RuntimeError as error:
            return {"note": str(error).splitlines()[0]}
    found = {
        "wall": time.perf_counter() - wall,
        "processor": time.process_time() - processor,
        "bytes": common.peak_memory() - before,
        "jump": find_seams(atlas).jump(image),
    }
    np.save(out, image)
    return found


def peer(job: common.Job) -> None:
    """The same equations solved by Lagrange, in the same run."""
    if not peers.installed("Lagrange"):
        return
    rows, goals, picture = [], [], ""
    for name in chosen(job):
        for size in (512, 1024):
            for gain in GAINS if size == 512 else GAINS[1:]:
                path = stored(job, name, size)
                files = [job.scratch / f"{who}.npy" for who in ("ours", "theirs")]
                ours = common.in_own_process(run_of, path, gain, True, files[0])
                theirs = common.in_own_process(run_of, path, gain, False, files[1])
                rows.append([name, f"{size}²", f"{gain:g}", f"{ours['wall']:.2f}"])
                if "note" in theirs:
                    rows[-1] += [*[""] * 5, f"{ours['jump']:.0e}", "", f"“{theirs['note']}”"]
                    continue
                model, images = read_model(path), [np.load(file) for file in files]
                atlas = core.TextureAtlas(model.mesh(), model.uv, size=(size, size))
                off = 255 * (images[0] - images[1])[atlas.inside]
                ratio = theirs["processor"] / ours["processor"]
                rows[-1] += [
                    f"{theirs['wall']:.1f}",
                    f"{theirs['wall'] / ours['wall']:.0f}",
                    f"{ratio:.0f}",
                    f"{theirs['bytes'] / ours['bytes']:.1f}",
                    f"{np.sqrt(np.mean(off**2)):.3f}",
                    f"{ours['jump']:.0e}",
                    f"{theirs['jump']:.0e}",
                    "NaN in its result" if np.isnan(images[1][atlas.inside]).any() else "",
                ]
                if name in ("blub", BALL) and size == 512:
                    what = f"{name}, gain {gain:g}: root mean square difference, of 255"
                    goals.append(Target(what, np.sqrt(np.mean(off**2)), 0.1, "{:.3f}"))
                if name in ("blub", BALL) and size == 1024:
                    goals += [
                        Target(f"{name}, {size}²: {what}", value, bound, "{:.1f}", at_least=True)
                        for what, value, bound in (
                            ("Lagrange's processor time / ours", ratio, RATIO),
                            ("Lagrange's time / ours", theirs["wall"] / ours["wall"], RATIO),
                            ("Lagrange's memory / ours", theirs["bytes"] / ours["bytes"], 3.0),
                        )
                    ]
                    picture = show(job, model, images)
    head = ["model", "image", "gain", "ours, s", "Lagrange, s", "ratio", "processor time, ratio"]
    head += ["memory, ratio", "difference, of 255", "our jump", "its jump", "what Lagrange says"]
    job.page.write("peer", "\n\n".join([table(head, rows), targets(goals)]) + picture)


def show(job: common.Job, model: Model, images: list[np.ndarray]) -> str:
    """Put the input, both results and twenty times their difference side by side."""
    ours, theirs = images
    atlas = core.TextureAtlas(model.mesh(), model.uv, size=ours.shape[:2])
    apart = 20 * np.abs(ours - theirs) * atlas.inside[..., None]
    row = np.concatenate([model.image / 255, ours, theirs, apart], axis=1)[::-1]
    picture = Image.fromarray(np.rint(255 * np.clip(row, 0, 1)).astype(np.uint8))
    picture = picture.resize((1600, 400), Image.Resampling.LANCZOS)
    about = "The input, ours, Lagrange's, and 20 times their difference."
    return job.page.picture("peer", picture, about)


def convergence(job: common.Job) -> None:
    """Waves on a square, in one chart and in 16 turned ones, against the exact solution."""
    rows, goals = [], []
    last: dict[str, float] = {}
    for texels in (32, 64, 128):
        mesh, one, many = plane(16, texels)
        for what, parts in (("1 chart", one), ("16 charts", many)):
            layout = cut(mesh, parts, True)
            error = wave_error(layout.atlas, layout.uv, texels)
            order = np.log2(last[what] / error) if what in last else np.nan
            rows.append(
                [what, f"{texels}²", f"{error:.1e}", "" if np.isnan(order) else f"{order:.2f}"]
            )
            last[what] = error
    goals.append(Target("order in 16 charts", order, 1.8, at_least=True))
    both = last["16 charts"] / last["1 chart"]
    goals.append(Target("error in 16 charts / in one", both, 1.5))
    text = "A wave of two by one periods, smoothed (gain 0, radius an eighth of the side)."
    head = ["layout", "texels", "error, of the change", "order"]
    job.page.write("convergence", "\n\n".join([text, table(head, rows), targets(goals)]))


def wave_error(atlas: core.TextureAtlas, uv: np.ndarray, texels: int) -> float:
    """Error of a smoothed wave against the exact one, relative to what smoothing changes."""
    mesh, radius = atlas.mesh, texels / 8
    x, y, _ = np.moveaxis(atlas.bake(mesh.vertices[mesh.faces]), -1, 0) * np.pi / texels
    wave = np.cos(2 * x) * np.cos(4 * y)
    settings = core.FilterSettings(gain=0.0, radius=radius)
    found = core.filter_texture(mesh, uv, wave, settings, atlas=atlas)
    share = 1.0 / (1.0 + radius**2 * (4 + 16) * (np.pi / texels) ** 2)
    error = (found - share * wave)[atlas.inside]
    return float(np.sqrt(np.mean(error**2)) / np.std((1 - share) * wave[atlas.inside]))


SECTIONS = {"speed": speed, "peer": peer, "convergence": convergence}


if __name__ == "__main__":
    parser = common.make_parser(__doc__, SECTIONS)
    common.measure(parser.parse_args(), SECTIONS, "gradient_domain")
