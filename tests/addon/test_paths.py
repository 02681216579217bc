# SPDX-License-Identifier: GPL-3.0-or-later
"""Images in Blender whose files have spaces and letters beyond ASCII in their names."""

import bpy
import numpy as np
import pytest


@pytest.mark.parametrize("ending", ["PNG", "TIFF", "OPEN_EXR"])
def test_an_image_is_sharpened_and_saved(tmp_path, ending):
    folder = tmp_path / "Für Änne & 三角"
    folder.mkdir()
    path = folder / f"größe 1 (копия).{ending[-4:].lower()}"
    image = bpy.data.images.new("größe 三角", 16, 16, float_buffer=ending == "OPEN_EXR")
    image.file_format = ending
    soft = np.ones((16, 16, 4), np.float32)
    soft[..., :3] = (1 / (1 + np.exp(-(np.arange(16) - 7.5) / 2)))[:, None]
    image.pixels.foreach_set(soft.ravel())
    image.filepath_raw = str(path)
    image.save()
    loaded = bpy.data.images.load(str(path))
    result = bpy.ops.shock_filter.sharpen_image(image=loaded.name, time=1024.0, output="REPLACE")
    assert result == {"FINISHED"}
    loaded.save()
    again = bpy.data.images.load(str(path), check_existing=False)
    pixels = np.empty(1024, np.float32)
    again.pixels.foreach_get(pixels)
    steepest = np.diff(pixels.reshape(16, 16, 4)[8, :, 0]).max()
    assert steepest > 1.5 * np.diff(soft[8, :, 0]).max()
