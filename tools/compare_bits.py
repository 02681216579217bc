# SPDX-License-Identifier: GPL-3.0-or-later
"""Compare results of an earlier commit with those of this tree, bit for bit.

``python tools/compare_bits.py COMMIT`` makes some 50 calls of public functions on arrays that it
makes itself, in a process with the commit's code and in one with this tree's, and prints whose
results differ and by how much. It ends with 1 if any does. ``--known NAME ...`` names calls whose
results are meant to have changed. Needs git.
"""

from __future__ import annotations

import argparse
import inspect
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
SIZE = 96, 128


def remesh(distance: Callable[[np.ndarray], np.ndarray], cells: int) -> tuple[Any, Any]:
    """Return vertices and triangles of a surface net of a distance function on [-1.5, 1.5]^3."""
    from remeshed import surface_net

    line = np.linspace(-1.5, 1.5, cells + 1)
    points = np.stack(np.meshgrid(line, line, line, indexing="ij"), axis=-1)
    vertices, faces = surface_net(distance(points), 3.0 / cells)
    return vertices - 1.5, faces


def bracket(points: np.ndarray) -> np.ndarray:
    """Return the distance to a turned angle bracket, negative inside."""
    turn, _ = np.linalg.qr(np.array([[1.0, 0.2, 0.1], [-0.3, 1.0, 0.2], [0.1, -0.2, 1.0]]))
    x, y, z = np.moveaxis(points @ turn, -1, 0)
    foot = np.maximum.reduce([abs(x) - 1.0, abs(y) - 0.6, abs(z + 0.6) - 0.25])
    wall = np.maximum.reduce([abs(x + 0.75) - 0.25, abs(y) - 0.6, abs(z) - 0.85])
    return np.minimum(foot, wall)


def blob(points: np.ndarray) -> np.ndarray:
    """Return the distance, about, to a ball with bumps, negative inside."""
    bumps = np.sin(5 * points).prod(axis=-1)
    return np.linalg.norm(points, axis=-1) - 1.0 - 0.08 * bumps


def picture(random: np.random.Generator, channels: int = 3) -> np.ndarray:
    """Return soft shapes with a little noise: (h, w, channels) in [0, 1]."""
    y, x = np.mgrid[: SIZE[0], : SIZE[1]]
    layers = []
    for c in range(channels):
        circle = np.hypot(y - 40 - 5 * c, x - 60) - 25
        stripe = (x + 0.5 * y - 90 - 9 * c) / 1.1
        layers.append(0.1 + 0.5 / (1 + np.exp(circle / 2.5)) + 0.3 / (1 + np.exp(stripe / 1.5)))
    return np.clip(np.stack(layers, -1) + 0.004 * random.normal(size=(*SIZE, channels)), 0, 1)


