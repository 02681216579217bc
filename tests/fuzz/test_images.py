# SPDX-License-Identifier: GPL-3.0-or-later
"""Random images, textures and settings through the filters of images and textures."""

import numpy as np
import pytest
from checks import assert_alike, assert_same_bits, assert_sentence, assert_within, call
from hypothesis import assume, given
from hypothesis import strategies as st
from shock_filter import core
from shock_filter.core.registry import find
from strategies import (
    broken,
    examples,
    images,
    masks,
    meshes,
    settings_of,
    texture_coordinates,
    values,
)

pytestmark = pytest.mark.timeout(1800, method="thread")  # a thread can end compiled code, too

STOPS = st.floats(0, 1)
SHARPEN_TIMES = st.sampled_from([None, 0.0, 16.0, 1e3, np.inf])


def check_image(result, image, mask, keeps_all, alpha):
    assert_alike(result, image)
    if mask is not None:
        assert_same_bits(result[mask == 0], image[mask == 0])
    if keeps_all:
        assert_same_bits(result, image)
    flat = (-1, *image.shape[2:])
    assert_within(result.reshape(flat), image.reshape(flat), slack=1e-6)
    if alpha == "auto" and image.shape[2:] in ((2,), (4,)):
        assert_same_bits(result[..., -1], image[..., -1])


@examples(60)
@given(st.data(), images(), settings_of(core.ImageSettings), STOPS)
def test_sharpen_image(data, image, settings, stop_at):
    mask = data.draw(masks(*image.shape[:2]))
    times = settings.enlarge
    shape = (times * image.shape[0], times * image.shape[1], *image.shape[2:])
    out = data.draw(st.sampled_from([None, np.empty(shape, image.dtype)]))
    given_arrays = [image] if mask is None else [image, mask]
    if settings.by_width and np.abs(image.astype(np.float64)).max() > 1e15:
        with pytest.raises(core.InvalidSignal, match="beyond"):
            core.sharpen_image(image, settings)
        return
    result = call(
        lambda watch: core.sharpen_image(image, settings, mask=mask, progress=watch, out=out),
        *given_arrays,
        stop_at=stop_at,
    )
    if out is not None:
        assert np.shares_memory(result, out)
    elif times == 1:
        check_image(result, image, mask, settings.time == 0, settings.alpha)
    else:
        assert (result.dtype, result.shape) == (image.dtype, shape)
        flat = (-1, *image.shape[2:])
        assert_within(result.reshape(flat), image.reshape(flat), slack=1e-6)


@examples(60)
@given(st.data(), images(), settings_of(core.BeltramiSettings), SHARPEN_TIMES, STOPS)
def test_denoise_image(data, image, settings, sharpen_time, stop_at):
    mask = data.draw(masks(*image.shape[:2]))
    given_arrays = [image] if mask is None else [image, mask]
    result = call(
        lambda watch: find("beltrami_image").function(sharpen_time)(
            image, settings=settings, mask=mask, progress=watch),
        *given_arrays, stop_at=stop_at)  # fmt: skip
    check_image(result, image, mask, settings.time == 0 and not sharpen_time, settings.alpha)


@examples(40)
@given(st.data(), images(), settings_of(core.BeltramiSettings), STOPS)
def test_beltrami_manifold(data, image, settings, stop_at):
    embedding = data.draw(values((*image.shape[:2], 3)))
    mask = data.draw(masks(*image.shape[:2]))
    smooth = data.draw(st.sampled_from(["image", "embedding", "both"]))
    arrays = [array for array in (image, embedding, mask) if array is not None]
    try:
        result, places = call(
            lambda watch: core.beltrami_manifold(
                image, embedding, settings, mask=mask, progress=watch, smooth=smooth),
            *arrays, stop_at=stop_at)  # fmt: skip
    except core.InvalidSignal as error:
        assert "embedding" in str(error)
        return
    check_image(result, image, mask, settings.time == 0, settings.alpha)
    assert_alike(places, embedding)
    if smooth == "image":
        assert_same_bits(places, embedding)
    if smooth == "embedding":
        assert_same_bits(result, image)


