# SPDX-License-Identifier: GPL-3.0-or-later
"""Visibility of seams: measurements on models, and pictures of a generated one."""

from __future__ import annotations

import common
import numpy as np
from pictures import sheet
from report import Target, table, targets
from shock_filter import core
from texture_models import BALL, Model, ball, find_seams, load_model, names, painted
from texture_pictures import look, smaller, spot_at

TIMES = [16.0, 1024.0]
LEAST_RATIO = 5.0

_LEVELS = (1, 2, 4)
_PIXELS = 180
_TEXELS = 66.0
_STRETCH = 40  # samples of a seam that are looked at together


def results(model: Model, atlas: core.TextureAtlas) -> dict[str, np.ndarray]:
    """Filter a model's texture in all ways that are compared."""
    parts = atlas.mesh, model.uv
    filled = core.dilate_texture(
        *parts, model.image, core.DilateSettings(seams="continue"), atlas=atlas
    )
    found = {"input": model.image, "filled": filled}
    for time in TIMES:
        flat = core.ImageSettings(time=time)
        settings = core.TextureSettings(time=time, seams="continue")
        found[f"ours, t = {time:g}"] = core.sharpen_texture(
            *parts, model.image, settings, atlas=atlas
        )
        found[f"flat, t = {time:g}"] = core.sharpen_image(model.image, flat)
        found[f"filled, then flat, t = {time:g}"] = core.sharpen_image(filled, flat)
    return found


def seams(job: common.Job) -> None:
    """Differences of both sides of the seams, before and after."""
    rows, shares, ratios = [], [], []
    for name in names(job.data):
        model = load_model(job.data, name)
        kinds = {name: model}
        if name != BALL:
            kinds[f"{name}, pattern"] = painted(model)
        for label, kind in kinds.items():
            atlas = core.TextureAtlas(kind.mesh(), kind.uv, size=kind.image.shape[:2])
            places = find_seams(atlas)
            jumps = {what: places.jump(image) for what, image in results(kind, atlas).items()}
            ours = np.array([jumps[f"ours, t = {time:g}"] for time in TIMES])
            flat = np.array([jumps[f"flat, t = {time:g}"] for time in TIMES])
            shares.append(ours / jumps["input"])
            ratios.append(flat / ours)
            rows.append([label, f"{atlas.report.charts}", f"{len(kind.image)}²"])
            rows[-1] += [f"{jump:.3f}" for jump in jumps.values()]
            rows[-1] += [f"{ratio:.1f}" for ratio in ratios[-1]]
    head = ["model", "charts", "image", *jumps, *(f"flat / ours, t = {t:g}" for t in TIMES)]
    enough = (np.array(ratios) >= LEAST_RATIO).all(axis=1)
    own = np.array(["pattern" not in row[0] for row in rows])
    bounds = [Target("jump of ours / of the input, the worst of all", np.max(shares), 1.0)]
    if job.data:
        what = f"flat / ours at least {LEAST_RATIO:g} at both times:"
        count = {"bound": 3, "form": "{:.0f}", "at_least": True}
        bounds.append(Target(f"{what} models with their own texture", sum(enough & own), **count))
        bounds.append(Target(f"{what} models with a pattern", sum(enough & ~own), **count))
    job.page.write("seams", table(head, rows) + "\n\n" + targets(bounds))


def seam_pictures(job: common.Job) -> None:
    """A seam of the ball, near by, with the texture at full, half and quarter size."""
    model = ball(1024)
    atlas = core.TextureAtlas(model.mesh(), model.uv, size=model.image.shape[:2])
    found = results(model, atlas)
    long = f"{TIMES[-1]:g}"
    shown = {
        "before, filled": found["filled"],
        f"filled, flat, t = {long}": found[f"filled, then flat, t = {long}"],
        f"flat, t = {long}": found[f"flat, t = {long}"],
        f"ours, t = {long}": found[f"ours, t = {long}"],
    }
    places = find_seams(atlas)
    jumps = places.jumps(shown[f"filled, flat, t = {long}"])
    worst = int(np.argmax(np.convolve(jumps, np.ones(_STRETCH), mode="same")))
    spot = spot_at(atlas, places, worst)
    rows = [
        [look(atlas, smaller(image, level), spot, _TEXELS, _PIXELS) for image in shown.values()]
        for level in _LEVELS
    ]
    picture = job.page.picture(
        "seam",
        sheet(list(shown), rows, 1),
        "A seam from top to bottom: before, filtered flat with and without a filled gutter, and"
        " ours; the texture at full, half and quarter size",
    )
    job.page.write(
        "pictures",
        f"The ball's seam where the flat filter fails most, {_TEXELS:g} texels wide, drawn with"
        " linear sampling and no light; from top to bottom the texture at full, half and quarter"
        " size." + picture,
    )
