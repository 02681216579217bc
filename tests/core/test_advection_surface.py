# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests of noise that moves on surfaces, across seams."""

import numpy as np
import pytest
from scipy.ndimage import binary_erosion
from shapes import grid
from shock_filter import core
from shock_filter.core.advection.surface import _SurfaceFlow, _SurfaceNoise
from shock_filter.core.atlas.sheet import NOTHING
from surface_spaces import square
from test_line_convolution import flow_angles, wrapped
from test_texture_space import LAYOUTS

STILL = core.NoiseSettings(step=0.0, blending=1.0, injection=0.0, divergence=0.0)


class Moving:
    """Noise on a surface, whose bits are to be seen."""

    def __init__(self, mesh, uv, size, vector, settings=STILL):
        self.atlas = core.TextureAtlas(mesh, uv, size=(size, size))
        field = np.tile(np.asarray(vector, dtype=float), (mesh.face_count, 3, 1))
        field *= self.atlas.texel_size / mesh.mean_edge_length  # texels to edges
        self.flow = _SurfaceFlow(self.atlas, field, settings.step)
        self.noise = _SurfaceNoise(self.flow, settings)
        self.frame = 0
        nodes = self.atlas.sheet.nodes
        self.inside = nodes >= 0
        y, x = np.nonzero(self.inside)
        faces = nodes[y, x]
        a, b, c = np.moveaxis(self.atlas.sheet.points[faces], 1, 0)
        matrices = np.stack([b - a, c - a], axis=2)
        second, third = np.linalg.solve(matrices, (np.stack([y, x], axis=1) - a)[..., None])[
            ..., 0
        ].T
        shares = np.stack([1 - second - third, second, third], axis=1)
        self.places = np.einsum("fk,fkx->fx", shares, mesh.vertices[mesh.faces[faces]])

    @property
    def bits(self):
        return self.noise.cells[self.inside]

    def draw(self, bits):
        self.noise.cells[self.inside] = bits
        self.noise.make_ready(-1)

    def step(self, count=1):
        for _ in range(count):
            self.noise.step(self.flow.motion, self.frame)
            self.frame += 1


def on_surface(moving, nodes):
    """Where nodes of the sheet lie in the plane, and how steps down and across lead from there."""
    atlas = moving.atlas
    y, x = np.divmod(nodes, atlas.sheet.nodes.shape[1])
    faces = atlas.sheet.nodes[y, x]
    a, b, c = np.moveaxis(atlas.sheet.points[faces], 1, 0)
    corners = atlas.mesh.vertices[atlas.mesh.faces[faces]][..., :2]
    sides = np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], axis=2)
    steps = sides @ np.linalg.inv(np.stack([b - a, c - a], axis=2))
    return corners[:, 0] + np.einsum("nij,nj->ni", steps, np.stack([y, x], axis=1) - a), steps


@pytest.mark.parametrize("angle", [None, 0.4])
def test_cells_beyond_seams_are_those_that_whole_steps_lead_to(angle):
    # Of each node whose step leaves its chart, four: one whole step shorter or longer each way.
    mesh, uv, size = square(64, True, angle)
    moving = Moving(mesh, uv, size, (2.6, -1.3, 0))
    flow, beyond = moving.flow, moving.flow.beyond
    place, steps = on_surface(moving, beyond.nodes)
    velocity = np.array([2.6, -1.3]) * moving.atlas.texel_size
    step = np.linalg.solve(steps, np.tile(velocity, (len(steps), 1))[..., None])[..., 0]
    for k in range(4):
        whole = np.floor(step) + 1 - [k >> 1, k & 1]
        wanted = place - np.einsum("nij,nj->ni", steps, whole)
        known = (beyond.sources[:, k] != NOTHING) & ((wanted > 2) & (wanted < 62)).all(axis=1)
        found, _ = on_surface(moving, beyond.sources[known, k])
        off = np.abs(found - wanted[known]).max(axis=1) / moving.atlas.texel_size
        assert known.mean() > 0.6
        assert np.quantile(off, 0.98) < (0.01 if angle is None else 0.75)  # the nearest texel
    assert flow.reach < 4


def test_steps_over_seams_are_as_long_as_those_inside_charts_at_most():
    # One chart, 16 texels wide, in which all steps begin in another one.
    mesh, uv, size = square(64, True, 0.4)
    atlas = core.TextureAtlas(mesh, uv, size=(size, size))
    places = mesh.vertices[mesh.faces].mean(axis=1)[:, :2]
    fast = ((places > 16) & (places < 32)).all(axis=1)
    field = np.where(fast[:, None, None], [[[24.0, 0.0, 0.0]]], [[[0.4, 0.0, 0.0]]])
    flow = _SurfaceFlow(atlas, field * atlas.texel_size / mesh.mean_edge_length, 0.0)
    steps = np.hypot(flow.motion.right, flow.motion.down).reshape(-1)
    inside = (atlas.sheet.nodes >= 0).reshape(-1)
    inside[flow.beyond.nodes] = False
    assert flow.reach == pytest.approx(steps[inside].max(), rel=1e-6)
    assert flow.reach < 1
    assert steps[flow.beyond.nodes].max() <= flow.reach * (1 + 1e-6)


