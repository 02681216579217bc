# SPDX-License-Identifier: GPL-3.0-or-later
"""Does it matter where a texture is cut? The same surfaces in two layouts each."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import common
import numpy as np
import peers
import trimesh
from report import table
from shock_filter import core
from texture_models import pattern, sample

TIMES = [4.0, 64.0, 1024.0]
SCAN = "nicolo.obj"
SCAN_FACES = 2000
POINTS = 200_000
NEAR = 2.0  # texels

_TURN = 2.399963  # the golden angle: no two charts lie alike
_MARGIN = 3.0  # texels


@dataclass(frozen=True)
class Layout:
    """A surface cut in one way: its atlas, and the texture coordinates of its corners."""

    atlas: core.TextureAtlas
    uv: np.ndarray

    def texture(self, signal: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
        """Evaluate a signal at the texels' places on the surface, and fill the gutter."""
        mesh = self.atlas.mesh
        colors = signal(self.atlas.bake(mesh.vertices[mesh.faces])).astype(np.float32)
        return core.dilate_texture(mesh, self.uv, colors, atlas=self.atlas)

    def sharpened(self, texture: np.ndarray, time: float) -> np.ndarray:
        """Sharpen a texture in this layout."""
        settings = core.TextureSettings(time=time)
        return core.sharpen_texture(self.atlas.mesh, self.uv, texture, settings, atlas=self.atlas)

    def read(self, texture: np.ndarray, faces: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """Read a texture linearly at barycentric points of faces."""
        return sample(texture, np.einsum("kc,kcx->kx", weights, self.atlas.charts.points[faces]))

    def resampled(self, texture: np.ndarray, other: Layout) -> np.ndarray:
        """Draw a texture of this layout into another one."""
        places = other.atlas.bake(self.atlas.charts.points)
        colors = sample(texture, places).astype(np.float32)
        return core.dilate_texture(other.atlas.mesh, other.uv, colors, atlas=other.atlas)


def cut(mesh: core.TriangleMesh, parts: np.ndarray, turning: bool) -> Layout:
    """Unfold each part of a mesh by itself, at one texel per unit of length.

    The parts must unfold without distortion: flat, a tube, or no more than two faces.
    """
    flat = _unfold(mesh, parts)
    for part in range(parts.max() + 1):
        chosen = parts == part
        angle = _TURN * (part + 1) if turning else 0.0
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        flat[chosen] = flat[chosen] @ turn.T
    size = _pack(flat, parts)
    uv = flat / size
    return Layout(core.TextureAtlas(mesh, uv, size=(size, size)), uv)


def _unfold(mesh: core.TriangleMesh, parts: np.ndarray) -> np.ndarray:
    corners = mesh.vertices[mesh.faces]
    along = corners[:, 1] - corners[:, 0]
    length = np.linalg.norm(along, axis=1)
    side = corners[:, 2] - corners[:, 0]
    x = np.einsum("fx,fx->f", side, along) / length
    own = np.zeros((len(corners), 3, 2))
    own[:, 1, 0] = length
    own[:, 2] = np.stack([x, np.linalg.norm(np.cross(along, side), axis=1) / length], axis=-1)
    flat = np.full_like(own, np.nan)
    for seed in range(len(own)):
        if not np.isnan(flat[seed, 0, 0]):
            continue
        flat[seed] = own[seed]
        waiting = [seed]
        for f in waiting:
            for k in range(3):
                g, j = divmod(int(mesh.twins[f, k]), 3)
                if mesh.twins[f, k] < 0 or parts[g] != parts[seed] or not np.isnan(flat[g, 0, 0]):
                    continue
                # The twin runs the other way: bring its first corner to this edge's second.
                start, end = flat[f, (k + 1) % 3], flat[f, k]
                edge = own[g, (j + 1) % 3] - own[g, j]
                turn = complex(*(end - start)) / complex(*edge)
                turned = np.array([[turn.real, -turn.imag], [turn.imag, turn.real]])
                flat[g] = start + (own[g] - own[g, j]) @ turned.T
                waiting.append(g)
    return flat


def _pack(flat: np.ndarray, parts: np.ndarray) -> int:
    # Moves each part to a place of its own, in rows, tall ones first; returns the image's size.
    count = parts.max() + 1
    low, high = np.full((count, 2), np.inf), np.full((count, 2), -np.inf)
    np.minimum.at(low, parts, flat.min(axis=1))
    np.maximum.at(high, parts, flat.max(axis=1))
    sizes = high - low + 2 * _MARGIN
    width = max(1.1 * np.sqrt(sizes.prod(axis=1).sum()), sizes[:, 0].max())
    places = np.empty_like(sizes)
    x, y, tallest = 0.0, 0.0, 0.0
    for part in np.argsort(-sizes[:, 1]):
        if x + sizes[part, 0] > width:
            x, y, tallest = 0.0, y + tallest, 0.0
        places[part] = x, y
        x += sizes[part, 0]
        tallest = max(tallest, sizes[part, 1])
    flat += (places - low + _MARGIN)[parts][:, None]
    return int(np.ceil(max(width, y + tallest)))


def plane(cells: int = 16, texels: int = 256) -> tuple[core.TriangleMesh, np.ndarray, np.ndarray]:
    """A square, in one chart and in 4 x 4."""
    ticks = np.arange(cells + 1) * texels / cells
    x, y = np.meshgrid(ticks, ticks)
    vertices = np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3)
    mesh = core.TriangleMesh(vertices, _quads(cells, cells, cells + 1))
    middle = vertices[mesh.faces].mean(axis=1)[:, :2] // (texels / 4)
    parts = (middle[:, 0] + 4 * middle[:, 1]).astype(int)
    return mesh, np.zeros_like(parts), parts


