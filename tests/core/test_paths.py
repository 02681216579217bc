# SPDX-License-Identifier: GPL-3.0-or-later
"""Names of files and folders with spaces and letters beyond ASCII, in every format."""

import numpy as np
import pytest
import trimesh
from PIL import Image
from shock_filter.core import cli

FOLDER = "Für Änne & 三角 v1.0"
NAME = "größe 1 (копия)"


@pytest.fixture
def folder(tmp_path):
    path = tmp_path / FOLDER
    path.mkdir()
    return path


@pytest.mark.parametrize("ending", [".obj", ".ply", ".stl", ".off", ".glb"])
def test_meshes(folder, ending):
    source, target = folder / f"{NAME}{ending}", folder / f"{NAME} scharf{ending}"
    trimesh.creation.icosphere(subdivisions=1).export(source)
    assert cli.main(["sharpen-geometry", str(source), str(target)]) == 0
    assert len(trimesh.load_mesh(target).faces) == 80


@pytest.mark.parametrize("ending", [".png", ".tif", ".exr", ".bmp", ".jpg", ".webp", ".npy"])
def test_images(folder, ending):
    source, target = folder / f"{NAME}{ending}", folder / f"{NAME} scharf{ending}"
    pixels = np.random.default_rng(0).integers(0, 256, (8, 8, 3)).astype(np.uint8)
    if ending == ".npy":
        np.save(source, pixels)
    elif ending == ".exr":
        image = folder / "other.npy"
        np.save(image, pixels.astype(np.float32))
        assert cli.main(["sharpen-image", str(image), str(source)]) == 0
    else:
        Image.fromarray(pixels).save(source)
    assert cli.main(["sharpen-image", str(source), str(target)]) == 0
    assert target.stat().st_size > 0
