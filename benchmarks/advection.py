# SPDX-License-Identifier: GPL-3.0-or-later
"""Measure and plot the advection of noise and dye, as in paper D.

``python benchmarks/advection.py`` measures all and prints tables.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterator
from contextlib import nullcontext
from typing import Any

import common
import cylinder
import numpy as np
import peers
import variants
from advection_literal import LiteralNoise
from PIL import Image
from report import Target, table, targets
from shock_filter import core
from shock_filter.core.advection.noise import Noise
from shock_filter.core.advection.velocity import Flow
from texture_models import BALL, read_model, save_model

LARGE = 1024
PAPER = {"advection": (39.0, 18.0, 4.1), "with a mask": (27.0, 10.5, 2.7),
         "with a mask and convolution": (11.6, 4.5, 1.1)}  # fmt: skip
"""Frames a second in the paper's Table 1, on four processors, at 300, 500 and 1000 squared."""

MASKED = {"speed_mask": 3.0, "noise_mask": 3.0}
OPTIONS = {"advection": {}, "with a mask": MASKED,
           "with a mask and convolution": MASKED | {"convolution": 6}}  # fmt: skip
BARS = dict(zip(OPTIONS, (150.0, 100.0, 25.0), strict=True))


def rotation(size: int) -> np.ndarray:
    """Counterclockwise around the middle."""
    y, x = np.mgrid[1 : -1 : size * 1j, -1 : 1 : size * 1j]
    return np.stack([-y, x], axis=-1)


def vortices(size: int) -> np.ndarray:
    """A flow with centers and saddles that goes out of the image and comes in."""
    y, x = np.mgrid[1 : -1 : size * 1j, -1 : 1 : size * 1j]
    right = -y + 0.6 * np.sin(6 * x + 1) + 0.8 * np.cos(4 * y)
    return np.stack([right, x + 0.7 * np.cos(5 * y - 1) - 0.6 * np.sin(7 * x)], axis=-1)


def last(frames: Iterator[np.ndarray]) -> np.ndarray:
    """Return the last of some frames."""
    return deque(frames, maxlen=1)[0]


def gray(values: np.ndarray) -> np.ndarray:
    """Return values from 0 to 1 as bytes."""
    return np.rint(255 * np.clip(values, 0.0, 1.0)).astype(np.uint8)


def beside(*pictures: np.ndarray) -> np.ndarray:
    """Put pictures beside each other."""
    gap = np.ones((len(pictures[0]), 6, *pictures[0].shape[2:]))
    parts = [part for picture in pictures for part in (gap, picture)]
    return np.concatenate(parts[1:], axis=1)


def timed_frames(size: int, frames: int, words: dict) -> tuple[float, float]:
    """Return the least seconds a frame takes, of wall clock and processor."""
    settings = core.NoiseSettings(step=6.0, **words)
    given = core.advect_noise(vortices(size), settings, frames=5 * frames + 1)
    next(given)
    found = []
    for _ in range(5):
        wall, processor = time.perf_counter(), time.process_time()
        for _ in range(frames):
            next(given)
        found.append((time.perf_counter() - wall, time.process_time() - processor))
    return tuple(np.min(found, axis=0) / frames)


def speed(job: common.Job) -> None:
    """Table 1."""
    rows, goals = [], []
    for option, words in OPTIONS.items():
        timed_frames(64, 2, words)
        for place, size in enumerate((300, 500, 1000, LARGE)):
            wall, processor = timed_frames(size, 20, words)
            paper = f"{PAPER[option][place]:.1f}" if size != LARGE else ""
            rows.append([option, f"{size}²", f"{1 / wall:.0f}", f"{1e3 * processor:.1f}", paper])
        bar = f"{LARGE}², {option}: frames a second"
        goals.append(Target(bar, 1 / wall, BARS[option], "{:.0f}", at_least=True))
    head = ["", "image", "frames a second", "processor, ms a frame", "paper, 4 processors"]
    text = "Best of five runs of 20 frames. The paper gives no longest step; ours is 6 pixels."
    job.page.write("speed", "\n\n".join([text, table(head, rows), targets(goals)]))


