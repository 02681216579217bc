# SPDX-License-Identifier: GPL-3.0-or-later
"""Tangent frames are those that Blender shades with."""

import bpy
import numpy as np
import pytest
from shock_filter import core
from shock_filter.core.mesh.tangents import smooth_normals, tangent_frames


def bumpy(n=9, mirrored=False):
    """A bumpy sheet, and coordinates that are cut, turned, and perhaps mirrored on one side."""
    rng = np.random.default_rng(0)
    x, y = np.meshgrid(np.arange(n), np.arange(n), indexing="ij")
    vertices = np.stack([x, y, rng.uniform(-0.4, 0.4, x.shape)], axis=-1).reshape(-1, 3)
    a = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).reshape(-1)
    faces = np.concatenate(
        [np.stack([a, a + n, a + n + 1], axis=1), np.stack([a, a + n + 1, a + 1], axis=1)]
    )
    flat = vertices[:, :2] + rng.uniform(-0.2, 0.2, (len(vertices), 2))
    uv = flat[faces] / (4 * n) + 0.1
    far = vertices[faces].mean(axis=1)[:, 0] > n / 2
    turned = uv @ np.array([[0.6, 0.8], [-0.8, 0.6]]) + [0.5, 0.3]
    uv[far] = turned[far] * ([-1.0, 1.0] if mirrored else [1.0, 1.0])
    return vertices, faces, uv.astype(np.float32).astype(np.float64)


@pytest.mark.parametrize("mirrored", [False, True])
def test_tangents_are_blenders(mirrored):
    vertices, faces, uv = bumpy(mirrored=mirrored)
    data = bpy.data.meshes.new("Sheet")
    data.from_pydata(vertices.tolist(), [], faces.tolist())
    data.shade_smooth()
    data.uv_layers.new(name="UV").data.foreach_set("uv", uv.reshape(-1).astype(np.float32))
    data.calc_tangents(uvmap="UV")
    found = {name: np.empty((3 * len(faces), 3)) for name in ("normal", "tangent")}
    signs = np.empty(3 * len(faces))
    for name, array in found.items():
        flat = np.empty(array.size, dtype=np.float32)
        data.loops.foreach_get(name, flat)
        array[:] = flat.reshape(-1, 3)
    data.loops.foreach_get("bitangent_sign", signs_32 := np.empty(len(signs), dtype=np.float32))
    bpy.data.meshes.remove(data)
    mesh = core.TriangleMesh(vertices, faces)
    frames = tangent_frames(mesh, uv)
    assert np.allclose(smooth_normals(mesh).reshape(-1, 3), found["normal"], atol=1e-4)
    assert np.allclose(np.repeat(frames.signs, 3), signs_32)
    assert np.allclose(frames.tangents.reshape(-1, 3), found["tangent"], atol=1e-3)
