# SPDX-License-Identifier: GPL-3.0-or-later
"""How well What and Width of images find and close borders, against fixed times and unsharp masks.

Drawings are made by code, photos are those of scikit-image and of a folder. They are blurred,
enlarged, compressed and made noisy, and sharpened as what they are measured to be; what comes back
is compared with what was there.
"""

from __future__ import annotations

import argparse
import io
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import numpy.typing as npt
from PIL import Image
from report import Page, table
from scipy import ndimage
from scipy.special import erf
from shock_filter import core
from shock_filter.core.color.image_sharpening import measure_image

Bytes = npt.NDArray[np.uint8]
Floats = npt.NDArray[np.float64]

SIZE = 256
SEEDS = range(41, 47)
"""Seeds of drawings that were not used to tune What and Width."""

PHOTOS = {
    "astronaut": (10, 120),
    "rocket": (100, 200),
    "motorcycle_left": (150, 300),
    "camera": (60, 150),
    "grass": (50, 50),
    "gravel": (100, 100),
    "ihc": (100, 100),
    "coins": (20, 60),
}
"""Photos of scikit-image that the dials were not made on, and the corner of the part taken."""

WIDTH = 6.0
TIMES = 0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 4.0
WIDTH_OF_SIGMA = 2.5631


def drawing(seed: int, contrast: float = 1.0) -> Bytes:
    """Flat shapes in random colors, antialiased."""
    random = np.random.default_rng(seed)
    fine = 4 * SIZE
    y, x = np.mgrid[:fine, :fine]
    image = np.full((fine, fine, 3), random.uniform(0, 1, 3))
    for number in range(14):
        row, column = random.uniform(0, fine, 2)
        angle = random.uniform(0, np.pi)
        across = (x - column) * np.cos(angle) + (y - row) * np.sin(angle)
        along = (y - row) * np.cos(angle) - (x - column) * np.sin(angle)
        size = random.uniform(60, 220)
        away = np.hypot(across, along)
        if number % 2:
            away = np.maximum(abs(across), abs(along) * random.uniform(0.6, 1.6))
        image[away < size] = random.uniform(0, 1, 3)
    mean = image.reshape(SIZE, 4, SIZE, 4, 3).mean(axis=(1, 3))
    return _bytes(255.0 * (0.5 + contrast * (mean - 0.5)))


