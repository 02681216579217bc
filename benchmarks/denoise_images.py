# SPDX-License-Identifier: GPL-3.0-or-later
"""Noisy photos compared with other programs, the kernel's shape, and images on their manifold."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import common
import numpy as np
import variants
from denoise_distances import grid_distances
from image_peers import available, timed
from pictures import View, draw, sheet
from report import Target, table, targets
from shock_filter import core
from shock_filter.core.settings import BETA_UNKNOWN
from skimage import data as photos

NOISE = 0.1
PHOTOS = {"astronaut": (20, 150), "coffee": (90, 190), "chelsea": (20, 100)}
"""Photos that come with scikit-image, and the corner of the part that is filtered."""

SIDE = 256
Setting = tuple[float, ...]
Filter = Callable[[np.ndarray], np.ndarray]


def noisy_pair(name: str, sigma: float = NOISE) -> tuple[np.ndarray, np.ndarray]:
    """A part of a photo, clean and noisy, (SIDE, SIDE, 3) float32 in [0, 1]."""
    top, left = PHOTOS[name]
    photo = getattr(photos, name)()[top : top + SIDE, left : left + SIDE]
    clean = photo.astype(np.float32) / 255
    noise = np.random.default_rng(0).normal(0, sigma, clean.shape)
    return clean, np.clip(clean + noise, 0, 1).astype(np.float32)


def psnr(image: np.ndarray, clean: np.ndarray) -> float:
    """Peak signal-to-noise ratio in decibels, of values in [0, 1]."""
    return -10 * math.log10(np.square(image - clean, dtype=np.float64).mean())


def ours(beta: float, time: float, iterations: float, distance: str) -> Filter:
    """Our filter."""
    settings = core.BeltramiSettings(beta=beta, time=time, iterations=iterations)

    def apply(image: np.ndarray) -> np.ndarray:
        with variants.distances(distance):
            return core.beltrami_image(image, settings)

    return apply


def opencv(sigma_color: float, sigma_space: float, times: float) -> Filter:
    """OpenCV's bilateral filter, on its own result so many times."""
    import cv2

    def apply(image: np.ndarray) -> np.ndarray:
        for _ in range(int(times)):
            image = cv2.bilateralFilter(image, -1, sigma_color, sigma_space)
        return image

    return apply


def skimage_bilateral(sigma_color: float, sigma_space: float) -> Filter:
    """scikit-image's bilateral filter."""
    from skimage.restoration import denoise_bilateral

    return lambda image: denoise_bilateral(
        image, sigma_color=sigma_color, sigma_spatial=sigma_space, mode="edge", channel_axis=-1
    )


def total_variation(weight: float) -> Filter:
    """scikit-image's total variation denoising."""
    from skimage.restoration import denoise_tv_chambolle

    return lambda image: denoise_tv_chambolle(image, weight=weight, channel_axis=-1)


@dataclass(frozen=True)
class Method:
    """A filter and the settings that are tried."""

    title: str
    make: Callable[..., Filter]
    names: list[str]
    tried: list[Setting]

    def label(self, setting: Setting) -> str:
        """Write settings on a line."""
        pairs = zip(self.names, setting, strict=False)
        return ", ".join(f"{name} {value:g}" for name, value in pairs)


