# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests of occlusion, bent normals and thickness, against what can be computed by hand."""

import numpy as np
import pytest
from shapes import cube, icosphere
from shock_filter import core
from shock_filter.core.rays.boxes import STACK, boxes_around, first_hit
from shock_filter.core.rays.directions import scrambled, sobol_points
from surface_patches import SURFACES, laid_out, patch

SIZE = 48, 48
EXACT = core.OcclusionSettings(rays=1024)
FAR = 400.0


def square(low, high, z=0.0, flipped=False):
    """A square in the plane, which fills the image."""
    vertices = [[low, low, z], [high, low, z], [high, high, z], [low, high, z]]
    faces = [[0, 1, 2], [0, 2, 3]]
    mesh = core.TriangleMesh(vertices, [face[::-1] for face in faces] if flipped else faces)
    return mesh, (mesh.vertices[mesh.faces][..., :2] - low) / (high - low)


def places(low, high):
    centres = low + (high - low) * (np.arange(SIZE[0]) + 0.5) / SIZE[0]
    return np.meshgrid(centres, centres)


def over_corner(a, b):
    """Share of the sky behind a parallel rectangle one unit above, over one of its corners."""
    c, d = np.sqrt(1 + a * a), np.sqrt(1 + b * b)
    return (a / c * np.arctan(b / c) + b / d * np.arctan(a / d)) / (2 * np.pi)


@pytest.mark.parametrize("angle", [45, 90, 120])
def test_a_groove_of_any_angle(angle):
    mesh, uv = square(0, 2)
    c, s = FAR * np.cos(np.radians(angle)), FAR * np.sin(np.radians(angle))
    wall = [[0, -FAR, 0], [0, FAR, 0], [c, FAR, s], [c, -FAR, s]]
    wall = core.TriangleMesh(wall, [[0, 1, 2], [0, 2, 3]])
    image = core.ambient_occlusion(mesh, uv, EXACT, size=SIZE, occluders=[wall])
    wanted = 0.5 * (1 - np.cos(np.radians(angle)))
    assert np.abs(image - wanted).max() < 0.01


def test_parallel_plates():
    mesh, uv = square(-1, 1)
    image = core.ambient_occlusion(mesh, uv, EXACT, size=SIZE, occluders=[square(-1, 1, 1.0)[0]])
    x, y = places(-1, 1)
    hidden = sum(over_corner(1 + i * x, 1 + j * y) for i in (-1, 1) for j in (-1, 1))
    assert np.abs(image - (1 - hidden)).max() < 0.01


def test_a_box_on_a_plane():
    mesh, uv = square(0, 2)
    vertices, faces = cube(1)
    vertices = vertices / np.abs(vertices).max() * [0.5, 3.0, 0.75] + [-0.5, 1.0, 0.75]
    box = core.TriangleMesh(vertices, faces)
    image = core.ambient_occlusion(mesh, uv, EXACT, size=SIZE, occluders=[box])
    d, y = places(0, 2)
    far = np.hypot(d, 1.5)
    hidden = sum(np.arctan(w / d) - d / far * np.arctan(w / far) for w in (y + 2, 4 - y)) / (
        2 * np.pi
    )
    assert np.abs(image - (1 - hidden)).max() < 0.01


def test_the_inside_of_a_hemisphere_sees_half_of_the_sky():
    vertices, faces = icosphere(5)
    faces = faces[(vertices[faces][..., 2] < 1e-9).all(axis=1)]
    bowl = core.TriangleMesh(vertices, faces[:, ::-1])
    assert (bowl.normals[:, 2] > -0.05).all()
    uv = 0.5 + 0.45 * bowl.vertices[bowl.faces][..., :2]
    atlas = core.TextureAtlas(bowl, uv, size=SIZE)
    image = core.ambient_occlusion(bowl, uv, EXACT, size=SIZE, atlas=atlas)
    place = atlas.bake(bowl.vertices[bowl.faces])
    deep = atlas.inside & (place[..., 2] < -0.3)
    assert np.abs(image[deep] - 0.5).max() < 0.01
    assert np.abs(image[atlas.inside].mean() - 0.5) < 0.005


def test_smoothed_rays_are_near_many_rays():
    mesh, square = patch(SURFACES["torus"], "regular", 24)
    uv, size = laid_out(mesh, square, "quarters", 96)
    wall = core.TriangleMesh([[1.5, -2, -1], [1.5, 2, -1], [1.5, 0, 2]], [[0, 1, 2]])
    atlas = core.TextureAtlas(mesh, uv, size=(size, size))

    def drawn(**given):
        settings = core.OcclusionSettings(**given)
        return core.ambient_occlusion(
            mesh, uv, settings, size=(size, size), occluders=[wall], atlas=atlas
        )

    wanted = drawn(rays=4096, smoothing=0)
    error = {n: (drawn(rays=64, smoothing=n) - wanted)[atlas.inside] for n in (0, 4)}
    raw, smooth = (np.sqrt((each**2).mean()) for each in error.values())
    assert smooth < 0.02
    assert smooth < 0.7 * raw