@pytest.mark.parametrize("vector", [(2, 0), (-4, 2)])
def test_whole_steps_shift_the_noise_over_turned_and_mirrored_charts(vector):
    mesh, uv, size = square(64, True, None)
    moving = Moving(mesh, uv, size, (*vector, 0))
    columns, rows = np.floor(moving.places[:, :2]).astype(int).T
    before, after = np.zeros((64, 64), int), np.zeros((64, 64), int)
    before[rows, columns] = moving.bits
    moving.step()
    after[rows, columns] = moving.bits
    x, y = vector
    came = np.zeros((64, 64), dtype=bool)
    came[max(y, 0) : 64 + min(y, 0), max(x, 0) : 64 + min(x, 0)] = True
    assert (after[came] == np.roll(before, (y, x), axis=(0, 1))[came]).all()
    fresh = after[~came]
    assert 0.35 < fresh.mean() < 0.65


@pytest.mark.parametrize("layout", ["turned charts", "right angles and mirrored", "all mirrored",
                                    "another density"])  # fmt: skip
def test_slow_flow_moves_at_its_speed_over_seams(layout):
    _, angle, change = LAYOUTS[layout]
    mesh, uv, size = square(64, True, angle, change)
    speed = 0.35
    moving = Moving(mesh, uv, size, (speed, 0.0, 0.0))
    length = moving.atlas.texel_size
    x = moving.places[:, 0]
    moving.draw((x < 20).astype(np.uint8))
    moving.step(40)
    border = 20 + 40 * speed * length
    bits = moving.bits
    known = x > 40 * speed * length + 3
    assert border < 60
    # A border that is a texel or two rough, of this chart or of coarser ones.
    coarse = layout == "another density"
    assert np.mean(bits[known] != (x < border)[known]) < (0.11 if coarse else 0.06)
    area = (bits[known] > 0).mean() - (x < border)[known].mean()
    assert abs(area) < 0.04


def test_nothing_stands_still_beside_seams_where_the_flow_is_slow():
    mesh, uv, size = square(64)
    moving = Moving(mesh, uv, size, (0.05, 0.02, 0))
    beside = ~binary_erosion(moving.inside, iterations=2) & moving.inside
    changed = np.zeros(beside.sum(), dtype=bool)
    start = moving.noise.cells[beside]
    for _ in range(120):
        moving.step()
        changed |= moving.noise.cells[beside] != start
    assert changed.mean() > 0.9


def test_noise_is_the_same_beside_seams_as_elsewhere():
    for mesh, uv, size in (square(64), two_cuts(0), two_cuts(1)):
        atlas = core.TextureAtlas(mesh, uv, size=(size, size))
        field = np.cross([0.3, 0.2, 1.0], mesh.vertices - mesh.vertices.mean(axis=0))
        beside = atlas.masks().boundary & atlas.inside
        near, far = [], []
        for frame in core.advect_on_surface(
            mesh, uv, field, size=(size, size), frames=40, atlas=atlas
        ):
            near.append(frame[beside])
            far.append(frame[atlas.inside & ~beside])
        near, far = np.concatenate(near), np.concatenate(far)
        assert near.mean() == pytest.approx(far.mean(), abs=0.04)
        assert near.std() == pytest.approx(far.std(), rel=0.1)
        assert far.mean() == pytest.approx(0.5, abs=0.03)


def two_cuts(which):
    """A torus whose texture is cut along other circles: mesh, uv, size."""
    rings, sides = 48, 24
    u, v = np.meshgrid(np.arange(rings), np.arange(sides), indexing="ij")
    around, along = 2 * np.pi * u.ravel() / rings, 2 * np.pi * v.ravel() / sides
    radius = 2 + np.cos(along)
    vertices = np.stack([radius * np.cos(around), radius * np.sin(around), np.sin(along)], axis=1)
    a, b = u.ravel(), v.ravel()
    squares = np.stack([np.stack([a, b]), np.stack([a + 1, b]), np.stack([a + 1, b + 1]),
                        np.stack([a, b + 1])])  # fmt: skip
    squares = squares.transpose(2, 0, 1)
    faces = np.concatenate([squares[:, [0, 1, 2]], squares[:, [0, 2, 3]]])
    shift = np.array([7, 5]) * which
    flat = (faces - shift) % [rings, sides]
    flat = np.where(flat.max(axis=1, keepdims=True) - flat > 2, flat + [rings, sides], flat)
    numbers = faces[..., 0] % rings * sides + faces[..., 1] % sides
    mesh = core.TriangleMesh(vertices, numbers)
    return mesh, 0.1 + 0.8 * flat / [rings, sides], 192


