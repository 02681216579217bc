# SPDX-License-Identifier: GPL-3.0-or-later
"""Sharpening of images (paper A, section 3)."""

from __future__ import annotations

import numpy.typing as npt

from ..base.checks import (
    by_keyword,
    checked_image,
    checked_out,
    checked_weights,
    is_dask,
    refuse_with_dask,
)
from ..base.progress import ProgressCallback, reporting
from ..errors import InvalidSettings
from ..grid.channels import channel_groups
from ..settings import ImageSettings, given_or_default
from .by_width.measuring import Measured
from .guides import checked_guide
from .image_steps import LARGEST, large_pixels, measured_whole, opacity_in_range, sharpen_checked
from .pixel_art import is_for_pixel_art, told_pixel_art


@by_keyword
def sharpen_image(
    image: npt.ArrayLike,
    settings: ImageSettings | None = None,
    *,
    mask: npt.ArrayLike | None = None,
    progress: ProgressCallback | None = None,
    out: npt.NDArray | None = None,
    known: Measured | None = None,
    guide: npt.ArrayLike | None = None,
) -> npt.NDArray:
    """Sharpen an image; with a time, values flow along u = grad(|grad I|^2) / 2 to the edges.

    Parameters
    ----------
    image : (h, w) or (h, w, c) array of uint8, uint16, float32 or float64
        Any number of channels. Times assume values in [0, 1]; whole numbers are scaled to this
        range, floats may go beyond. May be memory-mapped, or a dask array.
    settings : ImageSettings, optional
    mask : (h, w) array of float in [0, 1], optional
        1 sharpens fully, less mixes with the input, 0 keeps it bit for bit.
    progress : callable, optional
        ``progress(fraction, message) -> bool``; False cancels.
    out : array like `image`, optional
        Array for the result, which may be memory-mapped. Undefined after an error. Not for dask.
    known : Measured, optional
        Result of `measure_image` for the larger image that this one is a part of.
    guide : (h, w) or (h, w, c) array, optional
        Another image of the same size, whose flow moves the values in place of their own flow, so
        that both images have borders in the same places. What and Width are measured in the guide.
        The last of two or four channels is opacity. Not for independent channels.

    Returns
    -------
    array like `image`
        `ImageSettings.enlarge` times as high and wide. Each value is within the range of the input
        near it, up to rounding to single precision. A time of 0 returns the input bit for bit, or
        enlarged by cubic interpolation. Pixel art is not sharpened, and is enlarged by repeating
        pixels, see `color.pixel_art`. Opacity (see `ImageSettings.alpha`) is sharpened by itself;
        with a time or a guide it is not sharpened. Hidden pixels stay hidden. A dask array gives a
        dask array, computed later chunk by chunk, with the same bits; only measurements of the
        whole image are made at once. See `color.chunked`.

    Raises
    ------
    InvalidSignal
        If the image's shape or type is not supported, it holds NaN or infinity (by width: values
        beyond 1e15), or mask, out or guide do not fit it.
    InvalidSettings
        If the settings do not allow a guide.
    Cancelled
        If `progress` returned False.

    Notes
    -----
    Paper A, sections 3.2, 3.3 and Appendix A; the defaults are not in the papers, see
    `color.learned`. Besides the image and the result, they need about 40 bytes a pixel, and 20 for
    each channel. With a time, smoothing the flow needs 8 bytes a pixel, and advection 4; with What
    or a guide, 4 more, and 4 for each channel. Enlarged images need two copies in floats.

    Examples
    --------
    A soft step becomes a steep one.

    >>> import numpy as np
    >>> from shock_filter import core
    >>> image = np.tile(1 / (1 + np.exp(-np.linspace(-4, 4, 32))), (8, 1))
    >>> sharp = core.sharpen_image(image, core.ImageSettings(time=1000.0))
    >>> sharp.shape, bool(np.abs(np.diff(sharp)).max() > np.abs(np.diff(image)).max())
    ((8, 32), True)
    """
    settings = given_or_default(settings, ImageSettings)
    if not (known is None or isinstance(known, Measured)):
        raise InvalidSettings(f"known is of type {type(known).__name__}; leave it out.")
    if is_dask(image):
        from .chunked import sharpen_chunks

        refuse_with_dask(out=out, progress=progress)
        return sharpen_chunks(image, settings, mask, known, guide)
    with reporting(progress):
        given = checked_image(image, LARGEST if settings.by_width else None)
        result = checked_out(out, given, settings.enlarge, (image, mask, guide))
        weights = checked_weights(mask, given)
        lead = checked_guide(guide, given, settings)
        sharpen_checked(given, result, settings, weights, lead, known)
    return result


def measure_image(image: npt.ArrayLike, settings: ImageSettings | None = None) -> Measured:
    """Measure What, Width and noise, as `sharpen_image` does.

    Parameters
    ----------
    image : array
        As in `sharpen_image`; only some windows of a dask array are computed.
    settings : ImageSettings, optional
        Values given there are not measured.

    Returns
    -------
    Measured
        Widths are in pixels, of the enlarged image if it is enlarged. Not in the papers; see
        `grid.borders`.

    Raises
    ------
    InvalidSignal
        As in `sharpen_image`.

    Examples
    --------
    >>> import numpy as np
    >>> from scipy.ndimage import gaussian_filter
    >>> from shock_filter.core.color.image_sharpening import measure_image
    >>> image = gaussian_filter(np.kron(np.eye(8), np.ones((16, 16))), 2.0)
    >>> found = measure_image(image)
    >>> found.what, round(found.width)
    ('drawing', 5)
    """
    settings = given_or_default(settings, ImageSettings)
    if is_dask(image):
        from .chunked import measure_chunks

        return measure_chunks(image, settings)
    given = checked_image(image, LARGEST)
    pixels = given.reshape(*given.shape[:2], -1)
    squares = 0.0
    if is_for_pixel_art(settings, has_guide=False):
        squares = told_pixel_art(pixels, settings)
    if settings.enlarge > 1:
        pixels = large_pixels(pixels, settings)
    channels = channel_groups(pixels.shape[2], settings)[0]
    pixels = opacity_in_range(pixels, channels.alpha)
    return measured_whole(pixels, channels, settings)._replace(pixel_art=squares)