def photos(folder: Path | None) -> dict[str, Bytes]:
    """Load those of scikit-image, and the middles of those in a folder."""
    import skimage

    data = Path(skimage.__file__).parent / "data"
    found = {}
    for name, (row, column) in PHOTOS.items():
        path = next(data.glob(f"{name}.*"))
        pixels = np.asarray(Image.open(path).convert("RGB"))
        found[name] = pixels[row : row + SIZE, column : column + SIZE]
    for path in sorted(folder.iterdir()) if folder else []:
        pixels = np.asarray(Image.open(path).convert("RGB"))
        row, column = (length // 2 - SIZE // 2 for length in pixels.shape[:2])
        found[path.stem] = pixels[row : row + SIZE, column : column + SIZE]
    return found


def _bytes(values: Floats) -> Bytes:
    return np.rint(values).clip(0, 255).astype(np.uint8)


def gaussian(sigma: float) -> Callable[[Bytes], Bytes]:
    """Return a blur."""
    return lambda image: _bytes(ndimage.gaussian_filter(image.astype(float), (sigma, sigma, 0)))


def disk(image: Bytes) -> Bytes:
    """Blur as a lens out of focus does, by a disk of radius 3."""
    y, x = np.mgrid[-4:5, -4:5]
    weights = np.clip(3.5 - np.hypot(y, x), 0, 1)[..., None]
    return _bytes(ndimage.convolve(image.astype(float), weights / weights.sum(), mode="mirror"))


def enlarged(image: Bytes) -> Bytes:
    """Reduce to a quarter, and enlarge again."""
    small = image.reshape(SIZE // 4, 4, SIZE // 4, 4, 3).mean(axis=(1, 3))
    return np.asarray(Image.fromarray(_bytes(small)).resize((SIZE, SIZE), Image.Resampling.BICUBIC))


def compressed(image: Bytes) -> Bytes:
    """Blur, and keep as JPEG of quality 75."""
    file = io.BytesIO()
    Image.fromarray(gaussian(2.0)(image)).save(file, "JPEG", quality=75)
    return np.asarray(Image.open(file).convert("RGB"))


def noisy(image: Bytes) -> Bytes:
    """Blur, and add noise of a standard deviation of 0.01."""
    noise = np.random.default_rng(0).normal(0, 2.55, image.shape)
    return _bytes(gaussian(2.0)(image) + noise)


LOSSES = {
    "sigma 1": gaussian(1.0),
    "sigma 1.5": gaussian(1.5),
    "sigma 2": gaussian(2.0),
    "sigma 3": gaussian(3.0),
    "sigma 4": gaussian(4.0),
    "disk 3": disk,
    "x4": enlarged,
    "sigma 2, JPEG": compressed,
    "sigma 2, noise": noisy,
}


def unsharp(image: Bytes) -> Bytes:
    """Return a plain unsharp mask, at the width that is measured."""
    sigma = measure_image(image).borders.width / WIDTH_OF_SIGMA
    smooth = ndimage.gaussian_filter(image.astype(float), (sigma, sigma, 0))
    return _bytes(2.0 * image - smooth)


def _ours(**settings: object) -> Callable[[Bytes], Bytes]:
    return lambda image: core.sharpen_image(image, core.ImageSettings(**settings))


def _as_measured(image: Bytes) -> Bytes:
    return core.sharpen_image(image, core.ImageSettings(what=measure_image(image).what))


FILTERS = {
    "as measured": _as_measured,
    "Drawing": _ours(what="drawing"),
    "Photo": _ours(what="photo"),
    "time 16": _ours(time=16.0),
    "time 256": _ours(time=256.0),
    "unsharp mask": unsharp,
}


def fidelity(image: Bytes, truth: Bytes) -> float:
    """Peak signal-to-noise ratio in dB."""
    error = ((image.astype(float) - truth) ** 2).mean()
    return float(10.0 * np.log10(255.0**2 / max(error, 1e-3)))


def outside(image: Bytes, source: Bytes) -> float:
    """Percentage of values that leave those of the source within 15 x 15 by more than 0.01."""
    low = ndimage.minimum_filter(source, (15, 15, 1)).astype(float) - 2.55
    high = ndimage.maximum_filter(source, (15, 15, 1)).astype(float) + 2.55
    return 100.0 * float(((image < low) | (image > high)).mean())


def gains(groups: dict[str, dict[str, Bytes]]) -> str:
    """Gains over what was lost, in the mean of each group."""
    rows = []
    for group, images in groups.items():
        for loss, lose in LOSSES.items():
            sources = {name: lose(image) for name, image in images.items()}
            row = [group, loss]
            for work in FILTERS.values():
                found = [
                    fidelity(work(source), images[name]) - fidelity(source, images[name])
                    for name, source in sources.items()
                ]
                row.append(f"{np.mean(found):+.2f}")
            beyond = [outside(FILTERS["as measured"](each), each) for each in sources.values()]
            halos = [outside(unsharp(each), each) for each in sources.values()]
            rows.append([*row, f"{np.mean(beyond):.2f} / {np.mean(halos):.2f}"])
    head = [
        "",
        "lost by",
        *(f"{name}: dB" for name in FILTERS),
        "outside, %: as measured / unsharp",
    ]
    return table(head, rows, words=2)


def findings(groups: dict[str, dict[str, Bytes]]) -> str:
    """How Auto classifies images, and the measured width relative to the true one."""
    sigmas = {"sigma 1": 1.0, "sigma 1.5": 1.5, "sigma 2": 2.0, "sigma 3": 3.0, "sigma 4": 4.0}
    sigmas |= {"sigma 2, JPEG": 2.0, "sigma 2, noise": 2.0}
    rows = []
    for group, images in groups.items():
        wanted = "photo" if group == "photos" else "drawing"
        for loss, sigma in sigmas.items():
            right, shares = 0, []
            for image in images.values():
                own = measure_image(image).borders.width
                found = measure_image(LOSSES[loss](image))
                right += found.what == wanted
                made = np.hypot(own, WIDTH_OF_SIGMA * sigma)
                shares.append(found.borders.width / made)
            low, middle, high = np.quantile(shares, [0.0, 0.5, 1.0])
            rows.append(
                [
                    group,
                    loss,
                    f"{right} of {len(images)}",
                    f"{middle:.2f} ({low:.2f} to {high:.2f})",
                ]
            )
    return table(["", "lost by", "taken for what it is", "measured / made width"], rows, words=2)


def sharp(groups: dict[str, dict[str, Bytes]]) -> str:
    """What is done to images that are sharp, as what they are measured to be."""
    rows = []
    for group, images in groups.items():
        for name, image in images.items():
            result = _as_measured(image)
            same = (result == image).all()
            width = measure_image(image).borders.width
            kept = "bit for bit" if same else f"{fidelity(result, image):.1f} dB"
            rows.append([group, name, f"{width:.1f}", kept])
    return table(["", "", "measured width", "result"], rows, words=2)


def edge(width: float, contrast: float) -> tuple[Floats, Floats]:
    """A straight border that is this wide, and how far pixels are from it."""
    y, x = np.mgrid[:160, :160] - 79.3
    away = x * np.cos(0.35) + y * np.sin(0.35)
    return 0.5 + 0.5 * contrast * erf(away * WIDTH_OF_SIGMA / width / 2**0.5), away


def rise(values: Floats, away: Floats) -> float:
    """How far it is from 10 to 90 percent of the rise of mean values across a line."""
    inner = slice(30, -30)
    places = np.round(away[inner].ravel() / 0.25).astype(int)
    first = places.min()
    counts = np.bincount(places - first)
    means = np.bincount(places - first, values[inner].ravel()) / np.maximum(counts, 1)
    means = np.maximum.accumulate(means[counts > 0])
    shares = (means - means[0]) / (means[-1] - means[0])
    low, high = np.interp([0.1, 0.9], shares, 0.25 * np.flatnonzero(counts))
    return float(high - low)


def widths() -> str:
    """How wide borders of several widths and contrasts are afterwards, over before."""
    rows = []
    for contrast in (1.0, 0.5, 0.2, 0.05):
        row = [f"{contrast:g}"]
        for times in TIMES:
            image, away = edge(times * WIDTH, contrast)
            out = core.sharpen_image(image, core.ImageSettings(what="drawing", width=WIDTH))
            row.append(f"{rise(out, away) / rise(image, away):.2f}")
        rows.append(row)
    return table(["contrast", *(f"{times * WIDTH:g} px" for times in TIMES)], rows)


def speed() -> str:
    """Seconds of one core for a square of 1024, and what of them is measuring."""
    image = np.tile(gaussian(2.0)(drawing(SEEDS[0])), (4, 4, 1))
    work = {"measuring": measure_image, **{n: FILTERS[n] for n in ("Drawing", "Photo", "time 16")}}
    rows = []
    for name, function in work.items():
        seconds = []
        for _ in range(4):
            begin = time.process_time()
            function(image)
            seconds.append(time.process_time() - begin)
        rows.append([name, f"{min(seconds):.2f} s"])
    return table(["", "one core, 1024 x 1024 x 3"], rows)


def main() -> None:
    """Print the tables, or write them into pages."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--photos", type=Path, help="folder with further photos")
    parser.add_argument("--write", type=Path, help="folder of the pages to write the tables into")
    options = parser.parse_args()
    groups = {
        "drawings": {str(seed): drawing(seed) for seed in SEEDS},
        "drawings at contrast 0.2": {str(seed): drawing(seed, 0.2) for seed in SEEDS},
        "photos": photos(options.photos),
    }
    Page(options.write and options.write / "images.md").write("dial-widths", widths())
    page = Page(options.write and options.write / "benchmarks.md")
    page.write("dial-speed", speed())
    page.write("dial-sharp", sharp(groups))
    page.write("dial-findings", findings(groups))
    page.write("dials", gains(groups))


if __name__ == "__main__":
    main()
