# SPDX-License-Identifier: GPL-3.0-or-later
"""Images as dask arrays of random chunks: the bits are those of the whole image in memory."""

import dask
import dask.array
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter
from shock_filter import core
from shock_filter.core.color import chunked
from strategies import examples, images, masks, settings_of

pytestmark = pytest.mark.timeout(1800, method="thread")  # a thread can end compiled code, too


@st.composite
def pictures(draw):
    """Draw soft shapes, with noise or not, of any type; or any image."""
    if draw(st.integers(0, 4)) == 0:
        return draw(images())
    side = st.sampled_from([1, 2, 3, 23, 64, 90])
    channels = draw(st.sampled_from([(), (1,), (2,), (3,), (4,), (9,)]))
    shape = (draw(side), draw(side), *channels)
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    sigma = draw(st.sampled_from([0.5, 1.0, 3.0, 8.0]))
    noise = draw(st.sampled_from([0.0, 0.0, 0.02, 0.2]))
    axes = (sigma, sigma, 0)[: len(shape)]
    shapes = gaussian_filter(np.sign(gaussian_filter(rng.normal(size=shape), axes)), axes)
    values = 0.5 + 0.5 * shapes + noise * rng.normal(size=shape)
    kind = np.dtype(draw(st.sampled_from(["u1", "u2", "f4", "f8"])))
    if kind.kind == "f":
        return values.astype(kind)
    most = np.iinfo(kind).max
    return np.rint(most * np.clip(values, 0, 1)).astype(kind)


@st.composite
def in_chunks(draw, array):
    """Draw chunks along rows and columns: many, few, uneven, a pixel wide."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))

    def cut(length):
        places = rng.integers(1, length, rng.integers(0, 9)) if length > 1 else []
        return tuple(np.diff([0, *np.unique(places), length]).tolist())

    chunks = (*map(cut, array.shape[:2]), *[draw(st.sampled_from([1, -1]))] * (array.ndim - 2))
    return dask.array.from_array(array, chunks=chunks)


@st.composite
def maybe_in_chunks(draw, array):
    """Draw an array as it is, or as dask's; None stays."""
    return array if array is None or draw(st.booleans()) else draw(in_chunks(array))


def assert_same(lazy, expected):
    assert (lazy.dtype, lazy.shape) == (expected.dtype, expected.shape)
    found = lazy.compute(scheduler="synchronous")
    assert found.tobytes() == expected.tobytes(), np.argwhere(found != expected)


@examples(24)
@given(st.data(), pictures(), settings_of(core.ImageSettings), st.booleans())
def test_sharpen(data, image, settings, is_close):
    mask = data.draw(masks(*image.shape[:2]))
    guide = None
    if settings.channels != "independent" and data.draw(st.booleans()):
        guide = 1 - image if image.dtype.kind == "f" else ~image
    if settings.by_width and np.abs(image.astype(np.float64)).max() > 1e14:
        return
    expected = core.sharpen_image(image, settings, mask=mask, guide=guide)
    lazy_mask, lazy_guide = (data.draw(maybe_in_chunks(each)) for each in (mask, guide))
    with pytest.MonkeyPatch.context() as patch:
        if is_close:  # so that many flow-lines leave the halo
            patch.setattr(chunked, "_WALK", 1)
            patch.setattr(chunked, "_LONG_WALK", 1)
        lazy = core.sharpen_image(
            data.draw(in_chunks(image)), settings, mask=lazy_mask, guide=lazy_guide
        )
    assert_same(lazy, expected)


@examples(10)
@given(st.data(), pictures(), settings_of(core.BeltramiSettings))
def test_denoise(data, image, settings):
    mask = data.draw(masks(*image.shape[:2]))
    expected = core.beltrami_image(image, settings, mask=mask)
    lazy_mask = data.draw(maybe_in_chunks(mask))
    assert_same(
        core.beltrami_image(data.draw(in_chunks(image)), settings, mask=lazy_mask), expected
    )


@examples(8)
@given(
    st.data(), pictures(), st.integers(0, 12), st.sampled_from([0.1, 0.5]),
    st.sampled_from(["laplacian", "gradient"]),
)  # fmt: skip
def test_osher_rudin(data, image, steps, time_step, detector):
    if image.dtype.kind == "u" or min(image.shape[:2]) < 2 or abs(image).max() > 1e9:
        return
    expected = core.osher_rudin_image(
        image, steps=steps, time_step=time_step, edge_detector=detector
    )
    lazy = core.osher_rudin_image(
        data.draw(in_chunks(image)), steps=steps, time_step=time_step, edge_detector=detector
    )
    assert_same(lazy, expected)
