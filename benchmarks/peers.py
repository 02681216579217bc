# SPDX-License-Identifier: GPL-3.0-or-later
"""Other programs' filters, called on arrays: Lagrange, MeshLab, potpourri3d, pygeodesic."""

from __future__ import annotations

import importlib.util
import time
from functools import cache
from typing import Any

import numpy as np

PACKAGES = {
    "Lagrange": ("lagrange", "lagrange-open"),
    "MeshLab": ("pymeshlab", "pymeshlab"),
    "potpourri3d": ("potpourri3d", "potpourri3d"),
    "pygeodesic": ("pygeodesic", "pygeodesic"),
    "rlic": ("rlic", "rlic"),
}
"""Per program, the module that is imported and the package that brings it."""

Settings = dict[str, Any]

TRIED: dict[str, tuple[str, str, list[Settings]]] = {
    "MeshLab two-step smoothing": (
        "MeshLab",
        "apply_coord_two_steps_smoothing",
        [{"stepsmoothnum": 3, "normalthr": 60.0, "stepnormalnum": 20, "stepfitnum": 20}]
        + [
            {"stepsmoothnum": 1, "normalthr": threshold, "stepnormalnum": turns, "stepfitnum": fits}
            for threshold in (60.0, 30.0, 15.0)
            for turns, fits in ((20, 20), (5, 5), (5, 1))
        ],
    ),
    "MeshLab unsharp mask": (
        "MeshLab",
        "apply_coord_unsharp_mask",
        [
            {"weight": weight, "weightorig": 1.0, "iterations": iterations}
            for weight in (0.1, 0.3, 0.6, 1.0)
            for iterations in (1, 3, 5, 10)
        ],
    ),
    "Lagrange mesh_smoothing": (
        "Lagrange",
        "mesh_smoothing",
        [
            {
                "method": method,
                "curvature_weight": curvature,
                "gradient_weight": gradient,
                "gradient_modulation_scale": scale,
            }
            for method, curvature, gradient, scale in (
                ("NormalSmoothing", 0.02, 1e-4, 0.0),
                ("NormalSmoothing", 0.02, 1e-4, 2.0),
                ("NormalSmoothing", 0.005, 1e-4, 2.0),
                ("NormalSmoothing", 0.0, 1e-5, 10.0),
                ("VertexSmoothing", 0.02, 1e-4, 0.0),
                ("VertexSmoothing", 0.02, 1e-4, 2.0),
                ("VertexSmoothing", 0.0, 1e-5, 2.0),
                ("VertexSmoothing", 0.0, 1e-5, 4.0),
                ("VertexSmoothing", 0.0, 1e-5, 6.0),
                ("VertexSmoothing", 0.0, 1e-6, 30.0),
            )
        ],
    ),
}
"""Per method: program, filter, and the settings that are tried; the first are its defaults."""

DENOISERS: dict[str, tuple[str, str, list[Settings]]] = {
    "MeshLab two-step smoothing": (
        "MeshLab",
        "apply_coord_two_steps_smoothing",
        [
            {
                "stepsmoothnum": steps,
                "normalthr": threshold,
                "stepnormalnum": turns,
                "stepfitnum": fits,
            }
            for steps, threshold in ((3, 60.0), (1, 60.0), (3, 90.0), (1, 90.0))
            for turns, fits in ((20, 20), (5, 20), (5, 5))
        ],
    ),
    "MeshLab Taubin": (
        "MeshLab",
        "apply_coord_taubin_smoothing",
        [{"stepsmoothnum": steps} for steps in (10, 5, 20, 40, 80)],
    ),
    "MeshLab HC Laplacian": (
        "MeshLab",
        "apply_coord_hc_laplacian_smoothing",
        [{"times": times} for times in (1, 2, 3, 4, 6)],
    ),
    "Lagrange mesh_smoothing": (
        "Lagrange",
        "mesh_smoothing",
        [
            {"method": method, "curvature_weight": curvature, "gradient_weight": gradient}
            for method in ("NormalSmoothing", "VertexSmoothing")
            for curvature in (0.02, 0.2)
            for gradient in (1e-4, 3e-4, 1e-3)
        ],
    ),
}
"""The same for denoising; `times` is how often the filter is applied on its own result."""


@cache
def installed(program: str) -> bool:
    """Tell whether a program can be called; if not, say so in a line."""
    module, package = PACKAGES[program]
    if importlib.util.find_spec(module):
        return True
    print(f"{program} is not installed and left out (pip install {package}).", flush=True)
    return False


