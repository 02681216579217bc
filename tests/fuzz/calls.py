# SPDX-License-Identifier: GPL-3.0-or-later
"""One small valid call of each public function, and what may stand wrongly in an argument's place.

`CALLS` has one for each name; `wrong_values` lists what may stand for an argument.
"""

from typing import Any, NamedTuple

import numpy as np
from shapes import grid
from shock_filter import core

SIZE = 6, 5


def _mesh():
    vertices, faces = grid(2, 2)
    vertices[:, 2] = 0.3 * vertices[:, 0] ** 2
    return core.TriangleMesh(vertices, faces)


MESH = _mesh()
UV = 0.1 + 0.4 * MESH.vertices[MESH.faces][..., :2]
_RANDOM = np.random.default_rng(0)
IMAGE = _RANDOM.random((*SIZE, 3))
GRAY = _RANDOM.random(SIZE)
MASK = _RANDOM.random(MESH.vertex_count)
WEIGHTS = _RANDOM.random(SIZE)
SIGNAL = _RANDOM.random((MESH.vertex_count, 3))
CORNERS = _RANDOM.random((MESH.face_count, 3, 2))
VECTORS = _RANDOM.random((MESH.face_count, 3))
VELOCITY = _RANDOM.random((*SIZE, 2))
NORMALS = np.repeat(MESH.normals[:, None], 3, axis=1)
ATLAS = core.TextureAtlas(MESH, UV, size=SIZE)


class Call(NamedTuple):
    """A valid call: its arguments by name, and the class of its settings.

    `infinite` says that the result may hold NaN or infinity, `short` has settings that keep it
    fast.
    """

    words: dict[str, Any]
    settings: type | None = None
    infinite: bool = False
    short: dict[str, Any] = {}


def solved(gain, mask, progress=None):
    """Filter by a solver that was made before."""
    return SOLVER.filtered(gain, mask=mask, progress=progress)


SOLVER = core.TextureSolver(MESH, UV, IMAGE, atlas=ATLAS)

_TEXTURE = {"mesh": MESH, "uv": UV}
_DRAWN = {**_TEXTURE, "size": SIZE, "atlas": ATLAS}
_STITCHED = {**_TEXTURE, "images": [IMAGE, IMAGE[::-1]], "mask": WEIGHTS, "normals": NORMALS,
             "atlas": ATLAS}  # fmt: skip
_FLOWS = {"velocity": VELOCITY, "size": SIZE, "mask": WEIGHTS > 0.1}
_SOURCE = {"points": [(0.5, 0.5), (0.2, 0.3)], "width": 2.0, "colors": [(1, 0, 0)], "every": 2,
           "lasting": 1}  # fmt: skip