def convolution(job: common.Job) -> None:
    """A long line integral convolution beside rlic."""
    if not peers.installed("rlic"):
        return
    import rlic

    velocity = vortices(LARGE).astype(np.float32)
    right, up = np.ascontiguousarray(velocity[..., 0]), np.ascontiguousarray(velocity[..., 1])
    noise = np.random.default_rng(0).random((LARGE, LARGE), dtype=np.float32)
    settings = core.ConvolutionSettings(length=40, contrast=0.0)
    kernel = np.ones(41, dtype=np.float32)
    runs = {
        "line_integral_convolution": lambda: core.line_integral_convolution(
            velocity, noise=noise, settings=settings
        ),
        "rlic.convolve": lambda: rlic.convolve(noise, right, -up, kernel=kernel),
    }
    rows, times = [], {}
    for _ in range(4):
        for name, run in runs.items():
            wall, processor = time.perf_counter(), time.process_time()
            run()
            long = time.perf_counter() - wall, time.process_time() - processor
            times[name] = np.minimum(times.get(name, np.inf), long)
    for name, (wall, processor) in times.items():
        rows.append([name, f"{wall:.2f}", f"{processor:.2f}"])
    ratio = times["line_integral_convolution"][0] / times["rlic.convolve"][0]
    goals = [Target("time of ours by that of rlic", ratio, 0.7)]
    head = ["", "seconds", "processor, s"]
    text = f"{LARGE}², 41 samples, best of four runs in turns; rlic uses one core."
    drawn = core.line_integral_convolution(
        vortices(240), settings=core.ConvolutionSettings(length=30)
    )
    shown = job.page.picture("streaks", Image.fromarray(gray(drawn)).quantize(12),
                             "Streaks of 30 pixels")  # fmt: skip
    job.page.write("convolution", "\n\n".join([text, table(head, rows), targets(goals)]) + shown)


def on_surface(job: common.Job) -> None:
    """Frames of textures of 1024 squared."""
    rows, goals = [], []
    for name in ("spot", "blub") if job.data else (BALL,):
        path = job.scratch / f"{name}-{LARGE}.npz"
        common.in_own_process(save_model, path, job.data, name, LARGE)
        model = read_model(path)
        mesh = model.mesh()
        field = np.cross([0.0, 1.0, 0.0], mesh.vertices - mesh.vertices.mean(axis=0))
        for option, words in OPTIONS.items():
            settings = core.NoiseSettings(step=6.0, **words)
            start = time.perf_counter()
            given = core.advect_on_surface(
                mesh, model.uv, field, size=(LARGE, LARGE), settings=settings, frames=101
            )
            next(given)
            first = time.perf_counter() - start
            found = []
            for _ in range(5):
                wall, processor = time.perf_counter(), time.process_time()
                for _ in range(20):
                    next(given)
                found.append((time.perf_counter() - wall, time.process_time() - processor))
            wall, processor = np.min(found, axis=0) / 20
            rows.append([name, option, f"{first:.1f}", f"{1 / wall:.0f}", f"{1e3 * processor:.1f}"])
            if option == "advection":
                what = f"{name}, {LARGE}²: frames a second"
                goals.append(Target(what, 1 / wall, 25.0, "{:.0f}", at_least=True))
    head = ["model", "", "first frame, s", "frames a second", "processor, ms a frame"]
    text = "Best of five runs of 20 frames; the first frame includes all preparation."
    job.page.write("surface", "\n\n".join([text, table(head, rows), targets(goals)]))


def grown(frames: int) -> float:
    """Return by how many MiB memory grows in so many frames."""
    given = core.advect_noise(vortices(512), frames=frames)
    for _ in range(20):
        next(given)
    before = common.peak_memory()
    for _ in given:
        pass
    return (common.peak_memory() - before) / 2**20


def memory(job: common.Job) -> None:
    """Whether memory grows with the number of frames."""
    more = common.in_own_process(grown, 1000)
    goals = [Target("512²: MiB more after 1,000 frames than after 20", more, 8.0, "{:.1f}")]
    job.page.write("memory", targets(goals))


def haar_bands(cells: np.ndarray) -> np.ndarray:
    """Mean squares of the Haar coefficients by band, from fine to coarse."""
    image, bands = cells - 0.5, []
    while len(image) > 8:
        a, b, c, d = image[::2, ::2], image[::2, 1::2], image[1::2, ::2], image[1::2, 1::2]
        bands.append(
            np.mean([(a - b + c - d) ** 2, (a + b - c - d) ** 2, (a - b - c + d) ** 2]) / 4
        )
        image = (a + b + c + d) / 2
    return np.array(bands)