def methods() -> Iterator[Method]:
    """All methods; ours try Keep Edges 7 first."""
    default = core.BeltramiSettings(beta=BETA_UNKNOWN)
    first = (default.beta, default.time, default.iterations)
    names = ["beta", "time", "iterations"]
    geodesic = [(6, 1, 2), (8, 1.25, 2), (10, 1.5, 2), (12, 2, 2), (10, 1, 3), (5, 1.5, 1)]
    euclidean = [(6, 1, 2), (8, 1, 2), (10, 1.25, 2), (11, 1.5, 2), (15, 2, 2), (11, 1, 3)]
    for distance, more in (("geodesic", geodesic), ("euclidean", euclidean)):

        def make(*setting: float, distance: str = distance) -> Filter:
            return ours(*setting, distance)

        yield Method(f"ours, {distance}, Keep Edges 7", make, names, [first])
        yield Method(f"ours, {distance}, best", make, names, [first, *more])
    sigmas = ["sigma color", "sigma space", "times"]
    spaces = (1.0, 1.5, 2.0, 3.0)
    if available("cv2", "opencv-python-headless"):
        for times, colors in ((1, (0.3, 0.4, 0.5, 0.6, 0.8)), (2, (0.2, 0.25, 0.3, 0.4, 0.5))):
            tried = [(color, space, times) for color in colors for space in spaces]
            title = "OpenCV bilateral, best" + (", twice" if times == 2 else "")
            yield Method(title, opencv, sigmas, tried)
    tried = [(color, space) for color in (0.03, 0.04, 0.05, 0.07) for space in (1.0, 2.0, 3.0)]
    yield Method("scikit-image bilateral, best", skimage_bilateral, sigmas, tried)
    weights = [(0.05,), (0.07,), (0.1,), (0.14,), (0.2,)]
    yield Method("scikit-image total variation, best", total_variation, ["weight"], weights)


@dataclass(frozen=True)
class Best:
    """The best result of a method on a photo."""

    psnr: float
    seconds: float
    setting: str
    image: np.ndarray


def search(method: Method, clean: np.ndarray, noisy: np.ndarray) -> Best:
    """Try all settings of a method."""
    values = {setting: psnr(method.make(*setting)(noisy), clean) for setting in method.tried}
    best = max(values, key=values.get)
    result, seconds = timed(method.make(*best), noisy)
    return Best(psnr(result, clean), seconds, method.label(best), result)


def betas(job: common.Job) -> None:
    """The best beta for each noise level, from no noise on."""
    tried = (4, 5, 7, 10, 15, 20, 30)
    default = core.BeltramiSettings()
    rows = []
    for sigma in (0.0, 0.02, 0.05, 0.1, 0.15):
        clean, noisy = noisy_pair("astronaut", sigma)
        values = [
            psnr(ours(beta, default.time, default.iterations, "geodesic")(noisy), clean)
            for beta in tried
        ]
        cells = [f"**{v:.1f}**" if v == max(values) else f"{v:.1f}" for v in values]
        rows.append([f"{sigma:g}", f"{psnr(noisy, clean):.1f}" if sigma else "", *cells])
    job.page.write(
        "betas",
        "PSNR of a part of the astronaut, dB, with the other settings at their defaults.\n\n"
        + table(["noise", "noisy", *(f"beta {beta}" for beta in tried)], rows),
    )


def images(job: common.Job) -> None:
    """Peak signal-to-noise ratio on noisy photos, ours and other programs' at their best."""
    pairs = {name: noisy_pair(name) for name in PHOTOS}
    rows, best = [], {}
    before = [f"{psnr(noisy, clean):.2f}" for clean, noisy in pairs.values()]
    rows.append(["noisy photo", *before, "", ""])
    for method in methods():
        found = [search(method, *pair) for pair in pairs.values()]
        best[method.title] = found
        values = [f"{result.psnr:.2f}" for result in found]
        chosen = "; ".join(dict.fromkeys(result.setting for result in found))
        seconds = np.mean([result.seconds for result in found])
        rows.append([method.title, *values, f"{seconds:.3f}", chosen])
    text = [
        f"Parts of {SIDE} x {SIDE} pixels of photos that come with scikit-image, with normal noise"
        f" of {NOISE} in each channel, cut to [0, 1]; PSNR in decibels. *Best* is the best of a"
        " coarse search for each photo, with the clean photo known. Seconds are the mean over the"
        " photos, of the fastest of three runs each.",
        table(["filter", *PHOTOS, "seconds", "settings"], rows),
    ]
    bilateral = [title for title in best if title.endswith("bilateral, best")]
    goals = []
    for i, name in enumerate(PHOTOS):
        rival = max(best[title][i].psnr for title in bilateral)
        for title in ("ours, geodesic, best", "ours, euclidean, best"):
            ahead = best[title][i].psnr - rival
            what = f"{name}: {title}, dB ahead of other bilateral filters"
            goals.append(Target(what, ahead, 0.0, at_least=True))
    text.append(targets(goals))
    job.page.write("images", "\n\n".join(text) + photo_picture(job))


