# SPDX-License-Identifier: GPL-3.0-or-later
"""Measure distance, streaks and patterns in textures.

``python benchmarks/fields.py --data FOLDER`` measures all and prints tables. Without data, a
generated ball replaces the models.
"""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import common
import numpy as np
import peers
from PIL import Image
from report import Target, table, targets
from scipy.ndimage import binary_erosion, gaussian_filter, map_coordinates
from scipy.spatial import cKDTree
from scipy.special import j0
from shock_filter import core
from shock_filter.core.mesh.calculus import average_to_faces, average_to_vertices
from texture_models import BALL, Model, ball, load_model, names, read_model, save_model

SIZES = (96, 192, 384, 512, 768)
LARGE = 1024
STEPS = 64
SPACING = 0.15
"""Scale of the patterns that two cuts are compared by."""

PRESETS = {
    "labyrinth": (0.037, 0.06),
    "stripes": (0.029, 0.057),
    "dots": (0.03, 0.062),
    "coral": (0.0545, 0.062),
}
"""Feed and kill."""

POINTS = 8000
SOURCE = np.array([0.3, 0.5, 0.8])
"""The source is the vertex that is farthest in this direction."""


def chosen(job: common.Job) -> list[str]:
    """Return the models: two, or with ``--all`` all of them."""
    return names(job.data) if job.everything or not job.data else ["spot", "blub"]


def stored(job: common.Job, name: str, size: int) -> Path:
    """Make a model in its own process; return its file."""
    path = job.scratch / f"{name}-{size}.npz"
    if not path.exists():
        common.in_own_process(save_model, path, job.data, name, size)
    return path