def test_streaks_lie_along_the_flow():
    mesh, uv, size = square(96, charts=False, angle=0.0)
    angle = np.radians(35)
    field = np.tile([np.cos(angle), np.sin(angle), 0.0], (mesh.face_count, 1))
    settings = core.NoiseSettings(blending=0.05)
    for frame in core.advect_on_surface(
        mesh, uv, field, size=(size, size), settings=settings, frames=2
    ):
        image = frame
    inside = core.TextureAtlas(mesh, uv, size=(size, size)).inside
    assert wrapped(flow_angles(image, inside) - angle).mean() < 5


def test_fields_at_faces_and_vertices_agree():
    mesh, uv, size = square(32)
    one = np.tile([1.0, 0.5, 0.0], (mesh.face_count, 1))
    other = np.tile([1.0, 0.5, 7.0], (mesh.vertex_count, 1))  # what points out does not count
    frames = [
        next(core.advect_on_surface(mesh, uv, field, size=(size, size), frames=1))
        for field in (one, other)
    ]
    assert np.abs(frames[0] - frames[1]).mean() < 1e-3


def test_background_shows_where_the_flow_is_undefined():
    mesh, uv, size = square(32, charts=False)
    field = np.tile([1.0, 0.0, 0.0], (mesh.face_count, 1))
    left = mesh.vertices[mesh.faces][..., 0].mean(axis=1) < 16
    field[left] = np.nan
    background = np.full((size, size), 0.25)
    frame = next(
        core.advect_on_surface(mesh, uv, field, size=(size, size), frames=1, background=background)
    )
    assert np.isfinite(frame).all()
    atlas = core.TextureAtlas(mesh, uv, size=(size, size))
    x = atlas.bake(mesh.vertices[mesh.faces])[..., 0]
    assert (frame[atlas.inside & (x < 15)] == 0.25).all()
    assert frame[atlas.inside & (x > 17)].std() > 0.1


def test_frames_repeat_without_a_jump_and_from_seed_to_seed():
    mesh, uv, size = square(32)
    field = np.tile([1.0, 0.5, 0.0], (mesh.face_count, 1))

    def made(**settings):
        chosen = core.NoiseSettings(**settings)
        return np.stack(
            list(
                core.advect_on_surface(
                    mesh, uv, field, size=(size, size), settings=chosen, frames=12
                )
            )
        )

    looped = made(loop=6)
    steps = np.abs(np.diff(looped, axis=0)).mean(axis=(1, 2))
    assert np.abs(looped[0] - looped[-1]).mean() < 1.3 * steps.mean()
    plain = made()
    assert np.abs(plain[0] - plain[-1]).mean() > 2 * np.abs(np.diff(plain, axis=0)).mean()
    assert (made() == plain).all()
    assert (made(seed=1) != plain).any()


def test_wrong_fields_are_refused():
    mesh, uv, size = square(32, charts=False)
    shape = mesh.face_count, 3
    for field in (np.zeros((5, 3)), np.full(shape, np.inf), np.full(shape, "a")):
        with pytest.raises(core.InvalidSignal, match="give"):
            core.advect_on_surface(mesh, uv, field, size=(size, size))
    fast = np.full(shape, 1e6)
    with pytest.raises(core.InvalidSignal, match="1000"):
        core.advect_on_surface(
            mesh, uv, fast, size=(size, size), settings=core.NoiseSettings(step=0.0)
        )
    with pytest.raises(core.InvalidSettings, match="periodic"):
        settings = core.NoiseSettings(periodic="x")
        core.advect_on_surface(mesh, uv, np.zeros(shape), size=(size, size), settings=settings)
    nothing = next(core.advect_on_surface(mesh, uv, np.zeros(shape), size=(size, size), frames=1))
    assert np.isfinite(nothing).all()
    undefined = next(
        core.advect_on_surface(mesh, uv, np.full(shape, np.nan), size=(size, size), frames=1)
    )
    assert (undefined == 0).all()


def test_steps_end_where_the_surface_does():
    vertices, faces = grid(4, 4)
    mesh = core.TriangleMesh(vertices, faces)
    uv = 0.25 + 0.5 * mesh.vertices[mesh.faces][..., :2] / 4
    moving = Moving(mesh, uv, 64, (2, 0, 0))
    beyond = moving.flow.beyond
    columns = moving.inside.shape[1]
    assert (beyond.sources[beyond.nodes % columns - columns // 4 < 2] == NOTHING).all()