def test_ground_and_distance():
    mesh, uv = square(0, 2)
    wall = core.TriangleMesh([[0, -FAR, 0], [0, FAR, 0], [0, 0, FAR]], [[0, 1, 2]])
    near = core.OcclusionSettings(rays=64, distance=0.5, smoothing=0)
    image = core.ambient_occlusion(mesh, uv, near, size=SIZE, occluders=[wall])
    assert (image[:, 13:] == 1).all() and image[:, 0].max() < 0.6
    upright = core.TriangleMesh(
        [[0, 0, 0], [0, 9, 0], [0, 9, 9], [0, 0, 9]], [[0, 1, 2], [0, 2, 3]]
    )
    uv = upright.vertices[upright.faces][..., 1:] / 9
    ground = core.OcclusionSettings(rays=1024, ground="below", smoothing=0)
    assert np.abs(core.ambient_occlusion(upright, uv, ground, size=SIZE)[1:] - 0.5).max() < 0.01
    assert (core.ambient_occlusion(upright, uv, EXACT, size=SIZE) == 1).all()


def test_bent_normals_lean_away_and_open_places_keep_theirs():
    mesh, uv = square(0, 2)
    wall = core.TriangleMesh([[0, -FAR, 0], [0, FAR, 0], [0, 0, FAR]], [[0, 1, 2]])
    vectors = core.bent_normals(mesh, uv, EXACT, size=SIZE, occluders=[wall])
    # Of a quarter of the sphere, cosine-weighted: x has the mean 2 / 3 / pi times 2, z 2 / 3.
    wanted = np.array([4 / 3 / np.pi, 0, 2 / 3]) / np.hypot(4 / 3 / np.pi, 2 / 3)
    assert np.abs(vectors[:, :12] - wanted).max() < 0.03
    alone = core.bent_normals(mesh, uv, EXACT, size=SIZE)
    assert np.abs(alone - [0, 0, 1]).max() < 0.01


def test_thickness_of_plates_and_of_a_ball():
    top, uv = square(0, 40, 0.0)
    under = square(0, 40, -0.5, flipped=True)[0]
    both = core.TriangleMesh(
        np.concatenate([top.vertices, under.vertices]), np.concatenate([top.faces, under.faces + 4])
    )
    uv = np.concatenate([0.5 * uv, 0.5 * uv[:, ::-1] + [0.5, 0]])
    image = core.thickness(both, uv, core.ThicknessSettings(smoothing=0), size=SIZE)
    assert np.abs(image[3:20, 3:20] - 0.5).max() < 1e-3
    # Chords of a unit sphere are 2 cos(angle) long, 2 cos(angle)^2 deep: at a mean of 1.25.
    ball = core.TriangleMesh(*icosphere(4))
    faces = ball.vertices[ball.faces]
    uv = (
        np.where(faces[:, :, 2:].mean(axis=1, keepdims=True) > 0, 0.25, 0.75) + 0.2 * faces[..., :2]
    )
    settings = core.ThicknessSettings(rays=256)
    atlas = core.TextureAtlas(ball, uv, size=(96, 96))
    image = core.thickness(ball, uv, settings, size=(96, 96), atlas=atlas)
    assert abs(image[atlas.inside].mean() - 1.25) < 0.02
    gray = core.thickness(ball, uv, core.ThicknessSettings(look="gray", white=2.5), size=(96, 96))
    assert abs(gray[atlas.inside].mean() - 0.5) < 0.02


def test_rays_meet_what_all_triangles_say():
    random = np.random.default_rng(0)
    corners = random.normal(size=(300, 1, 3)) + 0.4 * random.normal(size=(300, 3, 3))
    tree, stack = boxes_around(corners), np.zeros(STACK, dtype=np.int32)
    origins = random.normal(size=(400, 3)).astype(np.float32)
    along = random.normal(size=(400, 3)).astype(np.float32)
    a, u, v = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    limit = np.float32(50.0)
    met = 0
    for origin, d in zip(origins, along, strict=True):
        matrix = np.stack([u, v, np.broadcast_to(-d.astype(float), u.shape)], axis=2)
        b, c, t = np.linalg.solve(matrix, (origin - a)[..., None])[..., 0].T
        hits = t[(b >= 0) & (c >= 0) & (b + c <= 1) & (t > 0)]
        wanted = hits.min(initial=limit)
        found, row = first_hit(tree, *origin, *d, limit, False, stack)
        assert found == pytest.approx(wanted, rel=1e-3)
        if wanted < limit:
            assert t[tree.order[row]] == pytest.approx(wanted)
        assert (first_hit(tree, *origin, *d, limit, True, stack)[0] < limit) == (wanted < limit)
        met += wanted < limit
    assert 100 < met < 400


def test_points_are_spread_evenly():
    seed, points = np.uint64(123456789), sobol_points(256)
    points = np.array([[scrambled(x, seed), scrambled(y, seed + np.uint64(77))] for x, y in points])
    for rows, columns in ((16, 16), (256, 1), (1, 256), (4, 64)):
        cells = np.floor(points * [rows, columns]).astype(int) @ [columns, 1]
        assert (np.bincount(cells, minlength=256) == 1).all()


def test_wrong_input_and_cancelling():
    mesh, uv = square(0, 2)
    with pytest.raises(core.InvalidSignal, match="list of meshes"):
        core.ambient_occlusion(mesh, uv, size=SIZE, occluders=mesh)
    with pytest.raises(core.InvalidMesh):
        core.ambient_occlusion(mesh, uv, size=SIZE, occluders=[3])
    for function in (core.ambient_occlusion, core.bent_normals, core.thickness):
        with pytest.raises(core.Cancelled):
            function(mesh, uv, size=SIZE, progress=lambda *_: False)
