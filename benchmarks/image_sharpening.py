# SPDX-License-Identifier: GPL-3.0-or-later
"""Errors of sharpened degraded pictures: trained networks, by width, and unsharp masks.

``python benchmarks/image_sharpening.py --photos FOLDER``. Pictures are scikit-image's, photos in
the folder, and drawings made here from other seeds than those of the training. An oracle chooses
the best of nine unsharp masks for each spoiled picture. ``--steady`` changes pictures gradually,
and measures how the result follows; ``--speed`` measures the time of a large photo.
"""

from __future__ import annotations

import argparse
import io
import time
import zlib
from pathlib import Path
from typing import NamedTuple

import numpy as np
from PIL import Image
from report import Page, table
from scipy import ndimage
from shock_filter import core
from shock_filter.core.color.image_sharpening import measure_image

SIZE = 288
PHOTOS = "astronaut", "coffee", "chelsea", "camera", "moon", "brick", "grass", "gravel", "coins"
PHOTOS += "rocket", "clock_motion"
DRAWINGS = "page", "text", "horse", "phantom", "logo", "color"
SEEDS = 41, 42, 43, 44
SCREENS = [*(f"window/4.3-{name}" for name in
             ("colors", "denoise", "geometry", "image-editor-image", "in-german", "presets")),
           *(f"benchmarks/{name}" for name in ("creases-steadiness", "speed", "time", "tracing")),
           "denoise/kernels", "denoise/snr", "guide/times", "paper/figure7"]  # fmt: skip
"""Of the documentation: Blender's windows, and plots."""

BOX, CUBIC, LANCZOS = Image.Resampling.BOX, Image.Resampling.BICUBIC, Image.Resampling.LANCZOS


def as_bytes(values: np.ndarray) -> np.ndarray:
    """Round to bytes."""
    return np.rint(values).clip(0, 255).astype(np.uint8)


def drawing(seed: int) -> np.ndarray:
    """Flat shapes and lines in random colors, drawn at four times the size."""
    random = np.random.default_rng(seed)
    fine = 4 * SIZE
    y, x = np.mgrid[:fine, :fine]
    image = np.full((fine, fine, 3), random.uniform(0, 1, 3))
    for number in range(16):
        row, column = random.uniform(0, fine, 2)
        angle = random.uniform(0, np.pi)
        across = (x - column) * np.cos(angle) + (y - row) * np.sin(angle)
        along = (y - row) * np.cos(angle) - (x - column) * np.sin(angle)
        size = random.uniform(20, 220)
        away = np.hypot(across, along)
        if number % 2:
            away = np.maximum(abs(across), abs(along) * random.uniform(0.6, 1.6))
        if number % 5 == 4:
            away = np.where(abs(across) < 12, 0, 1e9)
        image[away < size] = random.uniform(0, 1, 3)
    return image.reshape(SIZE, 4, SIZE, 4, 3).mean(axis=(1, 3)) * 255


def rings() -> np.ndarray:
    """Rings and rays with fading fills."""
    n = 4 * SIZE
    y, x = (np.mgrid[:n, :n] - n / 2 + 0.5) / n
    angle, away = np.arctan2(y, x), np.hypot(x, y)
    a = (np.sin(12 * angle) > 0) ^ (np.sin(40 * away) > 0)
    red = np.where(a, 0.25 + 0.5 * (x + 0.5), 0.9 - 0.3 * away)
    green = np.where(a, 0.3 + 0.4 * (y + 0.5), 0.8 - 0.6 * away)
    blue = np.where(a, 0.6, 0.3 + 0.3 * (x + 0.5))
    return np.stack([red, green, blue], 2).reshape(SIZE, 4, SIZE, 4, 3).mean((1, 3)) * 255


def loaded(path: Path) -> np.ndarray:
    """Read a picture as bytes, on white where it is transparent."""
    with Image.open(path) as image:
        if image.mode in ("RGBA", "LA", "P"):
            image = image.convert("RGBA")
            under = Image.new("RGBA", image.size, "white")
            return np.asarray(Image.alpha_composite(under, image).convert("RGB"))
        gray = image.mode in ("L", "1", "I", "F", "I;16")
        return np.asarray(image.convert("L" if gray else "RGB"))