CROP = (slice(20, 148), slice(20, 148))


def photo_picture(job: common.Job) -> str:
    """The paper's Figure 5: a photo, with noise, and after one and two iterations."""
    clean, noisy = noisy_pair("astronaut")
    default = core.BeltramiSettings(beta=BETA_UNKNOWN)
    once, twice = (ours(default.beta, default.time, count, "geodesic")(noisy) for count in (1, 2))
    straight = ours(default.beta, default.time, 2, "euclidean")(noisy)
    tiles = [_bytes(image[CROP]) for image in (clean, noisy, once, twice, straight)]
    titles = ["photo", "with noise", "one iteration", "two iterations", "two, euclidean"]
    about = "A photo: original, noisy, after one and two iterations, and with euclidean distances"
    return job.page.picture("photo", sheet(titles, [tiles], 2).quantize(128), about)


def _bytes(values: np.ndarray) -> np.ndarray:
    return np.rint(255 * np.clip(values, 0, 1)).astype(np.uint8)


def shapes_image() -> np.ndarray:
    """A disc, a thin line, a corner and a ramp, gray, (96, 96) in [0, 1]."""
    y, x = np.mgrid[:96, :96]
    image = np.full((96, 96), 0.5)
    image[np.hypot(y - 30, x - 30) < 16] = 0.9
    image[abs(x + y - 130) < 2] = 0.1
    image[60:, :36] = 0.15
    ramp = (y > 62) & (x > 66)
    image[ramp] = (0.5 + 0.4 * (x - 66) / 30)[ramp]
    return image


SPOTS = [(12, 60), (30, 44), (30, 24), (64, 32), (54, 44), (58, 72), (82, 84), (80, 52)]
LEVELS = [0.8, 0.5, 0.2, 0.05, 0.01]


def kernels(job: common.Job) -> None:
    """The paper's Figure 6: level sets of the kernel in a synthetic image."""
    image, beta, time = shapes_image(), 30.0, 6.0
    steep = beta * image[..., None]
    y, x = np.mgrid[:96, :96]
    tiles = []
    for distance in ("geodesic", "euclidean"):
        shown = np.repeat(_bytes(image)[..., None], 3, axis=2)
        for spot in SPOTS:
            straight = (y - spot[0]) ** 2 + (x - spot[1]) ** 2 + (steep - steep[spot])[..., 0] ** 2
            if distance == "geodesic":
                squares = grid_distances(steep, *spot, 2 * math.sqrt(-time * math.log(0.01)), True)
                squares = squares**2
            else:
                squares = straight
            weights = np.exp(-squares / (4 * time))
            for number, level in enumerate(reversed(LEVELS)):
                share = number / (len(LEVELS) - 1)
                shown[weights >= level] = [235, 200 * (1 - share), 60 * (1 - share)]
        tiles.append(shown)
    plain = np.repeat(_bytes(image)[..., None], 3, axis=2)
    for spot in SPOTS:
        plain[spot] = [235, 0, 0]
    picture = job.page.picture(
        "kernels",
        sheet(["image", "geodesic", "euclidean"], [[plain, *tiles]], 3).quantize(64),
        "Level sets of the kernel at eight places, geodesic and euclidean",
    )
    levels = ", ".join(f"{level:g}" for level in LEVELS)
    job.page.write(
        "kernels",
        f"A synthetic image of 96 x 96 pixels, beta = {beta:g}, time = {time:g}; the kernel's"
        f" weights at the marked places, in bands at {levels} of the largest weight." + picture,
    )


def relief() -> tuple[np.ndarray, np.ndarray]:
    """Blocks of random heights, each height with its color: heights (96, 96) in pixels, image."""
    labels = np.random.default_rng(3).integers(0, 3, (6, 6)).repeat(16, axis=0).repeat(16, axis=1)
    colors = np.array([[0.92, 0.72, 0.66], [0.78, 0.84, 0.72], [0.70, 0.74, 0.92]])
    return 6.0 * labels, colors[labels]