def cylinder(
    around: int = 48, along: int = 18, texels: int = 384
) -> tuple[core.TriangleMesh, np.ndarray, np.ndarray]:
    """A tube, unrolled and in six pieces."""
    angle = 2 * np.pi * np.arange(around) / around
    radius = texels / around / (2 * np.sin(np.pi / around))
    height = np.arange(along + 1) * texels / around
    vertices = np.array(
        [(radius * np.cos(a), radius * np.sin(a), z) for z in height for a in angle]
    )
    faces = _quads(around, along, around)
    mesh = core.TriangleMesh(vertices, faces)
    middle = vertices[faces].mean(axis=1)
    turn = np.arctan2(middle[:, 1], middle[:, 0]) % (2 * np.pi) // (2 * np.pi / 3)
    parts = (turn + 3 * (middle[:, 2] > height[-1] / 2)).astype(int)
    return mesh, np.zeros_like(parts), parts


def _quads(across: int, up: int, columns: int) -> np.ndarray:
    # Two triangles for each square; columns wrap around if there are no more than squares.
    i, j = (n.ravel() for n in np.meshgrid(np.arange(across), np.arange(up)))
    a, b = columns * j + i, columns * j + (i + 1) % columns
    return np.concatenate(
        [np.stack([a, b, b + columns], axis=-1), np.stack([a, b + columns, a + columns], axis=-1)]
    )


