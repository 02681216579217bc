# SPDX-License-Identifier: GPL-3.0-or-later
"""Other filters of photos, on uint8 arrays, and what is measured of their results."""

from __future__ import annotations

import importlib.util
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import common
import numpy as np
from PIL import Image
from scipy import ndimage
from shock_filter import core

Filter = Callable[[np.ndarray], np.ndarray]

GMIC = "gmic"
GMIC_SHOCK = ["-sharpen", "150,0.1,0.8,1.1", "-cut", "0,255"]
RUNS = 3


def available(module: str, package: str) -> bool:
    """Tell whether a module can be imported; if not, say so in a line."""
    if importlib.util.find_spec(module):
        return True
    print(f"{module} is not installed and left out (pip install {package}).", flush=True)
    return False


def ours(flow_time: float, **settings: object) -> Filter:
    """Return our filter."""
    chosen = core.ImageSettings(time=flow_time, **settings)
    return lambda image: core.sharpen_image(image, chosen)


def unsharp(radius: float, amount: float) -> Filter:
    """Return scikit-image's unsharp mask."""
    from skimage.filters import unsharp_mask

    # channel_axis=-1 means the last one, but leaves most of the result unset in 0.26.
    return lambda image: _bytes(unsharp_mask(image, radius, amount, channel_axis=2))


def total_variation(weight: float) -> Filter:
    """Return scikit-image's total variation denoising."""
    from skimage.restoration import denoise_tv_chambolle

    return lambda image: _bytes(denoise_tv_chambolle(image, weight, channel_axis=-1))


def bilateral(sigma_color: float, sigma_space: float) -> Filter:
    """Return OpenCV's bilateral filter."""
    import cv2

    return lambda image: cv2.bilateralFilter(image, -1, sigma_color, sigma_space)


def coherence_shock(turns: int = 4, size: int = 11, share: float = 0.5) -> Filter:
    """Return a coherence-enhancing shock filter on OpenCV (after Weickert 2003).

    Where the brightness is convex across the dominant direction of the structure tensor, pixels
    take the least value around them, elsewhere the greatest; each turn mixes half of it in.
    """
    import cv2

    def apply(image: np.ndarray) -> np.ndarray:
        current = image
        for _ in range(turns):
            gray = cv2.cvtColor(current, cv2.COLOR_RGB2GRAY)
            eigen = cv2.cornerEigenValsAndVecs(gray, size, 3)
            across, down = eigen[..., 2], eigen[..., 3]
            second = [
                cv2.Sobel(gray, cv2.CV_32F, dx, dy, ksize=size)
                for dx, dy in ((2, 0), (1, 1), (0, 2))
            ]
            curvature = across * across * second[0]
            curvature += 2 * across * down * second[1] + down * down * second[2]
            greatest, least = cv2.dilate(current, None), cv2.erode(current, None)
            shocked = np.where((curvature < 0)[..., None], greatest, least)
            current = cv2.addWeighted(current, 1 - share, shocked, share, 0)
        return current

    return apply


def perona_malik(turns: int, contrast: float) -> Filter:
    """Return anisotropic diffusion (Perona and Malik 1990), explicit steps of 0.2."""

    def apply(image: np.ndarray) -> np.ndarray:
        current = image.astype(np.float32) / 255
        for _ in range(turns):
            change = np.zeros_like(current)
            for axis in (0, 1):
                flux = np.diff(current, axis=axis)
                flux *= np.exp(-((flux / contrast) ** 2).sum(axis=2, keepdims=True))
                pad = [(0, 0)] * 3
                pad[axis] = (1, 1)
                change += np.diff(np.pad(flux, pad), axis=axis)
            current += 0.2 * change
        return _bytes(current)

    return apply


def _bytes(values: np.ndarray) -> np.ndarray:
    return np.rint(255 * np.clip(values, 0, 1)).astype(np.uint8)


def gmic(image: np.ndarray) -> tuple[np.ndarray, float]:
    """Run G'MIC's shock filter; return the result and its seconds, without starting and files."""
    with tempfile.TemporaryDirectory() as folder:
        given, result = Path(folder) / "in.ppm", Path(folder) / "out.ppm"
        Image.fromarray(image).save(given)

        def run(*commands: str) -> None:
            subprocess.run(
                [GMIC, "-v", "-", str(given), *commands, "-o", str(result)],
                check=True,
                capture_output=True,
            )

        idle = common.fastest(run, RUNS)
        whole = common.fastest(lambda: run(*GMIC_SHOCK), RUNS)
        return np.array(Image.open(result)), whole - idle


def timed(function: Filter, image: np.ndarray) -> tuple[np.ndarray, float]:
    """Return a filter's result and the seconds of its fastest run."""
    function(image[:32, :32].copy())  # compiles
    best = np.inf
    for _ in range(RUNS):
        start = time.perf_counter()
        result = function(image)
        best = min(best, time.perf_counter() - start)
    return result, best


def has_gmic() -> bool:
    """Tell whether G'MIC's program is installed; if not, say so in a line."""
    if shutil.which(GMIC):
        return True
    print("gmic is not installed and left out (Debian: apt-get install gmic).", flush=True)
    return False


def gradient_magnitude(image: np.ndarray) -> np.ndarray:
    """Length of the gradient of all channels together; values in [0, 1] if uint8 is given."""
    values = image.astype(np.float64) / (255 if image.dtype == np.uint8 else 1)
    down, across = np.gradient(values, axis=(0, 1))
    return np.sqrt((down**2 + across**2).sum(axis=2))


@dataclass(frozen=True)
class Quality:
    """Measures of a result.

    Attributes
    ----------
    outside : float
        Share of values outside the range of the 5 x 5 pixels of the input around them.
    excess : float
        How far these lie outside in the mean, in levels of 255; 0 if there are none.
    slope : float
        95th percentile of the gradient, over the sharp photo's.
    psnr : float
        Peak signal-to-noise ratio to the sharp photo, in decibels.
    """

    outside: float
    excess: float
    slope: float
    psnr: float

    @classmethod
    def of(cls, result: np.ndarray, given: np.ndarray, sharp: np.ndarray) -> Quality:
        """Measure a result."""
        low = ndimage.minimum_filter(given, (5, 5, 1)).astype(int)
        high = ndimage.maximum_filter(given, (5, 5, 1)).astype(int)
        excess = np.maximum(np.maximum(low - result, result - high), 0)
        outside = excess > 0
        slopes = [np.percentile(gradient_magnitude(image), 95) for image in (result, sharp)]
        error = ((result.astype(float) - sharp) ** 2).mean()
        return cls(
            float(outside.mean()),
            float(excess[outside].mean()) if outside.any() else 0.0,
            float(slopes[0] / slopes[1]),
            float(10 * np.log10(255**2 / max(error, 1e-12))),
        )