@examples(30)
@given(
    images(),
    st.integers(0, 8),
    st.sampled_from([1e-9, 0.1, 0.5]),
    st.sampled_from(["laplacian", "gradient", "flow"]),
    STOPS,
)
def test_osher_rudin(image, steps, time_step, detector, stop_at):
    try:
        result = call(
            lambda watch: core.osher_rudin_image(
                image, steps=steps, time_step=time_step, edge_detector=detector, progress=watch
            ),
            image,
            stop_at=stop_at,
        )
    except core.InvalidSignal:
        huge = abs(image).max() > 1e9
        assert huge or image.dtype.kind == "u" or min(image.shape[:2]) < 2
        return
    except core.InvalidSettings:
        assert detector == "flow"
        assert abs(image).max() > 10  # many parts of a step
        return
    check_image(result, image, None, steps == 0, "none")


@examples(50)
@given(st.data(), images(), settings_of(core.TextureSettings), STOPS)
def test_textures(data, image, settings, stop_at):
    mesh = data.draw(meshes())
    uv = data.draw(texture_coordinates(mesh))
    mask = data.draw(masks(*image.shape[:2]))
    arrays = [array for array in (image, uv, mask) if array is not None]
    try:
        atlas = core.TextureAtlas(mesh, uv, size=image.shape[:2])
    except core.InvalidUV as error:
        assert_sentence(error)
        return
    found = atlas.masks()
    assert (found.active | (found.face < 0)).all()
    assert np.isfinite(atlas.bake(np.ones((mesh.face_count, 3)))).all()
    assert all(text.endswith(".") for text in atlas.report.sentences())
    assert atlas.texel_size > 0
    shared = data.draw(st.sampled_from([None, atlas]))
    try:
        result = call(
            lambda watch: core.sharpen_texture(
                mesh, uv, image, settings, mask=mask, progress=watch, atlas=shared),
            *arrays, stop_at=stop_at)  # fmt: skip
    except core.InvalidSignal as error:
        assert "normal" in str(error) or abs(image).max() > 1e30
        return
    assert_alike(result, image)
    if settings.time == 0:
        assert_same_bits(result, image)
    if mask is not None:
        kept = (mask == 0) & atlas.inside
        assert_same_bits(result[kept], image[kept])
    if settings.content == "values":
        if settings.alpha == "auto" and image.shape[2:] in ((2,), (4,)):
            result, image = result[..., :-1], image[..., :-1]  # opacity is brought to [0, 1]
        flat = (-1, *image.shape[2:])
        assert_within(result.reshape(flat), image.reshape(flat), slack=1e-6)


@examples(40)
@given(st.data(), images(), settings_of(core.DilateSettings), STOPS)
def test_dilate_texture(data, image, settings, stop_at):
    mesh = data.draw(meshes())
    uv = data.draw(texture_coordinates(mesh))
    try:
        result = call(
            lambda watch: core.dilate_texture(mesh, uv, image, settings, progress=watch), image, uv,
            stop_at=stop_at)  # fmt: skip
    except core.InvalidUV:
        return
    except core.InvalidSignal:
        assert abs(image).max() > 1e30
        return
    inside = core.TextureAtlas(mesh, uv, size=image.shape[:2]).inside
    assert_same_bits(result[inside], image[inside])
    flat = (-1, *image.shape[2:])
    assert_within(result.reshape(flat), image.reshape(flat), slack=1e-6)


@examples(60)
@given(st.data())
def test_what_cannot_be_filtered_is_refused(data):
    image = data.draw(images())
    assume(len(image) > 1)
    bad_image = data.draw(broken(image))
    bad_mask = data.draw(broken(np.ones(image.shape[:2])))
    mesh = data.draw(meshes())
    uv = data.draw(texture_coordinates(mesh))
    bad_uv = data.draw(broken(uv))
    filters = [
        lambda: core.sharpen_image(bad_image),
        lambda: core.sharpen_image(image, mask=bad_mask),
        lambda: core.sharpen_image(image, out=np.empty((*image.shape, 2), image.dtype)),
        lambda: core.beltrami_image(bad_image),
        lambda: core.beltrami_image(image, mask=bad_mask),
        lambda: core.beltrami_manifold(image, data.draw(broken(np.zeros((*image.shape[:2], 3))))),
        lambda: core.osher_rudin_image(bad_image, steps=2),
        lambda: core.sharpen_texture(mesh, bad_uv, image),
        lambda: core.sharpen_texture(mesh, uv, bad_image),
        lambda: core.sharpen_texture(mesh, uv, image, mask=bad_mask),
        lambda: core.dilate_texture(mesh, bad_uv, image),
        lambda: core.dilate_texture(mesh, uv, bad_image),
        lambda: core.TextureAtlas(mesh, bad_uv, size=(8, 8)),
    ]
    function = data.draw(st.sampled_from(filters))
    try:
        function()
    except core.ShockError as error:
        assert_sentence(error)