def scan(job: common.Job) -> tuple[core.TriangleMesh, np.ndarray, np.ndarray]:
    """A coarse scan of a face, or a ball: each triangle apart, and in pairs."""
    if job.data and peers.installed("MeshLab"):
        vertices, faces = peers.decimated(*common.load_mesh(job.data, SCAN), SCAN_FACES)
    else:
        ball = trimesh.creation.icosphere(subdivisions=3)
        vertices, faces = np.asarray(ball.vertices), np.asarray(ball.faces)
    mesh = core.TriangleMesh(vertices, faces)
    vertices = vertices * (18.0 / mesh.mean_edge_length)  # an edge is 18 texels long
    mesh = core.TriangleMesh(vertices, mesh.faces)
    pairs = np.full(mesh.face_count, -1)
    count = 0
    for f in range(mesh.face_count):
        if pairs[f] < 0:
            others = [t // 3 for t in mesh.twins[f] if t >= 0 and pairs[t // 3] < 0]
            pairs[[f, *others[:1]]] = count
            count += 1
    return mesh, np.arange(mesh.face_count), pairs


def surfaces(
    job: common.Job,
) -> Iterator[tuple[str, core.TriangleMesh, np.ndarray, np.ndarray, Callable]]:
    """Surfaces with two ways to cut each, and the signal on it."""
    if job.data:
        photo = common.load_image(job.data, "kodim05.png")[:256, :256] / 255.0
        yield (
            "plane, photo", *plane(), lambda places: sample(photo, places[..., 1::-1] - 0.5),
        )  # fmt: skip
    yield "plane, pattern", *plane(), pattern
    yield "cylinder, pattern", *cylinder(), pattern
    yield ("scan, pattern" if job.data else "ball, pattern"), *scan(job), pattern


def distance_to_seams(
    layouts: tuple[Layout, Layout], faces: np.ndarray, weights: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Distance in texels to the seams, and to the border, at the edges of each point's face."""
    mesh = layouts[0].atlas.mesh
    corners = mesh.vertices[mesh.faces]
    twice = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    seams = np.full(len(faces), np.inf)
    border = np.full(len(faces), np.inf)
    cuts = np.zeros((2, 3 * mesh.face_count), dtype=bool)
    for layout, marked in zip(layouts, cuts, strict=True):
        marked[layout.atlas.charts.borders] = True
    ends = mesh.twins.ravel() < 0
    for k in range(3):
        length = np.linalg.norm(corners[:, (k + 1) % 3] - corners[:, k], axis=1)
        away = weights[:, (k + 2) % 3] * (twice / length)[faces]
        edge = 3 * faces + k
        seam = cuts.any(axis=0)[edge] & ~ends[edge]
        seams[seam] = np.minimum(seams, away)[seam]
        border[ends[edge]] = np.minimum(border, away)[ends[edge]]
    return seams, border


def invariance(job: common.Job) -> None:
    """Sharpened results of two layouts, read at the same points of the surface."""
    rows = []
    for label, mesh, *ways, signal in surfaces(job):
        layouts = cut(mesh, ways[0], ways[0].any()), cut(mesh, ways[1], True)
        one, other = layouts
        random = np.random.default_rng(1)
        faces = random.choice(mesh.face_count, POINTS, p=mesh.areas / mesh.areas.sum())
        weights = random.dirichlet(np.ones(3), POINTS)
        seams, border = distance_to_seams(layouts, faces, weights)
        inner = border > NEAR
        faces, weights, near = faces[inner], weights[inner], seams[inner] < NEAR
        at = faces, weights

        def rms(difference: np.ndarray) -> float:
            return 255.0 * float(np.sqrt(np.mean(np.square(difference))))

        textures = [layout.texture(signal) for layout in layouts]
        reads = [
            layout.read(texture, *at) for layout, texture in zip(layouts, textures, strict=True)
        ]
        before = rms(reads[0] - reads[1])
        for time in TIMES:
            sharp = [
                layout.sharpened(texture, time)
                for layout, texture in zip(layouts, textures, strict=True)
            ]
            first, second = (
                layout.read(texture, *at) for layout, texture in zip(layouts, sharp, strict=True)
            )
            cost = rms(other.read(one.resampled(sharp[0], other), *at) - first)
            error = first - second
            rows.append(
                [
                    label,
                    f"{one.atlas.report.charts} / {other.atlas.report.charts}",
                    f"{time:g}",
                    f"{rms(first - reads[0]):.2f}",
                    f"{before:.2f}",
                    f"{cost:.2f}",
                    f"{rms(error):.2f}",
                    f"{rms(error[near]):.2f}",
                    f"{rms(error[~near]):.2f}",
                    f"{rms(error) / max(before, cost):.2f}",
                ]
            )
    head = ["surface", "charts", "t", "moved", "input", "result, resampled", "difference"]
    head += ["near seams", "elsewhere", "times resampling"]
    job.page.write(
        "invariance",
        f"Root mean square in 1/255 over {POINTS:,} points of each surface, those nearer than"
        f" {NEAR:g} texels to its border left out; *near seams*: less than {NEAR:g} texels from a"
        " seam of either layout.\n\n" + table(head, rows, words=2),
    )