def calls() -> Iterator[tuple[str, str, dict[str, Any]]]:
    """Yield a name, the function's name and its arguments by name, for each call."""
    from shock_filter import core

    random = np.random.default_rng(7)
    part = core.TriangleMesh(*remesh(bracket, 40))
    ball = core.TriangleMesh(*remesh(blob, 28))
    edge = part.mean_edge_length
    noisy = core.TriangleMesh(
        part.vertices + 0.15 * edge * random.normal(size=part.vertices.shape), part.faces
    )
    weights = np.clip(part.vertices[:, 0] + 0.5, 0, 1)
    paint = 1 / (1 + np.exp(-8 * np.sin(3 * ball.vertices)))
    corners = paint[ball.faces] + 0.3 * (ball.normals[:, :1, None] > 0)
    geometry, denoising = core.GeometrySettings, core.BeltramiGeometrySettings
    everywhere, kernel = {"where": "everywhere"}, {"method": "beltrami"}

    for name, settings in (
        ("", geometry()),
        (" everywhere", geometry(**everywhere)),
        (" repeated", geometry(time=64.0, repeat=3, **everywhere)),
        (" by half", geometry(amount=0.5)),
        (" in one step", geometry(fit_steps=1, **everywhere)),
    ):
        yield f"geometry{name}", "sharpen_geometry", {"mesh": part, "settings": settings}
    words = {"mesh": part, "mask": weights, "settings": geometry(**everywhere)}
    yield "geometry with a mask", "sharpen_geometry", words
    yield "geometry of a ball", "sharpen_geometry", {"mesh": ball}
    yield "normals", "sharpen_normals", {"mesh": part, "settings": geometry(**everywhere)}
    yield "flow of geometry", "geometry_flow", {"mesh": part}
    outward = ball.vertices[ball.faces].mean(axis=1)
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    yield "fit", "fit_to_normals", {"mesh": ball, "normals": outward}
    yield "denoised", "denoise_geometry", {"mesh": noisy}
    yield (
        "denoised ball",
        "denoise_geometry",
        {"mesh": ball, "settings": denoising(**kernel, time=4.0)},
    )
    words = {"mesh": noisy, "settings": denoising(**kernel, filtered="positions")}
    yield "denoised positions", "beltrami_mesh", words
    yield "denoised joint", "beltrami_joint", {"mesh": ball, "signal": paint}

    yield "vertex colors", "sharpen_vertex_signal", {"mesh": ball, "signal": paint}
    words = {"mesh": ball, "signal": paint, "settings": core.ShockSettings(time=300.0)}
    yield "vertex colors by time", "sharpen_vertex_signal", words
    yield "corner colors", "sharpen_corner_signal", {"mesh": ball, "signal": corners}
    yield "denoised vertex colors", "beltrami_vertex_signal", {"mesh": ball, "signal": paint}
    yield "denoised corner colors", "beltrami_corner_signal", {"mesh": ball, "signal": corners}
    yield "flow of colors", "flow_field", {"mesh": ball, "signal": paint}
    yield "directions", "principal_directions", {"mesh": ball}

    image = picture(random)
    with_alpha = picture(random, 4)
    mask = np.linspace(0, 1, SIZE[1]) * np.ones(SIZE)
    settings = core.ImageSettings
    for name, words in (
        ("", {"image": image}),
        (" of bytes", {"image": (255 * image).round().astype(np.uint8)}),
        (" of 16 bits", {"image": (65535 * image).round().astype(np.uint16)}),
        (" of float32", {"image": image.astype(np.float32)}),
        (" with opacity", {"image": with_alpha}),
        (" with a mask", {"image": image, "mask": mask}),
        (" by a guide", {"image": image[..., 0], "guide": image[..., 1:]}),
        (" enlarged", {"image": image, "settings": settings(enlarge=2)}),
        (" enlarged by width", {"image": image, "settings": settings(enlarge=2, what="drawing")}),
        (" by time", {"image": image, "settings": settings(time=500.0)}),
        (" as a photo", {"image": image, "settings": settings(what="photo")}),
        (" as a drawing", {"image": image, "settings": settings(what="drawing", width=5.0)}),
    ):
        yield f"image{name}", "sharpen_image", words
    yield "denoised image", "beltrami_image", {"image": image}
    yield "denoised image with opacity", "beltrami_image", {"image": with_alpha}
    words = {
        "image": image,
        "embedding": np.dstack([*np.mgrid[: SIZE[0], : SIZE[1]], image[..., 0]]),
    }
    yield "denoised manifold", "beltrami_manifold", {**words, "smooth": "both"}
    yield "image by PDE", "osher_rudin_image", {"image": image, "steps": 10}

    uv, size = layout(part)
    sheet = np.random.default_rng(3).random((*size, 3)).cumsum(axis=0).cumsum(axis=1) % 1.0
    shown = {"mesh": part, "uv": uv}
    yield "texture", "sharpen_texture", {**shown, "image": sheet}
    words = {"image": sheet[..., 0], "guide": sheet[..., 1:]}
    yield "texture by a guide", "sharpen_texture", {**shown, **words}
    words = {"image": sheet, "settings": core.TextureSettings(time=200.0)}
    yield "texture by time", "sharpen_texture", {**shown, **words}
    yield "denoised texture", "beltrami_texture", {**shown, "image": sheet}
    yield "dilated texture", "dilate_texture", {**shown, "image": sheet}
    yield "detail", "filter_texture", {**shown, "image": sheet}
    words = {"image": sheet, "settings": core.FilterSettings(gain=0.2), "mask": np.ones(size) / 2}
    yield "detail with a mask", "filter_texture", {**shown, **words}
    yield "stitched", "stitch_textures", {**shown, "images": [sheet, sheet[::-1]]}
    drawn = {**shown, "size": size}
    yield "distance", "geodesic_distance", {**drawn, "vertices": [0, 100]}
    yield "distance at vertices", "vertex_distance", {**drawn, "vertices": [0, 100]}
    words = {"directions": core.principal_directions(part), "at": "vertices"}
    if len(words["directions"]) == part.face_count:
        words["at"] = "faces"
    yield "streaks", "surface_line_convolution", {**drawn, **words}
    yield "pattern", "reaction_diffusion", {**drawn, "settings": core.ReactionSettings(steps=60)}
    field = np.cross(part.normals, [0.0, 0.3, 1.0])
    words = {"field": field, "frames": 3, "at": "faces"}
    yield "flow on a surface", "advect_on_surface", {**drawn, **words}

    y, x = np.mgrid[: SIZE[0], : SIZE[1]] - np.array(SIZE)[:, None, None] / 2
    velocity = np.stack([-y, x], axis=-1) / 40.0
    yield "noise in a flow", "advect_noise", {"velocity": velocity, "frames": 5}
    sources = core.DyeSource(points=[(30.0, 40.0), (70.0, 60.0)], width=5.0)
    yield "dye in a flow", "advect_dye", {"velocity": velocity, "sources": sources, "frames": 5}
    yield "streaks of a flow", "line_integral_convolution", {"velocity": velocity}