def spectrum(job: common.Job) -> None:
    """Figure 5: the spectrum of the noise after 500 frames, by injection."""
    size, frames = 256, 500
    rows, curves = [], {}
    flow = Flow(rotation(size), None, None, 2.0)
    motion = flow.at(0)
    for injection in (0.0, 0.02, 0.05, 0.1):
        settings = core.NoiseSettings(injection=injection, divergence=0.0)
        ours = Noise(flow.size, flow.longest, settings)
        literal = LiteralNoise(ours.cells, motion.right, motion.down, True, injection)
        first = haar_bands(ours.cells)
        both = {"ours": ours, "as in the paper": literal}
        spreads: dict[str, list[float]] = {name: [] for name in both}
        for number in range(frames):
            ours.step(motion, number)
            literal.step()
            if number % 50 == 49:
                for name, each in both.items():
                    spreads[name].append(np.ptp(haar_bands(each.cells) / first))
        bands = [haar_bands(each.cells) / first for each in (ours, literal)]
        for name, found in zip(("ours", "as in the paper"), bands, strict=True):
            share = f"{100 * injection:.0f} %"
            rows.append([share, name, *(f"{value:.2f}" for value in found)])
            rows[-1].append(f"{np.ptp(found):.2f}")
        if injection < 0.05:
            for name, spread in spreads.items():
                curves[f"{100 * injection:.0f} %, {name}"] = range(50, frames + 1, 50), spread
    head = ["injected", "", *(f"{2**k} px" for k in range(1, len(first) + 1)), "spread"]
    text = (
        f"Energy in each band of the Haar transform after {frames} frames, over that of the first,"
        f" in a rotation of at most 2 pixels a frame, {size}²; 1 is the ideal."
    )
    plot = job.page.plot("spectrum", curves, "frame", "spread of the bands", x_scale="linear")
    job.page.write("spectrum", "\n\n".join([text, table(head, rows, 2)]) + plot)


def gone(right: float, frames: int, how: str) -> float:
    """Return the mean displacement of the noise over all cells after some frames, in pixels."""
    size = 256
    columns = np.broadcast_to(np.arange(size), (size, size))
    field = np.full((size, size, 2), [right, 0.0])
    if how == "ours":
        settings = core.NoiseSettings(step=0, injection=0, divergence=0, periodic="both")
        flow = Flow(field, None, None, 0.0, "both")
        origin = np.zeros((size, size), dtype=int)
        for bit in range(8):  # cells hold 0 or 1: a number goes in as many runs as it has bits
            noise = Noise(flow.size, flow.longest, settings)
            noise.cells[:] = (columns >> bit) & 1
            noise._make_ready(-1)
            for number in range(frames):
                noise.step(flow.at(0), number)
            origin += noise.cells.astype(int) << bit
    else:
        steps = np.full((size, size), right)
        literal = LiteralNoise(columns, steps, 0 * steps, how == "in each cell")
        for _ in range(frames):
            literal.step()
        origin = literal.cells
    return float(np.mean((columns - origin + 16) % size - 16))


def slow(job: common.Job) -> None:
    """Figure 6: slow flow, by the treatment of the fractions of steps."""
    ways = ("left out", "in each cell", "ours")
    distance = 50
    rows, errors = [], []
    for right in (0.05, 0.1, 0.25, 0.5, 0.75, 1.0, 1.5):
        frames = round(distance / right)
        found = [gone(right, frames, how) for how in ways]
        rows.append([f"{right:g}", str(frames), *(f"{pixels:.1f}" for pixels in found)])
        errors.append(abs(found[-1] - right * frames))
    goals = [Target("largest error of ours, pixels", max(errors), 2.0, "{:.1f}")]
    size = 180
    flow = Flow(rotation(size), None, None, 2.0)
    motion = flow.at(0)
    pictures = []
    for carries in (False, True):
        cells = np.random.default_rng(0).integers(0, 2, (size, size))
        literal = LiteralNoise(cells, motion.right, motion.down, carries, 0.025)
        blended = np.full((size, size), 0.5)
        for _ in range(120):
            blended += 0.1 * (literal.step() - blended)
        pictures.append(0.5 + 0.18 / 0.0765 * (blended - 0.5))
    pictures.append(last(core.advect_noise(rotation(size), frames=120)))
    shown = job.page.picture(
        "slow", Image.fromarray(gray(beside(*pictures))).quantize(5),
        "Rotation of at most 2 pixels a frame: fractions left out, in each cell, ours",
    )  # fmt: skip
    head = ["pixels a frame", "frames", "fractions left out", "in each cell (paper)", "ours"]
    text = (
        f"Pixels that noise moves while a uniform flow moves {distance}, as a mean over all cells."
    )
    job.page.write("slow", "\n\n".join([text, table(head, rows), targets(goals)]) + shown)