def middle(pixels: np.ndarray) -> np.ndarray:
    """Cut out the middle."""
    row, column = (max(length // 2 - SIZE // 2, 0) for length in pixels.shape[:2])
    return np.ascontiguousarray(pixels[row : row + SIZE, column : column + SIZE])


def pictures(folder: Path | None) -> dict[str, dict[str, np.ndarray]]:
    """Collect photos and drawings by name."""
    import skimage

    data = Path(skimage.__file__).parent / "data"
    photos = {path.stem: loaded(path) for path in sorted(folder.glob("*.*g"))} if folder else {}
    photos |= {name: loaded(next(data.glob(f"{name}.*"))) for name in PHOTOS}
    drawings = {name: loaded(next(data.glob(f"{name}.*"))) for name in DRAWINGS}
    drawings |= {f"shapes{seed}": as_bytes(drawing(seed)) for seed in SEEDS}
    drawings["rings"] = as_bytes(rings())
    images = Path(__file__).resolve().parent.parent / "docs" / "images"
    screens = {name: loaded(images / f"{name}.png") for name in SCREENS}
    groups = {"photos": photos, "drawings": drawings, "screens": screens}
    return {
        kind: {name: middle(pixels) for name, pixels in group.items()}
        for kind, group in groups.items()
    }


def blur(image: np.ndarray, sigma: float) -> np.ndarray:
    """Blur by a Gaussian."""
    extra = (0,) * (image.ndim - 2)
    return ndimage.gaussian_filter(image.astype(float), (sigma, sigma, *extra), mode="mirror")


def convolved(image: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Blur by the weights of a point's picture."""
    weights = weights[..., None] if image.ndim == 3 else weights
    return ndimage.convolve(image.astype(float), weights, mode="mirror")


def disk(radius: float) -> np.ndarray:
    """Weights of a lens out of focus."""
    n = int(np.ceil(radius))
    y, x = np.mgrid[-n : n + 1, -n : n + 1]
    weights = np.clip(radius + 0.5 - np.hypot(y, x), 0, 1)
    return weights / weights.sum()


def motion(length: float, degrees: float) -> np.ndarray:
    """Weights of a camera that moved."""
    n = int(np.ceil(length / 2)) + 1
    weights = np.zeros((2 * n + 1, 2 * n + 1))
    for t in np.linspace(-length / 2, length / 2, 101):
        y, x = n + t * np.sin(np.radians(degrees)), n + t * np.cos(np.radians(degrees))
        i, j = int(y), int(x)
        for a in (0, 1):
            for b in (0, 1):
                weights[i + a, j + b] += abs(1 - a - (y - i)) * abs(1 - b - (x - j))
    return weights / weights.sum()


def jpeg(image: np.ndarray, quality: int) -> np.ndarray:
    """Store as JPEG."""
    file = io.BytesIO()
    Image.fromarray(as_bytes(image)).save(file, "JPEG", quality=quality)
    with Image.open(file) as stored:
        return np.asarray(stored)


def scaled(image: np.ndarray, factor: int, down, up) -> np.ndarray:
    """Reduce and enlarge."""
    h, w = image.shape[:2]
    small = Image.fromarray(image).resize((round(w / factor), round(h / factor)), down)
    return np.asarray(small.resize((w, h), up))


def noise(image: np.ndarray, sigma: float, name: str) -> np.ndarray:
    """Add white noise, of its own for each name."""
    random = np.random.default_rng(zlib.crc32(name.encode()))
    return image + random.normal(0, sigma, image.shape)


SPOILINGS = {
    "sharp": lambda i, n: i,
    "Gauss 1": lambda i, n: blur(i, 1.0),
    "Gauss 2": lambda i, n: blur(i, 2.0),
    "Gauss 3.5": lambda i, n: blur(i, 3.5),
    "disk 3": lambda i, n: convolved(i, disk(3.0)),
    "motion 5": lambda i, n: convolved(i, motion(5.0, 30.0)),
    "Gauss 1.5, JPEG 75": lambda i, n: jpeg(blur(i, 1.5), 75),
    "Gauss 0.7, JPEG 50": lambda i, n: jpeg(blur(i, 0.7), 50),
    "Gauss 1.5, noise 3": lambda i, n: noise(blur(i, 1.5), 3.0, n),
    "Gauss 1, noise 8": lambda i, n: noise(blur(i, 1.0), 8.0, n),
    "x2, cubic": lambda i, n: scaled(i, 2, BOX, CUBIC),
    "x2, Lanczos": lambda i, n: scaled(i, 2, LANCZOS, LANCZOS),
    "x4, cubic": lambda i, n: scaled(i, 4, BOX, CUBIC),
}  # fmt: skip


def fidelity(image: np.ndarray, truth: np.ndarray) -> float:
    """PSNR in decibels."""
    error = ((image.astype(float) - truth) ** 2).mean()
    return float(10 * np.log10(255.0**2 / max(error, 1e-3)))


def likeness(image: np.ndarray, truth: np.ndarray) -> float:
    """SSIM of the brightness."""
    from skimage.metrics import structural_similarity

    gray = [i.astype(float).mean(2) if i.ndim == 3 else i.astype(float) for i in (image, truth)]
    return float(structural_similarity(*gray, data_range=255))


def best_unsharp(image: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Return the best of nine unsharp masks."""
    masks = []
    for sigma in (1.0, 2.0, 3.0):
        away = image - blur(image, sigma)
        masks += [as_bytes(image + amount * away) for amount in (0.5, 1.0, 2.0)]
    return max(masks, key=lambda result: fidelity(result, truth))


def by_width(image: np.ndarray) -> np.ndarray:
    """Sharpen by the measured width, as what the image is measured to be."""
    return core.sharpen_image(image, core.ImageSettings(what=measure_image(image).what))


class Case(NamedTuple):
    """The results of a spoiled picture: PSNR and SSIM of each way, and PSNR to the input."""

    kind: str
    name: str
    spoiling: str
    scores: dict[str, tuple[float, float]]
    changed: dict[str, float]


WAYS = {"learned": core.sharpen_image, "by width": by_width}


def cases(groups: dict[str, dict[str, np.ndarray]]) -> list[Case]:
    """Sharpen all pictures in all ways."""
    found = []
    for kind, group in groups.items():
        for name, truth in group.items():
            for spoiling, spoil in SPOILINGS.items():
                given = as_bytes(spoil(truth, name + spoiling))
                results = {way: work(given) for way, work in WAYS.items()}
                results |= {"input": given, "unsharp": best_unsharp(given, truth)}
                scores = {k: (fidelity(r, truth), likeness(r, truth)) for k, r in results.items()}
                changed = {way: fidelity(results[way], given) for way in WAYS}
                found.append(Case(kind, name, spoiling, scores, changed))
    return found


def gain(case: Case, way: str) -> float:
    """Decibels over the input."""
    return case.scores[way][0] - case.scores["input"][0]


def tables(found: list[Case]) -> str:
    """Mean gains of each spoiling, and how many pictures become worse."""
    ways = [*WAYS, "unsharp"]
    rows = []
    for kind in ("photos", "drawings", "screens"):
        mine = [case for case in found if case.kind == kind]
        spoiled = [case for case in mine if case.spoiling != "sharp"]
        sharp = [case for case in mine if case.spoiling == "sharp"]
        for spoiling in SPOILINGS:
            some = [case for case in spoiled if case.spoiling == spoiling]
            if some:
                mean = [np.mean([gain(case, way) for case in some]) for way in ways]
                rows.append([kind, spoiling, *(f"{g:+.2f}" for g in mean)])
        each = {way: np.array([gain(case, way) for case in spoiled]) for way in ways}
        rows.append([kind, "**mean**", *(f"**{each[way].mean():+.2f}**" for way in ways)])
        for limit in (0.1, 0.5):
            worse = [str((each[way] < -limit).sum()) for way in ways]
            rows.append([kind, f"worse by over {limit} dB, of {len(spoiled)}", *worse])
        least = [f"{each[way].min():+.2f}" for way in ways]
        rows.append([kind, "least gain", *least])
        best = [str((each[way] >= each["unsharp"]).sum()) for way in WAYS]
        rows.append([kind, "at or above the unsharp mask", *best, ""])
        alike = [np.mean([case.scores[way][1] for case in spoiled]) for way in ["input", *ways]]
        rows.append([kind, f"SSIM (input {alike[0]:.3f})", *(f"{a:.3f}" for a in alike[1:])])
        for what, of in (("mean", np.mean), ("least", np.min)):
            kept = [of([min(case.changed[way], 60) for case in sharp]) for way in WAYS]
            rows.append([kind, f"sharp: PSNR to the input, {what}", *(f"{k:.1f}" for k in kept),
                         ""])  # fmt: skip
        same = [str(sum(case.changed[way] > 75 for case in sharp)) for way in WAYS]
        rows.append([kind, f"sharp: bit for bit, of {len(sharp)}", *same, ""])
    spoiled = [case for case in found if case.spoiling != "sharp"]
    lost = [gain(case, "learned") - gain(case, "by width") for case in spoiled]
    rows.append(["", "learned worse than by width by over 0.5 dB",
                 f"{sum(d < -0.5 for d in lost)} of {len(lost)}", "", ""])  # fmt: skip
    return table(["", "", *ways], rows, words=2)


def steadiness() -> str:
    """Measure how results change while a texture on shapes grows evenly: rms in per mille."""
    random = np.random.default_rng(5)
    f = np.hypot(np.fft.fftfreq(SIZE)[:, None], np.fft.rfftfreq(SIZE)[None])
    f[0, 0] = np.inf
    texture = np.fft.irfft2(np.exp(2j * np.pi * random.random(f.shape)) / f, (SIZE, SIZE))
    texture = (255 * texture / texture.std())[..., None]
    frames = [as_bytes(blur(drawing(45) + a * texture, 1.5)) for a in np.arange(0, 0.0501, 0.001)]
    rows = []
    for way, work in WAYS.items():
        size = [np.sqrt(((work(f).astype(float) - f) ** 2).mean()) / 0.255 for f in frames]
        rows.append([way, f"{min(size):.1f} to {max(size):.1f}",
                     f"{np.abs(np.diff(size)).max():.2f}"])  # fmt: skip
    return table(["", "size of the change", "its greatest step"], rows)


def seconds(folder: Path) -> str:
    """Measure the time of a large photo: the least of three runs."""
    path = next(iter(sorted(folder.glob("kodim*"))))
    image = np.asarray(Image.open(path).convert("RGB").resize((1824, 1368), CUBIC))
    found: dict[str, list[float]] = {way: [] for way in WAYS}
    for _ in range(4):
        for way, work in WAYS.items():
            begin = time.perf_counter()
            work(image)
            found[way].append(time.perf_counter() - begin)
    return table(["", "seconds"], [[way, f"{min(t[1:]):.2f}"] for way, t in found.items()])


def main() -> None:
    """Print the tables, or write them into the page."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--photos", type=Path, help="folder with further photos")
    parser.add_argument("--write", type=Path, help="folder of the page to write the tables into")
    parser.add_argument("--steady", action="store_true", help="only the steadiness")
    parser.add_argument("--speed", action="store_true", help="only the time; needs --photos")
    options = parser.parse_args()
    page = Page(options.write and options.write / "benchmarks.md")
    if options.speed:
        page.write("image-seconds", seconds(options.photos))
    elif options.steady:
        page.write("image-steadiness", steadiness())
    else:
        page.write("image-sharpening", tables(cases(pictures(options.photos))))


if __name__ == "__main__":
    main()