def mean_step(embedding: np.ndarray) -> float:
    """The mean distance between neighbours along the axes: the unit on manifolds."""
    steps = [np.linalg.norm(np.diff(embedding, axis=axis), axis=2).ravel() for axis in (0, 1)]
    return float(np.concatenate(steps).mean())


def snr(image: np.ndarray, clean: np.ndarray) -> float:
    """Signal-to-noise ratio in decibels."""
    return 10 * math.log10(clean.var(axis=(0, 1)).sum() / ((image - clean) ** 2).mean((0, 1)).sum())


TIME_STEP, STEPS = 0.5, 16
LISTED = [0, 1, 2, 4, 8, 16]
SHOWN = [0, 2, 4, 16]


def manifold(job: common.Job) -> None:
    """The paper's Figures 7 and 8: an image on its manifold, and flat."""
    height, clean = relief()
    noisy = clean + np.random.default_rng(0).normal(0, NOISE, clean.shape)
    y, x = np.mgrid[:96, :96].astype(float)
    embedding = np.stack([x, -y, height], axis=-1)
    unit, beta = mean_step(embedding), 3.0
    flat = core.BeltramiSettings(time=TIME_STEP, beta=beta, iterations=1)
    curved = core.BeltramiSettings(time=TIME_STEP / unit**2, beta=beta / unit, iterations=1)
    flats, curves = [noisy], [noisy]
    for _ in range(STEPS):
        flats.append(core.beltrami_image(flats[-1], flat))
        curves.append(core.beltrami_manifold(curves[-1], embedding, curved)[0])
    times = [TIME_STEP * step for step in range(STEPS + 1)]
    found = {
        "on its manifold": [snr(image, clean) for image in curves],
        "flat": [snr(image, clean) for image in flats],
    }
    rows = [
        [f"{times[step]:g}", *(f"{values[step]:.2f}" for values in found.values())]
        for step in LISTED
    ]
    on, off = found.values()
    goals = [
        Target("best SNR on the manifold less flat, dB", max(on) - max(off), 0.0, at_least=True),
        Target("lost after the best, flat less on the manifold, dB",
               (max(off) - off[-1]) - (max(on) - on[-1]), 0.0, at_least=True),
    ]  # fmt: skip
    text = [
        "Blocks of three heights, 6 pixels apart, each with its color, 96 x 96 pixels; noise of"
        f" {NOISE}, beta = {beta:g}, steps of {TIME_STEP:g}. Lengths are in pixels for both. SNR"
        " in decibels by the whole time T:",
        table(["T", *found], rows),
        targets(goals),
    ]
    curves_shown = {label: (times, values) for label, values in found.items()}
    plot = job.page.plot("snr", curves_shown, "time T", "SNR, dB", x_scale="linear",
                         y_scale="linear")  # fmt: skip
    rows_shown = [
        [draw_relief(embedding, images[step]) for step in SHOWN] for images in (flats, curves)
    ]
    picture = job.page.picture(
        "manifold",
        sheet([f"T = {times[step]:g}" for step in SHOWN], rows_shown, 1).quantize(128),
        "A noisy image on blocks, smoothed as a flat image (top) and on the blocks (bottom)",
    )
    job.page.write("manifold", "\n\n".join(text) + plot + picture)


def draw_relief(embedding: np.ndarray, image: np.ndarray) -> np.ndarray:
    """Draw a grid of points with its image."""
    index = np.arange(embedding[..., 0].size).reshape(embedding.shape[:2])
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    halves = [np.stack(corners, axis=-1).reshape(-1, 3) for corners in ((a, b, c), (a, c, d))]
    mesh = core.TriangleMesh(embedding.reshape(-1, 3), np.concatenate(halves))
    colors = image.reshape(-1, 3)[mesh.faces].mean(axis=1)
    return draw(mesh, mesh, View((-35.0, 25.0, 0.0), size=1.05), 220, colors)