def blending(job: common.Job) -> None:
    """Figure 7: blending; Figure 9: convolution of the frames."""
    size = 160
    frames = [
        last(
            core.advect_noise(vortices(size), core.NoiseSettings(step=2, blending=alpha), frames=3)
        )
        for alpha in (0.03, 0.1, 0.5, 1.0)
    ]
    text = job.page.picture("blending", Image.fromarray(gray(beside(*frames))).quantize(5),
                            "Blending 0.03, 0.1, 0.5 and 1")  # fmt: skip
    size = 256
    background = np.broadcast_to([0.05, 0.15, 0.35], (size, size, 3))
    frames = [
        last(core.advect_noise(
            vortices(size), core.NoiseSettings(step=6, convolution=length, **MASKED), frames=3,
            background=background,
        ))
        for length in (0, 6)
    ]  # fmt: skip
    text += job.page.picture("convolution", Image.fromarray(gray(beside(*frames))).quantize(10),
                             "A step of 6 pixels, without and with convolution")  # fmt: skip
    job.page.write("blending", text.strip())


def centroid(opacity: np.ndarray) -> np.ndarray:
    """Center of mass of the dye."""
    weights = opacity / opacity.sum()
    return np.array([(weights * places).sum() for places in np.indices(opacity.shape)])


INTEGRATIONS = {"euler": variants.first_order_dye, "midpoint": nullcontext}


def circles(job: common.Job) -> None:
    """Figure 11: whether dye closes a circle, by the order of steps."""
    rows, before = [], {}
    velocity = rotation(256)
    spot = core.DyeSource([(0.5, 0.75)], width=16, every=0)
    for steps in (24, 48, 96, 192):
        row = [str(steps)]
        for integration in INTEGRATIONS:
            turn = velocity * 2 * np.pi * 255 / 2 / steps
            settings = core.DyeSettings(step=0, sharpness=0)
            frames = core.advect_dye(turn, spot, settings, frames=steps + 1)
            with INTEGRATIONS[integration]():
                first = centroid(next(frames)[..., 3])
                apart = float(np.linalg.norm(centroid(last(frames)[..., 3]) - first))
            order = np.log2(before.get(integration, np.nan) / apart)
            row += [f"{apart:.2f}", "" if np.isnan(order) else f"{order:.1f}"]
            before[integration] = apart
        rows.append(row)
    line = core.DyeSource([(0.5, 0.7)], width=12, colors=[(0.8, 0.1, 0.1)])
    white = np.ones((256, 256))
    pictures = []
    for way in INTEGRATIONS.values():
        settings = core.DyeSettings(step=25)
        with way():
            frames = core.advect_dye(rotation(256), line, settings, frames=80, background=white)
            pictures.append(last(frames)[..., :3])
    shown = job.page.picture("circles", Image.fromarray(gray(beside(*pictures))).quantize(16),
                             "Dye in a rotation: first order, second order")  # fmt: skip
    head = ["steps a turn", "first order: pixels apart", "order", "second order", "order"]
    job.page.write("circles", table(head, rows) + shown)


def sharpening(name: str) -> Any:
    """Have dye sharpened by the paper's function, if the name says so."""
    return variants.rational_dye() if name.startswith("rational") else nullcontext()


