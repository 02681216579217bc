# SPDX-License-Identifier: GPL-3.0-or-later
"""Images as dask arrays: same bits as in memory, later, and with the same refusals."""

import subprocess
import sys

import dask
import dask.array
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from shock_filter import core
from shock_filter.core.color import chunked
from shock_filter.core.color.chunked import counting_reruns
from shock_filter.core.color.image_sharpening import measure_image

SHAPE = (210, 190)
PAPER = core.ImageSettings(time=64.0)


def shapes(channels=3, seed=0, sigma=2.0):
    noise = np.random.default_rng(seed).normal(size=(*SHAPE, channels))
    soft = gaussian_filter(np.sign(gaussian_filter(noise, (6, 6, 0))), (sigma, sigma, 0))
    return np.rint(127.5 + 120 * soft).astype(np.uint8)


def cut(image, side=50):
    return dask.array.from_array(image, chunks=side)


def computed(lazy):
    return lazy.compute(scheduler="synchronous")


def sharpened_and_reruns(image, settings, **words):
    with counting_reruns() as counts:
        lazy = core.sharpen_image(image, settings, **words)
    found, reruns = dask.compute(lazy, [each.sum() for each in counts], scheduler="synchronous")
    return found, sum(reruns)


@pytest.mark.parametrize("settings", [
    {}, {"time": 256.0}, {"time": np.inf}, {"time": 16.0, "smoothing_passes": 40},
    {"enlarge": 2}, {"channels": "independent"},
], ids=str)  # fmt: skip
def test_same_bits_as_in_memory(settings):
    image, settings = shapes(), core.ImageSettings(**settings)
    lazy = core.sharpen_image(cut(image), settings)
    assert lazy.numblocks == (5, 4, 1)
    np.testing.assert_array_equal(computed(lazy), core.sharpen_image(image, settings))


def test_denoising_has_the_same_bits_as_in_memory():
    image = shapes()
    settings = core.BeltramiSettings(time=6.0, iterations=2)
    lazy = core.beltrami_image(cut(image), settings)
    assert lazy.numblocks == (5, 4, 1)
    np.testing.assert_array_equal(computed(lazy), core.beltrami_image(image, settings))


@pytest.mark.slow
def test_noise_is_that_of_the_whole():
    noise = 0.1 * np.random.default_rng(4).normal(size=(700, 500, 1))
    image = (0.5 + noise * np.linspace(0, 1, 700)[:, None, None]).astype(np.float32)
    lazy = core.beltrami_image(cut(image, 250))
    np.testing.assert_array_equal(computed(lazy), core.beltrami_image(image))


def test_what_is_measured_in_many_windows_is_the_same():
    noise = np.random.default_rng(3).normal(size=(1300, 1100))
    image = gaussian_filter(noise, 12.0).astype(np.float32) * 10
    few = np.zeros((1100, 1300), np.float32)  # borders in one place, so that all is looked at
    few[500:, 700:] = 1.0
    for each in (image, gaussian_filter(few, 2.0)):
        assert measure_image(cut(each, 250)) == measure_image(each)


def test_flow_lines_that_leave_make_chunks_run_again(monkeypatch):
    x, y = np.meshgrid(np.linspace(0, 1, 190), np.linspace(0, 1, 210))
    image = np.tanh(2 * (x - 0.5 + 0.1 * y)).astype(np.float32)  # one wide border
    settings = core.ImageSettings(time=np.inf)
    monkeypatch.setattr(chunked, "_LONG_WALK", 4)
    found, reruns = sharpened_and_reruns(cut(image), settings)
    assert reruns > 4
    np.testing.assert_array_equal(found, core.sharpen_image(image, settings))
    monkeypatch.setattr(chunked, "_LONG_WALK", 400)
    assert sharpened_and_reruns(cut(image), settings)[1] == 0


def test_chunks_run_again_on_a_cluster(monkeypatch):
    from distributed import Client

    monkeypatch.setattr(chunked, "_WALK", 1)
    monkeypatch.setattr(chunked, "_LONG_WALK", 1)
    image = shapes()
    settings = core.ImageSettings(time=1e4)
    with Client(
        processes=False, n_workers=1, threads_per_worker=2, dashboard_address=":0"
    ) as client:
        given = client.persist(cut(image))  # what tasks read again is held by the cluster
        with counting_reruns() as counts:
            lazy = core.sharpen_image(given, settings)
        found, reruns = client.gather(client.compute([lazy, counts[0].sum()]))
    assert reruns > 0
    np.testing.assert_array_equal(found, core.sharpen_image(image, settings))