def apply(
    program: str, name: str, settings: Settings, vertices: np.ndarray, faces: np.ndarray
) -> tuple[np.ndarray, float]:
    """Run a filter; return the new positions and the seconds that the filter itself took."""
    run = _lagrange if program == "Lagrange" else _meshlab
    return run(name, settings, vertices, faces)


def _lagrange(
    name: str, settings: Settings, vertices: np.ndarray, faces: np.ndarray
) -> tuple[np.ndarray, float]:
    import lagrange

    lagrange.logger.setLevel("ERROR")
    mesh = lagrange.SurfaceMesh()
    mesh.add_vertices(np.array(vertices))
    mesh.add_triangles(np.array(faces, dtype=np.uint32))
    start = time.perf_counter()
    getattr(lagrange.filtering, name)(mesh, **settings)
    seconds = time.perf_counter() - start
    return np.array(mesh.vertices), seconds


def _meshlab(
    name: str, settings: Settings, vertices: np.ndarray, faces: np.ndarray
) -> tuple[np.ndarray, float]:
    import pymeshlab

    meshes = pymeshlab.MeshSet()
    meshes.add_mesh(pymeshlab.Mesh(vertices, faces))
    start = time.perf_counter()
    getattr(meshes, name)(**settings)
    seconds = time.perf_counter() - start
    return meshes.current_mesh().vertex_matrix(), seconds


def decimated(vertices: np.ndarray, faces: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return a mesh with about `count` faces, by MeshLab."""
    import pymeshlab

    meshes = pymeshlab.MeshSet()
    meshes.add_mesh(pymeshlab.Mesh(vertices, faces))
    meshes.apply_filter("meshing_decimation_quadric_edge_collapse", targetfacenum=count)
    mesh = meshes.current_mesh()
    return mesh.vertex_matrix(), mesh.face_matrix().astype(np.int64)


def filter_texture(
    vertices: np.ndarray,
    faces: np.ndarray,
    uv: np.ndarray,
    image: np.ndarray,
    scale: float,
    weight: float = 1e3,
) -> tuple[np.ndarray, float]:
    """Run Lagrange's texture filter; return the new image, white as 1, and the filter's seconds.

    Parameters
    ----------
    uv : (m, 3, 2) array
    image : (h, w, c) uint8
        Row 0 at v = 0.
    scale : float
        What gradients are multiplied by.
    weight : float
        Weight of the values, on a surface of unit area.

    Raises
    ------
    RuntimeError
        If Lagrange refuses the mesh; the first line says why.
    """
    import lagrange

    lagrange.logger.setLevel("ERROR")
    used, renamed = np.unique(faces, return_inverse=True)
    corners, indices = np.unique(uv.reshape(-1, 2), axis=0, return_inverse=True)
    mesh = lagrange.SurfaceMesh()
    mesh.add_vertices(np.ascontiguousarray(vertices[used], dtype=np.float64))
    mesh.add_triangles(renamed.reshape(-1, 3).astype(np.uint32))
    mesh.create_attribute(
        "uv",
        element=lagrange.AttributeElement.Indexed,
        usage=lagrange.AttributeUsage.UV,
        initial_values=corners,
        initial_indices=indices.ravel().astype(np.uint32),
    )
    values = np.ascontiguousarray(image[::-1], dtype=np.float32) / 255  # its row 0 is at v = 1
    start = time.perf_counter()
    result = lagrange.texproc.texture_filtering(
        mesh, values, value_weight=weight, gradient_scale=scale
    )
    return np.array(result)[::-1], time.perf_counter() - start


def heat_distance(vertices: np.ndarray, faces: np.ndarray, source: int) -> tuple[np.ndarray, float]:
    """Geodesic distance of the vertices from one by the heat method of potpourri3d, and seconds."""
    import potpourri3d

    start = time.perf_counter()
    solver = potpourri3d.MeshHeatMethodDistanceSolver(vertices, faces)
    found = solver.compute_distance(source)
    return found, time.perf_counter() - start


def exact_distance(
    vertices: np.ndarray, faces: np.ndarray, source: int
) -> tuple[np.ndarray, float]:
    """Exact distance on the mesh by pygeodesic, of all vertices from one; and seconds."""
    from pygeodesic import geodesic

    start = time.perf_counter()
    solver = geodesic.PyGeodesicAlgorithmExact(vertices, faces.astype(np.int32))
    found, _ = solver.geodesicDistances(np.array([source]), None)
    return np.asarray(found), time.perf_counter() - start