def sharpness(job: common.Job) -> None:
    """Figures 12 and 13: spots of dye after a rotation."""
    size, step = 256, 8.0
    velocity = rotation(size)
    steps = round(2 * np.pi * np.hypot(1, 1) * 255 / 2 / step)
    ways = {"none": 0.0}
    for kind in ("rational", "shock"):
        ways |= {f"{kind}, {s:g}": s for s in (0.2, 0.5, 1.0)}
    rows, pictures = [], []
    for name, sharpness in ways.items():
        row = [name]
        settings = core.DyeSettings(step=step, sharpness=sharpness)
        for width in (4.0, 8.0, 16.0):
            spot = core.DyeSource([(0.5, 0.8)], width=width, every=0)
            frames = core.advect_dye(velocity, spot, settings, frames=steps + 1)
            with sharpening(name):
                first, end = next(frames)[..., 3], last(frames)[..., 3]
            overlap = np.minimum(first, end).sum() / np.maximum(first, end).sum()
            row += [f"{100 * end.sum() / first.sum():.0f}", f"{100 * overlap:.0f}"]
        rows.append(row)
        if name in ("none", "rational, 0.2", "shock, 0.2"):
            spots = [
                core.DyeSource(
                    [(0.5, y)], width=16 if y > 0.5 else 8, colors=[(0.8, 0.1, 0.1)], every=0
                )
                for y in (0.95, 0.85, 0.75, 0.65, 0.35, 0.25, 0.15, 0.05)
            ]
            frames = core.advect_dye(velocity, spots, settings, frames=steps + 1,
                                     background=np.ones((size, size)))  # fmt: skip
            with sharpening(name):
                pictures.append(last(frames)[..., :3])
    shown = job.page.picture("sharpness", Image.fromarray(gray(beside(*pictures))).quantize(16),
                             "Spots of 16 (above) and 8 pixels after a turn: not sharpened,"
                             " rational, shock")  # fmt: skip
    head = [
        "sharpening",
        *(f"{w} px: {what}, %" for w in (4, 8, 16) for what in ("dye", "overlap")),
    ]
    text = f"A rotation in {steps} frames; remaining dye, and overlap with the original spot."
    job.page.write("sharpness", "\n\n".join([text, table(head, rows)]) + shown)


def flow_round_a_cylinder(job: common.Job) -> None:
    """Figure 14: dye in an unsteady flow."""
    steps = 120
    fields = cylinder.key_frames(steps=steps)
    colors = [(0.85, 0.1, 0.1), (0.1, 0.25, 0.8)]
    spots = [core.DyeSource([(0.05, y)], width=20, colors=colors, every=20, lasting=10)
             for y in np.linspace(0.2, 0.8, 10)]  # fmt: skip
    size = 2 * cylinder.ROWS, 2 * cylinder.COLUMNS
    duration = (len(fields) - 1) * steps
    frames = core.flow_frames(
        fields, columns=size[1], width=cylinder.COLUMNS, duration=duration, step=4.0
    )
    rows, pictures = [], []
    for name, amount in {"none": 0.0, "rational, 0.2": 0.2, "shock, 0.2": 0.2}.items():
        settings = core.DyeSettings(step=4.0, sharpness=amount)
        with sharpening(name):
            frame = last(core.advect_dye(fields, spots, settings, frames=frames, size=size))
        opacity = frame[..., 3:]
        rows.append([name, f"{opacity.sum():.0f}",
                     f"{100 * ((opacity > 0.1) & (opacity < 0.9)).mean():.1f}"])  # fmt: skip
        behind = np.where(np.isnan(fields[0, ..., :1]), 0.3, 1.0).repeat(2, 0).repeat(2, 1)
        pictures.append(opacity * frame[..., :3] + (1 - opacity) * behind)
    noise = core.NoiseSettings(step=4.0, convolution=4, speed_mask=0.0)
    picture = last(core.advect_noise(fields, noise, frames=frames, size=size))
    pictures.append(np.repeat(picture[..., None], 3, axis=2))
    shown = np.concatenate([beside(*pictures[:2]), beside(*pictures[2:])])
    shown = Image.fromarray(gray(shown)).resize((780, 312), Image.Resampling.LANCZOS).quantize(24)
    text = job.page.picture("cylinder", shown, "Dye not sharpened, rational, shock; noise")
    head = ["sharpening", "dye, pixels", "soft, % of the image"]
    note = f"{len(fields)} key frames, {frames} frames of at most 4 pixels, Reynolds number 120."
    job.page.write("cylinder", "\n\n".join([note, table(head, rows)]) + text)


SECTIONS = {
    "speed": speed,
    "convolution": convolution,
    "surface": on_surface,
    "memory": memory,
    "spectrum": spectrum,
    "slow": slow,
    "blending": blending,
    "circles": circles,
    "sharpness": sharpness,
    "cylinder": flow_round_a_cylinder,
}


if __name__ == "__main__":
    parser = common.make_parser(__doc__, SECTIONS)
    common.measure(parser.parse_args(), SECTIONS, "advection")