CALLS = {
    "DyeSource": Call(_SOURCE),
    "TextureAtlas": Call({**_TEXTURE, "size": SIZE}),
    "TextureSolver": Call(
        {**_TEXTURE, "image": IMAGE, "normals": NORMALS, "atlas": ATLAS}, core.FilterSettings
    ),
    "TextureSolver.filtered": Call({"gain": 2 * WEIGHTS, "mask": WEIGHTS}),
    "TriangleMesh": Call({"vertices": MESH.vertices, "faces": MESH.faces}),
    "advect_dye": Call(
        {**_FLOWS, "sources": core.DyeSource(**_SOURCE), "frames": 2,
         "noise": core.NoiseSettings(), "background": GRAY.astype(np.float32)},
        core.DyeSettings,
    ),
    "advect_noise": Call(
        {**_FLOWS, "frames": 2, "background": GRAY, "colors": IMAGE[0]}, core.NoiseSettings
    ),
    "advect_on_surface": Call(
        {**_DRAWN, "field": VECTORS, "frames": 2, "at": "faces", "background": GRAY,
         "colors": IMAGE[0]},
        core.NoiseSettings,
    ),
    "axis_directions": Call({"mesh": MESH, "axis": [1.0, 0, 0], "turned": True}),
    "beltrami_corner_signal": Call(
        {"mesh": MESH, "signal": CORNERS, "mask": MASK}, core.BeltramiMeshSettings
    ),
    "beltrami_image": Call({"image": IMAGE, "mask": WEIGHTS}, core.BeltramiSettings),
    "beltrami_joint": Call(
        {"mesh": MESH, "signal": SIGNAL, "mask": MASK}, core.BeltramiMeshSettings
    ),
    "beltrami_manifold": Call(
        {"image": IMAGE, "embedding": _RANDOM.random((*SIZE, 3)), "mask": WEIGHTS,
         "smooth": "both"},
        core.BeltramiSettings,
    ),
    "beltrami_mesh": Call({"mesh": MESH, "mask": MASK}, core.BeltramiGeometrySettings),
    "beltrami_texture": Call(
        {**_TEXTURE, "image": IMAGE, "mask": WEIGHTS, "atlas": ATLAS},
        core.BeltramiTextureSettings,
    ),
    "beltrami_vertex_signal": Call(
        {"mesh": MESH, "signal": SIGNAL, "mask": MASK}, core.BeltramiMeshSettings
    ),
    "ambient_occlusion": Call({**_DRAWN, "occluders": [MESH]}, core.OcclusionSettings),
    "bake_maps": Call(
        {**_DRAWN, "maps": ["occlusion", "normals"], "high": MESH, "colors": SIGNAL,
         "normals": NORMALS, "occluders": [MESH]},
        core.BakeSettings,
    ),
    "bent_normals": Call({**_DRAWN, "occluders": [MESH]}, core.OcclusionSettings),
    "curvature": Call({"mesh": MESH, "radius": 0.5}),
    "curvature_directions": Call(_DRAWN, core.CurvatureSettings),
    "curvature_map": Call(_DRAWN, core.CurvatureSettings),
    "denoise_geometry": Call({"mesh": MESH, "mask": MASK}, core.BeltramiGeometrySettings),
    "dilate_texture": Call({**_TEXTURE, "image": IMAGE, "atlas": ATLAS}, core.DilateSettings),
    "enlarge_texture": Call({**_TEXTURE, "image": IMAGE, "atlas": ATLAS}, core.EnlargeSettings),
    "fill_texture": Call(
        {**_TEXTURE, "image": IMAGE, "missing": WEIGHTS > 0.5, "normals": NORMALS, "atlas": ATLAS},
        core.FillSettings,
    ),
    "filter_texture": Call(
        {**_TEXTURE, "image": IMAGE, "gain": 2 * WEIGHTS, "mask": WEIGHTS, "normals": NORMALS,
         "atlas": ATLAS},
        core.FilterSettings,
    ),
    "find_missing": Call({**_TEXTURE, "image": IMAGE, "atlas": ATLAS}, core.FillSettings),
    "fit_to_normals": Call(
        {"mesh": MESH, "normals": MESH.normals, "mask": MASK}, core.FitSettings
    ),
    "flow_field": Call({"mesh": MESH, "signal": SIGNAL}, core.ShockSettings),
    "flow_frames": Call(
        {"velocity": VELOCITY, "columns": 300, "width": 8.0, "duration": 4.0, "step": 6.0,
         "mask": WEIGHTS > 0.1}
    ),
    "flow_map_velocity": Call({"image": IMAGE, "y_axis": "down"}, infinite=True),
    "geodesic_distance": Call(
        {**_DRAWN, "vertices": [0], "points": ([1], [[0.2, 0.3, 0.5]]),
         "edges": [[0, 1]], "image": GRAY},
        core.DistanceSettings, infinite=True,
    ),
    "geometry_flow": Call({"mesh": MESH}, core.GeometrySettings),
    "gradient_directions": Call({"mesh": MESH, "signal": SIGNAL[:, 0], "turned": False}),
    "line_integral_convolution": Call({**_FLOWS, "noise": GRAY}, core.ConvolutionSettings),
    "make_tileable": Call({"image": IMAGE, "mask": WEIGHTS}, core.TileSettings),
    "object_normals": Call(
        {**_TEXTURE, "image": IMAGE, "normals": NORMALS, "atlas": ATLAS}, core.DilateSettings
    ),
    "osher_rudin_image": Call(
        {"image": IMAGE, "steps": 2, "time_step": 0.3, "edge_detector": "laplacian"}
    ),
    "principal_directions": Call({"mesh": MESH, "which": "most", "passes": 2}),
    "reaction_diffusion": Call(
        {**_DRAWN, "start": _RANDOM.random((*SIZE, 2)), "rates": 1 + GRAY,
         "directions": VECTORS, "at": "faces"},
        core.ReactionSettings, short={"steps": 2},
    ),
    "remove_blocks": Call({"image": IMAGE, "mask": WEIGHTS}, core.BlockSettings),
    "repair_texture": Call(
        {**_TEXTURE, "image": IMAGE, "missing": WEIGHTS > 0.5, "normals": NORMALS, "atlas": ATLAS},
        core.RepairSettings,
    ),
    "repair_textures": Call(
        {**_TEXTURE, "images": [IMAGE, IMAGE], "contents": ["values", "values"],
         "normals": NORMALS},
        core.RepairSettings,
    ),
    "sharpen_corner_signal": Call(
        {"mesh": MESH, "signal": CORNERS, "mask": MASK}, core.ShockSettings
    ),
    "sharpen_geometry": Call({"mesh": MESH, "mask": MASK}, core.GeometrySettings),
    "sharpen_image": Call(
        {"image": IMAGE, "mask": WEIGHTS, "guide": GRAY, "out": np.empty_like(IMAGE),
         "known": None},
        core.ImageSettings,
    ),
    "crisp_low_poly": Call(
        {"mesh": MESH, "tolerance": 0.2, "turn": 5.0, "angle": 20.0, "keep": [[0, 1], [3, 4]]},
        core.GeometrySettings,
    ),
    "find_creases": Call(
        {"mesh": MESH, "angle": 20.0, "edges": MESH.faces[:, :2]}, core.GeometrySettings
    ),
    "sharpen_normals": Call({"mesh": MESH}, core.GeometrySettings),
    "sharpen_texture": Call(
        {**_TEXTURE, "image": IMAGE, "mask": WEIGHTS, "guide": GRAY, "atlas": ATLAS},
        core.TextureSettings,
    ),
    "sharpen_vertex_signal": Call(
        {"mesh": MESH, "signal": SIGNAL, "mask": MASK}, core.ShockSettings
    ),
    "stitch_textures": Call(
        {**_STITCHED, "confidences": [WEIGHTS, WEIGHTS], "labels": None}, core.StitchSettings
    ),
    "stitch_textures by labels": Call(
        {**_STITCHED, "confidences": None, "labels": (GRAY > 0.5).astype(int)},
        core.StitchSettings,
    ),
    "surface_line_convolution": Call(
        {**_DRAWN, "directions": VECTORS, "at": "faces"}, core.StreakSettings
    ),
    "tangent_normals": Call(
        {**_TEXTURE, "image": IMAGE, "normals": NORMALS, "atlas": ATLAS}, core.DilateSettings
    ),
    "vertex_distance": Call(
        {"mesh": MESH, "vertices": [0], "points": ([1], [[0.2, 0.3, 0.5]]), "edges": [[0, 1]]},
        core.DistanceSettings, infinite=True,
    ),
    "thickness": Call(_DRAWN, core.ThicknessSettings),
    "wear": Call({**_DRAWN, "edges": MESH.faces[:, :2]}, core.WearSettings),
    "vertex_wear": Call({"mesh": MESH, "edges": MESH.faces[:, :2]}, core.WearSettings),
    "weld": Call({"vertices": MESH.vertices}),
    "weld_borders": Call({"vertices": MESH.vertices, "faces": MESH.faces}),
}  # fmt: skip