def test_nothing_is_computed_before_it_is_asked_for():
    def read(block_info=None):
        raise AssertionError("read too early")

    image = dask.array.map_blocks(read, chunks=((60, 60), (60, 60)), dtype=np.float32,
                                  meta=np.empty((0, 0), np.float32))  # fmt: skip
    core.sharpen_image(image, PAPER)
    core.beltrami_image(image, core.BeltramiSettings(beta=7.0))
    core.osher_rudin_image(image, steps=4)
    lazy = core.sharpen_image(image, core.ImageSettings(), known=measure_image(shapes()))
    with pytest.raises(AssertionError, match="too early"):
        computed(lazy)


def test_mask_and_guide_may_be_lazy_or_not():
    image, guide = shapes(), shapes(seed=1)
    mask = np.random.default_rng(0).random(SHAPE)
    settings = core.ImageSettings(width=4.0)
    expected = core.sharpen_image(image, settings, mask=mask, guide=guide)
    for weights, lead in ((mask, guide), (cut(mask, 33), cut(guide, 77))):
        lazy = core.sharpen_image(cut(image), settings, mask=weights, guide=lead)
        np.testing.assert_array_equal(computed(lazy), expected)


def test_opacity_of_a_guide_counts_though_the_images_does_not():
    image, guide = shapes(1), shapes(2, seed=1)
    settings = core.ImageSettings(what="drawing", enlarge=2, alpha="none")
    lazy = core.sharpen_image(cut(image, 100), settings, guide=guide)
    np.testing.assert_array_equal(computed(lazy), core.sharpen_image(image, settings, guide=guide))


def bad_pixel(value, dtype=np.float32):
    image = np.ones(SHAPE, dtype)
    image[170, 180] = value
    return image


REFUSED = {
    "NaN": lambda of: core.sharpen_image(of(bad_pixel(np.nan)), PAPER),
    "huge": lambda of: core.sharpen_image(of(bad_pixel(1e16)), core.ImageSettings(width=3.0)),
    "type": lambda of: core.sharpen_image(of(np.ones(SHAPE, int))),
    "shape": lambda of: core.beltrami_image(of(np.ones(9, np.float32))),
    "mask": lambda of: core.beltrami_image(of(shapes()), mask=of(bad_pixel(1.5))),
    "mask's shape": lambda of: core.sharpen_image(of(shapes()), mask=of(np.ones((9, 9)))),
    "guide": lambda of: core.sharpen_image(of(shapes()), guide=of(np.ones((9, 9)))),
    "guide, independent": lambda of: core.sharpen_image(
        of(shapes()), core.ImageSettings(channels="independent"), guide=of(shapes())),
    "huge noise": lambda of: core.beltrami_image(of(bad_pixel(1e200, np.float64))),
    "PDE's type": lambda of: core.osher_rudin_image(of(shapes()), steps=3),
    "PDE's values": lambda of: core.osher_rudin_image(of(bad_pixel(1e12)), steps=3),
}  # fmt: skip


@pytest.mark.parametrize("run", REFUSED.values(), ids=REFUSED)
def test_refusals_are_those_of_images_in_memory(run):
    with pytest.raises(core.ShockError) as expected:
        run(np.asarray)
    with pytest.raises(type(expected.value)) as found:
        computed(run(cut))
    assert str(found.value) == str(expected.value)


def test_what_only_dask_arrays_refuse():
    image = cut(np.ones(SHAPE, np.float32))
    refused = {
        "out is given": lambda: core.sharpen_image(image, out=np.ones(SHAPE, np.float32)),
        "progress is given": lambda: core.beltrami_image(image, progress=lambda *_: True),
        "fastest pixel": lambda: core.osher_rudin_image(
            image, steps=2, time_step=0.4, edge_detector="flow"
        ),
    }
    for words, run in refused.items():
        with pytest.raises(core.InvalidSettings, match=words):
            run()
    with pytest.raises(core.InvalidSignal, match="compute_chunk_sizes"):
        core.sharpen_image(image[image[:, 0] > 2])


def test_images_in_memory_do_without_dask():
    code = """
import sys
import numpy as np
from shock_filter import core
core.sharpen_image(np.ones((4, 4)), core.ImageSettings(time=0))
sys.exit("dask" in sys.modules)
"""
    assert subprocess.run([sys.executable, "-c", code]).returncode == 0