def torus(size: int, steps: int = 96, thickness: float = 0.4) -> Model:
    """Make a torus, cut along two circles."""
    around, along = np.meshgrid(np.arange(steps + 1), np.arange(steps // 2 + 1), indexing="ij")
    flat = np.stack([around / steps, along / (steps // 2)], axis=-1).reshape(-1, 2)
    angles = 2 * np.pi * flat.T
    radius = 1.0 + thickness * np.cos(angles[1])
    points = np.stack(
        [radius * np.cos(angles[0]), radius * np.sin(angles[0]), thickness * np.sin(angles[1])], 1
    )
    rows = steps // 2 + 1
    first = (np.arange(rows - 1) + rows * np.arange(steps)[:, None]).reshape(-1, 1)
    quads = np.array([[0, rows, rows + 1], [0, rows + 1, 1]])
    faces = (first[:, None] + quads).reshape(-1, 3)
    kept, index = core.weld(np.round(points, 9))
    uv = 0.05 + 0.9 * flat[faces]
    return Model(points[kept], index[faces], uv, np.zeros((size, size, 3), dtype=np.uint8))


def source_of(vertices: np.ndarray) -> int:
    """Return the vertex from which distance is measured."""
    return int(np.argmax(vertices @ SOURCE))


def on_ball(job: common.Job) -> None:
    """The ball in six turned charts, against arcs of great circles."""
    rows, goals = [], []
    last = np.nan
    for size in SIZES:
        model = ball(size, steps=size // 2)
        mesh = model.mesh()
        atlas = core.TextureAtlas(mesh, model.uv, size=(size, size))
        source = source_of(mesh.vertices)
        start = time.process_time()
        found = core.geodesic_distance(
            mesh, model.uv, size=(size, size), vertices=[source], atlas=atlas
        )
        seconds = time.process_time() - start
        inside = atlas.inside
        places = atlas.bake(mesh.vertices[mesh.faces])[inside]
        places /= np.linalg.norm(places, axis=1, keepdims=True)
        exact = np.arccos(np.clip(places @ mesh.vertices[source], -1, 1))
        error = np.abs(found[inside] - exact)
        mean = error.mean() / exact.mean()
        bands = [(exact > 0.05) & (exact < 0.3), (exact > 1) & (exact < 2), exact > 2.8]
        parts = [error[band].mean() / exact[band].mean() for band in bands]
        order = np.log(last / mean) / np.log(size / SIZES[max(SIZES.index(size) - 1, 0)])
        rows.append(
            [f"{size}²", f"{100 * mean:.3f}", *(f"{100 * part:.3f}" for part in parts)]
            + [f"{error.max() / atlas.texel_size:.2f}", "" if np.isnan(last) else f"{order:.2f}"]
            + [f"{seconds:.2f}"]
        )
        last = mean
        if size == 512:
            goals.append(Target("512²: mean error, %", 100 * mean, 0.5, "{:.3f}"))
            goals.append(Target("512²: error near the source, %", 100 * parts[0], 0.5, "{:.3f}"))
    head = ["image", "mean error, %", "near, %", "halfway, %", "far, %", "largest, texels"]
    head += ["order", "processor time, s"]
    job.page.write("ball", "\n\n".join([table(head, rows), targets(goals)]))


def against_peers(job: common.Job) -> None:
    """Errors against the exact distance at the vertices, compared with the heat method."""
    if not peers.installed("pygeodesic"):
        return
    rows, goals = [], []
    heat = peers.installed("potpourri3d")
    for name in ["torus", *chosen(job)]:
        model = torus(512) if name == "torus" else load_model(job.data, name, 512)
        mesh = model.mesh()
        used = np.unique(mesh.faces)
        ranks = np.searchsorted(used, mesh.faces)
        source = source_of(mesh.vertices)
        given = mesh.vertices[used], ranks, int(np.searchsorted(used, source))
        exact, long = peers.exact_distance(*given)
        start = time.process_time()
        found = core.vertex_distance(mesh, vertices=[source])[used]
        ours = time.process_time() - start
        error = np.abs(found - exact).mean() / exact.mean()
        far = int(np.argmax(exact))
        back = core.vertex_distance(mesh, vertices=[int(used[far])])[source]
        both = abs(back - found[far]) / exact[far]
        rows.append([name, f"{100 * error:.3f}", f"{100 * both:.3f}", f"{ours:.2f}", f"{long:.1f}"])
        goals.append(Target(f"{name}: there and back, %", 100 * both, 0.5, "{:.3f}"))
        goals.append(Target(f"{name}: mean error, %", 100 * error, 0.5, "{:.3f}"))
        if heat:
            theirs, seconds = peers.heat_distance(*given)
            off = np.abs(theirs - exact).mean() / exact.mean()
            rows[-1] += [f"{100 * off:.2f}", f"{seconds:.2f}"]
    head = ["model", "mean error, %", "there and back, %", "processor time, s"]
    head += ["exact, s"] + ["heat method: mean error, %", "its time, s"] * heat
    job.page.write("peers", "\n\n".join([table(head, rows), targets(goals)]))


def timed_run(path: Path) -> dict[str, float]:
    """Measure distance and draw streaks on a stored model: seconds of wall clock and processor."""
    tiny = ball(32, steps=2)
    run_distance(tiny)
    run_streaks(tiny)
    model = read_model(path)
    found: dict[str, float] = {}
    for what, run in (("distance", run_distance), ("streaks", run_streaks)):
        for _ in range(3):
            wall, processor = time.perf_counter(), time.process_time()
            run(model)
            for key, seconds in (
                (what, time.perf_counter() - wall),
                (f"{what}, processor", time.process_time() - processor),
            ):
                found[key] = min(seconds, found.get(key, np.inf))
    return found


def run_distance(model: Model) -> Any:
    """Measure distance with all set-up."""
    mesh = model.mesh()
    size = model.image.shape[:2]
    return core.geodesic_distance(mesh, model.uv, size=size, vertices=[source_of(mesh.vertices)])


def run_streaks(model: Model) -> Any:
    """Draw streaks with all set-up."""
    return core.surface_line_convolution(model.mesh(), model.uv, size=model.image.shape[:2])


def speed(job: common.Job) -> None:
    """Seconds by model, set-up and mesh included."""
    rows, goals = [], []
    for name in chosen(job):
        found = common.in_own_process(timed_run, stored(job, name, LARGE))
        rows.append([name, f"{LARGE}²", *(f"{seconds:.2f}" for seconds in found.values())])
        for what, most in (("distance", 2.0), ("streaks", 2.5)):
            goals.append(Target(f"{name}, {LARGE}²: {what}, s", found[what], most))
    head = ["model", "image", "distance, s", "processor, s", "streaks, s", "processor, s"]
    text = "Best of three runs in a process."
    job.page.write("speed", "\n\n".join([text, table(head, rows), targets(goals)]))


def streaks(job: common.Job) -> None:
    """How well streaks follow their directions, and how strong they are."""
    rows, goals, pictures = [], [], ""
    for name in chosen(job):
        model = load_model(job.data, name, LARGE)
        mesh = model.mesh()
        size = (LARGE, LARGE)
        atlas = core.TextureAtlas(mesh, model.uv, size=size)
        distance = core.vertex_distance(mesh, vertices=[source_of(mesh.vertices)])
        fields = {
            "along an axis": core.axis_directions(mesh, [0, 1, 0]),
            "around an axis": core.axis_directions(mesh, [0, 1, 0], turned=True),
            "gradient of distance": core.gradient_directions(mesh, distance),
        }
        for what, field in fields.items():
            image = core.surface_line_convolution(
                mesh, model.uv, size=size, directions=field, atlas=atlas
            )
            angle = angle_to(atlas, image, field)
            deviation = float(image[atlas.inside].std())
            rows.append([name, what, f"{angle:.1f}", f"{deviation:.3f}"])
            goals += [
                Target(f"{name}, {what}: mean angle, degrees", angle, 6.0, "{:.1f}"),
                Target(f"{name}, {what}: deviation", deviation, 0.05, "{:.3f}", at_least=True),
            ]
        if name in ("blub", BALL):
            row = np.concatenate(
                [image, core.surface_line_convolution(mesh, model.uv, size=size)], 1
            )
            shown = Image.fromarray(np.rint(255 * row[::-1]).astype(np.uint8))
            about = "Streaks along the gradient of distance, and where the surface bends least."
            shown = shown.resize((1200, 600), Image.Resampling.LANCZOS)
            pictures = job.page.picture("streaks", shown, about)
    head = ["model", "directions", "mean angle, degrees", "deviation"]
    job.page.write("streaks", "\n\n".join([table(head, rows, 2), targets(goals)]) + pictures)


def angle_to(atlas: core.TextureAtlas, image: np.ndarray, field: np.ndarray) -> float:
    """Mean angle between the lines that a texture shows on the surface and directions at faces.

    By the structure tensor in space, averaged over the faces around each.
    """
    mesh = atlas.mesh
    face = np.where(atlas.inside, atlas.sheet.nodes.reshape(-1)[atlas.owners], -1)
    smooth = gaussian_filter(image, 1.0)
    chosen = binary_erosion(atlas.inside & (atlas.masks().count == 1), iterations=5)
    face = face[chosen]
    steps = np.stack([derivative[chosen] for derivative in np.gradient(smooth)], axis=1)
    in_frame = np.einsum("tji,tj->ti", atlas.metric.inverse_jacobians[face], steps)
    corners = mesh.vertices[mesh.faces]
    one = corners[:, 1] - corners[:, 0]
    one /= np.maximum(np.linalg.norm(one, axis=1, keepdims=True), 1e-30)
    axes = np.stack([one, np.cross(mesh.normals, one)], axis=1)
    gradients = np.einsum("ti,tix->tx", in_frame, axes[face])
    tensors = np.zeros((mesh.face_count, 9))
    weights = atlas.metric.texel_areas[face].astype(np.float64)
    for k, column in enumerate((gradients[:, :, None] * gradients[:, None]).reshape(-1, 9).T):
        tensors[:, k] = np.bincount(face, weights * column, mesh.face_count)
    tensors /= np.maximum(mesh.areas, 1e-30)[:, None]
    around = average_to_faces(mesh, average_to_vertices(mesh, tensors)).reshape(-1, 3, 3)
    within = np.einsum("fix,fxy,fjy->fij", axes, around, axes)
    across = 0.5 * np.arctan2(2 * within[:, 0, 1], within[:, 0, 0] - within[:, 1, 1])
    lines = -np.sin(across)[:, None] * axes[:, 0] + np.cos(across)[:, None] * axes[:, 1]
    seen = np.bincount(face, minlength=mesh.face_count) > 10
    seen &= np.linalg.norm(field, axis=1) > 0
    cosines = np.abs(np.einsum("fx,fx->f", lines, field))[seen]
    angles = np.degrees(np.arccos(np.minimum(cosines, 1.0)))
    return float(np.average(angles, weights=mesh.areas[seen]))


def timed_steps(path: Path) -> dict[str, float]:
    """Grow a pattern on a stored model: seconds of wall clock and processor for a step."""
    model = read_model(path)
    mesh, size = model.mesh(), model.image.shape[:2]
    atlas = core.TextureAtlas(mesh, model.uv, size=size)
    found: dict[str, float] = {}
    clocks = {"wall": time.perf_counter, "processor": time.process_time}
    for run in range(3):
        before = {}
        for steps in (1, STEPS + 1):
            start = {what: clock() for what, clock in clocks.items()}
            settings = core.ReactionSettings(steps=steps)
            core.reaction_diffusion(mesh, model.uv, size=size, settings=settings, atlas=atlas)
            long = {what: clock() - start[what] for what, clock in clocks.items()}
            for what in long if run and before else ():
                step = (long[what] - before[what]) / STEPS
                found[what] = min(step, found.get(what, np.inf))
            before = long
    return found


def patterns(job: common.Job) -> None:
    """How long a step of reaction and diffusion takes; and a pattern."""
    rows, goals, picture = [], [], ""
    for name in chosen(job):
        for size in (512, LARGE):
            found = common.in_own_process(timed_steps, stored(job, name, size))
            times = [1e3 * found[what] for what in ("wall", "processor")]
            rows.append([name, f"{size}²", *(f"{milliseconds:.1f}" for milliseconds in times)])
            if size == 512:
                goals.append(Target(f"{name}, 512²: a step, ms", times[0], 40.0, "{:.1f}"))
        if name in ("blub", BALL):
            model = read_model(stored(job, name, 512))
            grown = core.reaction_diffusion(model.mesh(), model.uv, size=(512, 512))
            shades = np.rint(255 * np.clip(grown[::-1, :, 1] / 0.4, 0, 1))
            about = "The second substance after 1000 steps."
            picture = job.page.picture("patterns", Image.fromarray(shades.astype(np.uint8)), about)
    head = ["model", "image", "a step, ms", "processor, ms"]
    text = f"Mean of {STEPS} steps from the start; best of two runs."
    job.page.write("patterns", "\n\n".join([text, table(head, rows), targets(goals)]) + picture)


def cuts(job: common.Job) -> None:
    """Patterns of one torus, cut along two circles and into sixteen turned charts."""
    whole = torus(640)
    mesh = whole.mesh()
    layouts = [("2 circles", whole.uv, 640), ("16 turned charts", in_charts(whole.uv), 896)]
    rows, goals = [], []
    for name, (feed, kill) in PRESETS.items():
        found = []
        for about, uv, size in layouts:
            atlas = core.TextureAtlas(mesh, uv, size=(size, size))
            settings = core.ReactionSettings(
                steps=1000, scale=SPACING / atlas.texel_size, feed=feed, kill=kill
            )
            image = core.reaction_diffusion(
                mesh, uv, size=(size, size), settings=settings, atlas=atlas
            )
            found.append(statistics(mesh, uv, image[..., 1]))
            mean, deviation, wave = found[-1]
            rows.append([name, about, f"{mean:.4f}", f"{deviation:.4f}", f"{wave:.4f}"])
        off = np.abs(np.divide(*found) - 1.0).max()
        goals.append(Target(f"{name}: largest difference, %", 100 * off, 7.0, "{:.1f}"))
    head = ["pattern", "cut", "mean", "deviation", "wavelength"]
    text = f"1000 steps, a scale of {SPACING} on a torus of radius 1. Dots still grow then."
    job.page.write("cuts", "\n\n".join([text, table(head, rows), targets(goals)]))


def in_charts(uv: np.ndarray) -> np.ndarray:
    """Cut the torus's coordinates into 4 x 4 blocks, each turned by an angle of its own."""
    flat = (uv - 0.05) / 0.9
    block = np.minimum(4 * flat.mean(axis=1), 3.999).astype(int)
    angle = 0.7 * (block[:, 0] + 4 * block[:, 1] + 1)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    # As wide and high as on the surface, so that texels are about square.
    local = (4 * flat - block[:, None] - 0.5) * np.array([1.0, 0.4])
    return (block[:, None] + 0.5 + 0.85 * np.einsum("xyf,fky->fkx", turn, local)) / 4


def statistics(
    mesh: core.TriangleMesh, uv: np.ndarray, image: np.ndarray
) -> tuple[float, float, float]:
    """Mean, deviation and strongest wavelength of values, at random points of the surface."""
    random = np.random.default_rng(0)
    faces = random.choice(mesh.face_count, POINTS, p=mesh.areas / mesh.areas.sum())
    shares = random.dirichlet([1, 1, 1], POINTS)
    points = np.einsum("pk,pkx->px", shares, mesh.vertices[mesh.faces[faces]])
    places = np.einsum("pk,pkx->px", shares, uv[faces])
    height, width = image.shape
    at = [places[:, 1] * height - 0.5, places[:, 0] * width - 0.5]
    values = map_coordinates(image, at, order=1, mode="grid-wrap").astype(np.float64)
    apart, reach = values - values.mean(), 4 * SPACING
    one, other = cKDTree(points).query_pairs(reach, output_type="ndarray").T
    distances = np.linalg.norm(points[one] - points[other], axis=1)
    sums, ends = np.histogram(distances, 80, (0, reach), weights=apart[one] * apart[other])
    middles = 0.5 * (ends[1:] + ends[:-1])
    waves = np.linspace(0.5, 2.0, 601) * SPACING
    tapered = sums * np.cos(0.5 * np.pi * middles / reach) ** 2
    power = j0(2 * np.pi * middles / waves[:, None]) @ tapered
    return float(values.mean()), float(values.std()), float(waves[np.argmax(power)])


SECTIONS = {
    "ball": on_ball,
    "peers": against_peers,
    "speed": speed,
    "streaks": streaks,
    "patterns": patterns,
    "cuts": cuts,
}


if __name__ == "__main__":
    parser = common.make_parser(__doc__, SECTIONS)
    common.measure(parser.parse_args(), SECTIONS, "fields")
