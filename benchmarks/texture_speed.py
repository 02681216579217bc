# SPDX-License-Identifier: GPL-3.0-or-later
"""Speed and memory of sharpening textures, and Lagrange's filter beside it."""

from __future__ import annotations

import time
from pathlib import Path

import common
import numpy as np
import peers
from report import Target, table, targets
from shock_filter import core
from texture_models import BALL, Model, ball, find_seams, read_model, save_model

SIZES = {1024: 1.0, 2048: 4.0}
"""Per width of the image in texels, the seconds that analysis and filter may take."""

TIMES = [16.0, 256.0, 4096.0]
PEER_TIME = 256.0
PEER_SCALE = 3.0
MEBIBYTE = 2.0**20


def chosen(data: Path | None) -> list[str]:
    """Return the models that are timed: with few and with many charts."""
    return ["WaterBottle", "DamagedHelmet"] if data else [BALL]


def stored(job: common.Job, name: str, size: int) -> Path:
    """Make a model in its own process; return its file."""
    path = job.scratch / f"{name}-{size}.npz"
    if not path.exists():
        common.in_own_process(save_model, path, job.data, name, size)
    return path


def warm_up() -> None:
    """Load or compile all kernels."""
    tiny = ball(32, steps=2)
    core.sharpen_texture(tiny.mesh(), tiny.uv, tiny.image)


def timed_run(path: Path, runs: int) -> dict[str, float]:
    """Analyse and sharpen a stored model: the least seconds of each; and bytes."""
    warm_up()
    model = read_model(path)
    mesh = model.mesh()
    height, width = model.image.shape[:2]
    before = common.peak_memory()
    found: dict[str, float] = {}

    def note(what: str, seconds: float) -> None:
        found[what] = min(seconds, found.get(what, np.inf))

    for _ in range(runs):
        start = time.perf_counter()
        atlas = core.TextureAtlas(mesh, model.uv, size=(height, width))
        note("analysis", time.perf_counter() - start)
        analysed = common.peak_memory()
        for flow_time in TIMES:
            settings = core.TextureSettings(time=flow_time)
            start = time.perf_counter()
            core.sharpen_texture(mesh, model.uv, model.image, settings, atlas=atlas)
            note(f"t = {flow_time:g}", time.perf_counter() - start)
            found.setdefault("peak", common.peak_memory())
            found.setdefault("atlas bytes", analysed - before)
            found.setdefault("filter bytes", found["peak"] - analysed)
    return found | {
        "charts": atlas.report.charts,
        "active": np.count_nonzero(atlas.masks().active),
        "nodes": np.count_nonzero(atlas.sheet.nodes != -1),
        "sheet": atlas.sheet.nodes.size,
    }


def speed(job: common.Job) -> None:
    """Seconds and memory by size and flow time."""
    rows, bounds = [], []
    for name in chosen(job.data):
        for size, bound in SIZES.items():
            found = common.in_own_process(timed_run, stored(job, name, size), 3)
            filters = [found[f"t = {flow_time:g}"] for flow_time in TIMES]
            rows.append(
                [
                    name,
                    f"{found['charts']}",
                    f"{size}²",
                    f"{found['active']:,}",
                    f"{found['sheet']:,}",
                    f"{found['analysis']:.3f}",
                    *(f"{seconds:.3f}" for seconds in filters),
                    f"{found['peak'] / MEBIBYTE:.0f}",
                    f"{found['atlas bytes'] / found['sheet']:.0f}",
                    f"{found['filter bytes'] / found['sheet']:.0f}",
                ]
            )
            whole = found["analysis"] + max(filters)
            what = f"{name}, {size}²: seconds, analysis and slowest filter"
            bounds.append(Target(what, whole, bound))
    head = ["model", "charts", "image", "active texels", "nodes of the sheet", "analysis, s"]
    head += [f"t = {flow_time:g}, s" for flow_time in TIMES]
    head += ["peak, MiB", "atlas: bytes a node", "filter: bytes a node"]
    text = "Three channels of uint8, default settings but the time; best of three runs."
    job.page.write("speed", "\n\n".join([text, table(head, rows), targets(bounds)]))


def peer_run(path: Path) -> tuple[str, float, float]:
    """Run Lagrange's filter on a stored model: what it says, its seconds and its seam jump."""
    model = read_model(path)
    note = ""
    faces, uv = model.faces, model.uv
    try:
        image, seconds = peers.filter_texture(model.vertices, faces, uv, model.image, PEER_SCALE)
    except RuntimeError as error:
        u, v = np.moveaxis(uv[:, 1:] - uv[:, :1], -1, 0)
        upright = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0] > 0
        note = f"“{str(error).splitlines()[0]}”; {np.count_nonzero(~upright):,} faces left out"
        faces, uv = faces[upright], uv[upright]
        try:
            image, seconds = peers.filter_texture(
                model.vertices, faces, uv, model.image, PEER_SCALE
            )
        except RuntimeError:
            return f"{note}, and refused again", np.nan, np.nan
    rounded = np.rint(255 * np.clip(image, 0, 1)).astype(np.uint8)
    return note, seconds, seam_jump(model, rounded)


def seam_jump(model: Model, image: np.ndarray) -> float:
    """Mean difference of both sides along the seams of a model."""
    atlas = core.TextureAtlas(model.mesh(), model.uv, size=image.shape[:2])
    return find_seams(atlas).jump(image)


def own_run(path: Path) -> tuple[float, float]:
    """Sharpen a stored model: seconds from arrays to the image, and its seam jump."""
    warm_up()
    model = read_model(path)
    settings = core.TextureSettings(time=PEER_TIME, seams="continue")
    seconds = common.fastest(
        lambda: core.sharpen_texture(model.mesh(), model.uv, model.image, settings), 3
    )
    image = core.sharpen_texture(model.mesh(), model.uv, model.image, settings)
    return seconds, seam_jump(model, image)


def peer_speed(job: common.Job) -> None:
    """Lagrange's gradient-domain sharpening on the same meshes and images."""
    if not peers.installed("Lagrange"):
        return
    rows, ratios = [], []
    for name in ["blub", *chosen(job.data)] if job.data else [BALL]:
        for size in SIZES if job.everything else [1024]:
            path = stored(job, name, size)
            seconds, jump = common.in_own_process(own_run, path)
            note, theirs, their_jump = common.in_own_process(peer_run, path)
            rows.append([name, f"{size}²", f"{seconds:.2f}", f"{jump:.2f}"])
            if np.isnan(theirs):
                rows[-1] += ["", "", "", note]
                continue
            rows[-1] += [f"{theirs:.1f}", f"{their_jump:.2f}", f"{theirs / seconds:.0f}", note]
            ratios.append(Target(f"{name}, {size}²: Lagrange / ours", theirs / seconds, 1.0,
                                 "{:.1f}", at_least=True))  # fmt: skip
    head = ["model", "image", "ours, s", "jump at seams", "Lagrange, s", "jump at seams", "ratio"]
    head += ["what Lagrange says"]
    text = [
        f"Ours at t = {PEER_TIME:g}, mesh and atlas included; Lagrange's"
        f" `texproc.texture_filtering` with gradient_scale = {PEER_SCALE:g}.",
        table(head, rows),
        targets(ratios),
    ]
    if not job.everything:
        text.append("`--all` runs Lagrange at 2048², too.")
    job.page.write("peers", "\n\n".join(text))