def layout(mesh: Any) -> tuple[np.ndarray, tuple[int, int]]:
    """Return texture coordinates (m, 3, 2), faces by the side that they look to, and a size."""
    side = abs(mesh.normals).argmax(axis=1) + 3 * (
        np.take_along_axis(mesh.normals, abs(mesh.normals).argmax(axis=1)[:, None], 1)[:, 0] < 0
    )
    places = mesh.vertices[mesh.faces]
    uv = np.empty((mesh.face_count, 3, 2))
    for s in range(6):
        axes = [a for a in range(3) if a != s % 3]
        uv[side == s] = (places[side == s][..., axes] + 1.5) / 3.2
    uv[..., 0] = (uv[..., 0] + side[:, None] % 3) / 3
    uv[..., 1] = (uv[..., 1] + side[:, None] // 3) / 2
    return uv, (160, 240)


def results(path: str) -> None:
    """Make all calls with the package that is on the path, and keep their arrays in a file."""
    from shock_filter import core

    kept = {}
    for name, function, words in calls():
        call = getattr(core, function)
        known = inspect.signature(call).parameters
        result = call(**{word: value for word, value in words.items() if word in known})
        arrays = result if isinstance(result, tuple) else (result,)
        if not all(isinstance(each, np.ndarray) for each in arrays):
            arrays = tuple(np.asarray(frame) for frame in result)
        for number, array in enumerate(arrays):
            kept[f"{name}/{number}"] = array
        print(f"  {name}", flush=True)
    np.savez(path, **kept)


def run_at(folder: Path, target: Path) -> dict[str, np.ndarray]:
    """Return the arrays that the code in a folder gives."""
    with tempfile.TemporaryDirectory() as above:
        (Path(above) / "shock_filter").symlink_to(folder, target_is_directory=True)
        paths = os.pathsep.join([above, str(ROOT / "tests" / "core"), str(ROOT / "tools")])
        code = f"import compare_bits; compare_bits.results({str(target)!r})"
        environment = os.environ | {"PYTHONPATH": paths}
        subprocess.run([sys.executable, "-c", code], check=True, env=environment)
    with np.load(target) as kept:
        return dict(kept)


def difference(old: np.ndarray | None, new: np.ndarray | None) -> str:
    """Say how two arrays differ; nothing if they are the same bit for bit."""
    if old is None or new is None:
        return "one commit does not give it"
    if (old.shape, old.dtype) != (new.shape, new.dtype):
        return f"{old.shape} {old.dtype} has become {new.shape} {new.dtype}"
    if old.tobytes() == new.tobytes():
        return ""
    spread = float(np.nanmax(old)) - float(np.nanmin(old))
    farthest = float(np.nanmax(np.abs(old.astype(np.float64) - new.astype(np.float64))))
    return f"differs by up to {farthest:.3g} in a range of {spread:.3g}"


def main() -> None:
    """Compare, and say what differs."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("commit", help="whose results are the reference")
    parser.add_argument("--known", nargs="*", default=[], help="calls that are meant to differ")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder) / "tree"
        git = ["git", "-C", str(ROOT), "worktree"]
        subprocess.run([*git, "add", "--quiet", "--detach", str(tree), options.commit], check=True)
        try:
            print(f"at {options.commit}:")
            old = run_at(tree, Path(folder) / "old.npz")
        finally:
            subprocess.run([*git, "remove", "--force", str(tree)], check=True)
        print("here:")
        new = run_at(ROOT, Path(folder) / "new.npz")
    names = dict.fromkeys(key.rsplit("/", 1)[0] for key in [*old, *new])
    differing = 0
    for name in names:
        keys = {key for key in [*old, *new] if key.rsplit("/", 1)[0] == name}
        found = [words for key in sorted(keys) if (words := difference(old.get(key), new.get(key)))]
        if found:
            meant = name in options.known
            differing += not meant
            print(f"{name}: {found[0]}{' (known)' if meant else ''}")
    print(f"{len(names) - differing} of {len(names)} calls give the same bits, or are known.")
    sys.exit(1 if differing else 0)


if __name__ == "__main__":
    main()
