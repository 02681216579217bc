# SPDX-License-Identifier: GPL-3.0-or-later
"""The extra ``files`` reads and writes images and meshes of all kinds."""

import numpy as np
import pytest

OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n"


@pytest.mark.parametrize("ending", ["png", "jpg", "webp", "tif", "exr", "bmp"])
def test_images(shock_filter, tmp_path, ending):
    values = np.random.default_rng(0).random((16, 24, 3), np.float32)
    np.save(tmp_path / "in.npy", values if ending == "exr" else (255 * values).astype(np.uint8))
    shock_filter("sharpen-image", "in.npy", f"there.{ending}")
    shock_filter("sharpen-image", f"there.{ending}", "back.npy")
    assert np.load(tmp_path / "back.npy").shape == (16, 24, 3)


@pytest.mark.parametrize("ending", ["ply", "obj", "stl", "glb", "off"])
def test_meshes(shock_filter, tmp_path, ending):
    (tmp_path / "in.obj").write_text(OBJ, encoding="utf-8")
    shock_filter("sharpen-geometry", "in.obj", f"there.{ending}")
    shock_filter("sharpen-geometry", f"there.{ending}", "back.obj")
    assert (tmp_path / "back.obj").read_text(encoding="utf-8").count("\nf ") == 4