def function_of(name):
    """The function, or the method of an object that was made before."""
    return solved if name == "TextureSolver.filtered" else getattr(core, name.split()[0])


_THINGS = [
    None, "", "nonsense", b"7", {}, [], [[]], [[1.0], [1.0, 2.0]], object(), 1j, True, -1, 0, 2.5,
    1e300, -1e300, np.nan, np.inf, 10**30, -(10**30), np.float16(np.inf), np.array(3.0),
    np.array("faces"), np.array(["faces", "faces"]), np.zeros(0), np.zeros((0, 3)),
    np.full((2, 2), np.nan), np.ones((3, 3, 3, 3)), np.array([None, 1.0]), [None, None],
    (-1, 4), (2.5, 4), (0, 0), (10**9, 10**9), (2**40, 1), (np.nan, 4), (10**30, 4), ("a", "b"),
    (True, True), np.datetime64("2020-01-01"), np.ones((6, 5), dtype=bool), range(4),
    lambda *_: 1.0, np.ma.masked, float("-inf"), np.array([1, 2], dtype="M8[s]"),
]  # fmt: skip


def _spoiled(array):
    # An array of numbers: with a wrong value, of another type or another shape.
    floats = array.astype(np.float64)
    for value in (np.nan, np.inf, -np.inf, 1e300, -1e300, -1.0, 1e-310, 1e38, 1.5):
        changed = floats.copy()
        changed.reshape(-1)[array.size // 2] = value
        yield changed
    half = floats.astype(np.float16)
    half.reshape(-1)[0] = np.inf
    yield half
    with np.errstate(over="ignore", invalid="ignore"):
        for kind in (np.float16, np.float32, np.longdouble, bool, np.int8, np.uint8, np.int64,
                     np.uint64, complex, object, str, "M8[s]", ">f8"):  # fmt: skip
            yield (array if kind == ">f8" else floats.astype(np.int64)
                   if kind == "M8[s]" else floats).astype(kind)  # fmt: skip
    broken = floats.astype(object)
    broken.reshape(-1)[0] = None
    yield broken
    yield from (np.full(array.shape, value) for value in (0.0, np.nan, 1e30, -0.0, 2**62))
    yield from (array[:-1], array[..., :-1], array[None], array[..., None], array[:0], array.T)
    yield from (array[..., :0], np.zeros((*array.shape, 2)), array.ravel(), array[::-1])
    yield from (np.asfortranarray(array), array.tolist(), np.ma.masked_all(array.shape))


def wrong_values(value):
    """Yield what may stand for a valid value; some of it is right by chance."""
    yield from _THINGS
    if isinstance(value, list | tuple) and value and isinstance(value[0], np.ndarray):
        yield from (value[:1], [*value, value[0]], [value[0], None], [value[0], value[1][:-1]])
        yield from ([value[0], changed] for changed in _spoiled(value[0]))
    elif isinstance(value, tuple) and len(value) == 2 and isinstance(value[0], list):
        yield from (value[:1], (*value, value[0]), value[::-1])
        yield from ((value[0], changed) for changed in _spoiled(np.array(value[1])))
        yield from ((changed, value[1]) for changed in _spoiled(np.array(value[0])))
    elif isinstance(value, list) and value and isinstance(value[0], core.TriangleMesh):
        yield from ([*value, None], value[0], [value], tuple(value))
    elif isinstance(value, list) and value and isinstance(value[0], str):
        yield from ([*value, "nonsense"], value[0], tuple(value), [None], [np.ones(3)], [])
    elif isinstance(value, np.ndarray | list | tuple):
        yield from _spoiled(np.asarray(value))


def wrong_settings(kind, value):
    """Yield what may stand for a setting of a kind."""
    if kind is str:
        yield from ("", "nonsense", None, 3, np.array(value))
    elif kind is int:
        yield from (-1, 0, 1, 2, 3, 2.5, "2", None, np.nan, np.inf, 10**30, np.array(2), True)
    else:
        yield from (
            *(-1.0, 0.0, -0.0, 1e-310, 1e-30, 1e-3, 0.5, 1.0, 7.3, 1e3, 1e9, 1e30, 1e300),
            *(np.nan, np.inf, -np.inf, "2", None, 10**30, np.array(0.3), np.float16(0.1), True),
        )
