# SPDX-License-Identifier: GPL-3.0-or-later
"""Seams at which different materials meet, beside those that a texture crosses."""

import numpy as np
import pytest
from atlases import Blocks, sample
from scipy.ndimage import gaussian_filter
from shapes import grid
from shock_filter import core
from shock_filter.core.atlas.metric import open_places
from shock_filter.core.atlas.seams import settle_seams
from shock_filter.core.host.mosaic import Mosaic

SIZE = 160
LENGTH = 64.0  # of a square's side, in texels

RED, GRAY = np.array([0.8, 0.2, 0.1]), np.array([0.4, 0.45, 0.5])


class Squares:
    """Two squares side by side on a plane, each a chart that is turned by an odd angle.

    The seam is at x = LENGTH, from y = 0 to LENGTH; `density` is that of the right one's texels.
    """

    def __init__(self, density=1.0, cells=1, angles=(0.1, -0.2)):
        vertices, faces = grid(2 * cells, cells)
        vertices = vertices * LENGTH / cells
        self.mesh = core.TriangleMesh(vertices, faces)
        corners = vertices[faces][..., :2]
        self.right = corners.mean(axis=1)[:, 0] > LENGTH
        self.turns = [
            scale * np.array([[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]])
            for scale, a in zip((1.0, density), angles, strict=True)
        ]
        self.centres = np.array([[0.5, 0.5], [1.5, 0.5]]) * LENGTH
        self.places = np.array([[0.25, 0.3], [0.7, 0.71]]) * SIZE
        self.uv = np.where(
            self.right[:, None, None], self.to_uv(corners, 1), self.to_uv(corners, 0)
        )
        self.atlas = core.TextureAtlas(self.mesh, self.uv, size=(SIZE, SIZE))

    def to_uv(self, points, side):
        """Where points of the plane lie in the texture, as a side's chart has them."""
        return ((points - self.centres[side]) @ self.turns[side].T + self.places[side]) / SIZE

    def draw(self, left, right, background=0.0):
        """A texture: functions from points (..., 2) of the plane to colors, one for each square."""
        masks = self.atlas.masks()
        y, x = np.mgrid[:SIZE, :SIZE] + 0.5
        shown = [], []
        image = np.full((SIZE, SIZE, np.shape(left(np.zeros((1, 2))))[-1]), background)
        for side, color in enumerate((left, right)):
            there = (np.stack([x, y], axis=-1) - self.places[side]) @ np.linalg.inv(
                self.turns[side]
            ).T + self.centres[side]
            shown = (masks.face >= 0) & (self.right[masks.face] == side)
            image[shown] = color(there[shown])
        return image

    def closed(self, image, **how):
        """For places along the seam, one each texel, whether it is closed."""
        pixels = np.ascontiguousarray(image)
        atlas = settle_seams(self.atlas, self.atlas.gather(pixels), "auto", 0.0, **how)
        y = np.arange(0.5, LENGTH)
        edges, shares = self._on_seam(y)
        return ~open_places(atlas.metric.ways, edges, shares)

    def _on_seam(self, y):
        # Half-edge and share on the left square's side.
        corners = self.mesh.vertices[self.mesh.faces][..., :2]
        following = np.roll(corners, -1, axis=1)
        seam = (corners[..., 0] == LENGTH) & (following[..., 0] == LENGTH) & ~self.right[:, None]
        edges = np.flatnonzero(seam)
        a, b = corners.reshape(-1, 2)[edges, 1], following.reshape(-1, 2)[edges, 1]
        chosen = ((y[:, None] - a) * (y[:, None] - b) < 0).argmax(axis=1)
        return edges[chosen], (y - a[chosen]) / (b - a)[chosen]

    def read(self, image, inwards=0.0, level=1):
        """Read a texture along the seam, at both sides: two arrays (k, c)."""
        y = np.arange(1.5, LENGTH - 1)
        found = []
        for side in range(2):
            x = np.full_like(y, LENGTH + (inwards if side else -inwards))
            found.append(sample(smaller(image, level), self.to_uv(np.stack([x, y], -1), side)))
        return found


def smaller(image, level):
    """The next smaller sizes of an image, as mipmaps have them."""
    for _ in range(level - 1):
        a = image.astype(np.float64)
        image = (a[::2, ::2] + a[1::2, ::2] + a[::2, 1::2] + a[1::2, 1::2]) / 4
    return image


def plain(color):
    return lambda points: np.broadcast_to(color, (len(points), len(color)))


def filters(**settings):
    """The filters of textures, with settings: by time, by width, and dilation."""
    return (
        lambda s, image: core.sharpen_texture(
            s.mesh, s.uv, image, core.TextureSettings(time=256.0, **settings), atlas=s.atlas
        ),
        lambda s, image: core.sharpen_texture(
            s.mesh, s.uv, image, core.TextureSettings(width=6.0, **settings), atlas=s.atlas
        ),
        lambda s, image: core.dilate_texture(
            s.mesh, s.uv, image, core.DilateSettings(**settings), atlas=s.atlas
        ),
    )


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
@pytest.mark.parametrize("seams", ["auto", "extend"])
def test_where_materials_meet_each_side_keeps_its_color(dtype, seams):
    squares = Squares()
    white = 1 if dtype == np.float32 else np.iinfo(dtype).max
    image = (squares.draw(plain(RED), plain(GRAY)) * white).astype(dtype)
    for run, teeth in zip(filters(seams=seams), filters(seams="continue"), strict=True):
        out, before = run(squares, image), teeth(squares, image)
        for level in (1, 2):
            for inwards in (0.0, 0.25):
                for found, color in zip(
                    squares.read(out, inwards, level), (RED, GRAY), strict=True
                ):
                    assert np.abs(found / white - color).max() < 3 / 255
        assert np.abs(squares.read(before)[0] / white - RED).max() > 0.1


def test_materials_keep_their_own_shades_up_to_the_seam():
    # Each side changes along the seam, and the right one away from it.
    def left(p):
        return RED + 0.1 * np.sin(p[:, 1:] / 8)

    def right(p):
        return GRAY + 0.2 * np.cos(p[:, 1:] / 11) * (p[:, :1] - LENGTH) / LENGTH

    squares = Squares()
    image = squares.draw(left, right).astype(np.float32)
    y = np.arange(1.5, LENGTH - 1)
    at = np.stack([np.full_like(y, LENGTH), y], -1)
    for run in filters(seams="auto"):
        out = run(squares, image)
        for level in (1, 2):
            one, other = squares.read(out, level=level)
            assert np.abs(one - left(at)).max() < 0.03
            assert np.abs(other - right(at)).max() < 0.03


def photo(seed=0):
    noise = np.random.default_rng(seed).normal(size=(128, 128, 3))
    blotches = np.sign(gaussian_filter(noise, (4, 4, 0), mode="nearest"))
    return (0.5 + 0.4 * gaussian_filter(blotches, (1.5, 1.5, 0), mode="nearest")).astype(np.float32)


@pytest.mark.parametrize("angle", [None, 0.3])
def test_what_goes_on_is_filtered_as_when_told_so(angle):
    blocks = Blocks(photo(), angle)
    mesh = core.TriangleMesh(blocks.vertices, blocks.faces)
    texture = blocks.texture(0.0)
    atlas = core.TextureAtlas(mesh, blocks.uv, size=texture.shape[:2])
    values = atlas.gather(texture)
    assert settle_seams(atlas, values, "auto", 0.0) is atlas
    assert settle_seams(atlas, values, "continue", 0.0) is atlas
    extended = settle_seams(atlas, values, "extend", 0.0)
    assert extended is not atlas
    assert np.array_equal(atlas.inside, extended.inside)
    assert not np.array_equal(
        core.dilate_texture(mesh, blocks.uv, texture, core.DilateSettings(seams="extend")),
        core.dilate_texture(mesh, blocks.uv, texture, core.DilateSettings(seams="continue")),
    )


@pytest.mark.parametrize("density", [0.25, 0.5, 1.0])
@pytest.mark.parametrize("cells", [1, 32])
def test_shades_and_noise_go_on_across_changes_of_density(density, cells):
    squares = Squares(density, cells)
    rng = np.random.default_rng(0)

    def shade(p):
        return 0.5 + 0.3 * np.sin(p[:, :1] / 9 + p[:, 1:] / 14) * np.ones(3)

    assert not squares.closed(squares.draw(shade, shade)).any()
    # Noise of its own in each texel, and specks.
    gray = squares.draw(plain(GRAY), plain(GRAY))
    noisy = gray + rng.normal(size=gray.shape) * 0.08
    noisy[rng.random((SIZE, SIZE)) < 0.02] = 1.0
    assert not squares.closed(noisy).any()
    # Under as much noise, materials are told apart.
    apart = squares.draw(plain(RED), plain(GRAY))
    assert squares.closed(apart + rng.normal(size=gray.shape) * 0.08).all()


def test_where_noise_is_a_step_by_chance_nothing_closes():
    # In some of these, the noise of a few texels alone would pass for a step.
    squares = Squares()
    for seed in range(40):
        noise = 0.08 * np.random.default_rng(seed).normal(size=(SIZE, SIZE, 3))
        assert not squares.closed(squares.draw(plain(GRAY), plain(GRAY)) + noise).any()


def test_small_steps_count_if_they_can_be_seen():
    squares = Squares()
    steps = {0.005: False, 0.05: True}
    for step, seen in steps.items():
        ramp = squares.draw(
            lambda p: np.clip(p[:, 1:] / LENGTH, 0.0, 1.0),
            lambda p, step=step: np.clip(p[:, 1:] / LENGTH, 0.0, 1.0) + step,
        )
        assert squares.closed(ramp).all() == squares.closed(ramp).any() == seen
        # In units of any size: heights in metres, say.
        assert np.array_equal(squares.closed(7.0 + 1e-3 * ramp), squares.closed(ramp))


@pytest.mark.parametrize("cells", [1, 8, 64])
def test_a_seam_may_go_on_in_one_part_and_end_in_another(cells):
    # The right side is red up to the middle of the seam, however long its edges are.
    squares = Squares(cells=cells)
    middle = LENGTH / 2

    def right(p):
        return np.where(p[:, 1:] < middle, RED, GRAY)

    image = squares.draw(plain(RED), right)
    closed = squares.closed(image)
    y = np.arange(0.5, LENGTH)
    assert not closed[y < middle - 2].any()
    assert closed[y > middle + 2].all()
    y = y[1:-1]
    for run in filters(seams="auto"):
        out = run(squares, image.astype(np.float32))
        one, other = squares.read(out)
        assert np.abs(one - RED)[np.abs(y - middle) > 2].max() < 3 / 255
        assert np.abs(one - RED).max() < 0.3 * np.abs(GRAY - RED).max()
        assert np.abs(other - right(np.stack([0 * y, y], -1)))[np.abs(y - middle) > 2].max() < 0.03
        # Inside the charts, nothing but the two colors.
        inside = squares.atlas.inside
        shares = (out[inside] - RED) @ (GRAY - RED) / ((GRAY - RED) @ (GRAY - RED))
        assert shares.min() > -1e-4
        assert shares.max() < 1 + 1e-4


def test_a_label_that_ends_at_a_seam_does_not_leave_its_side():
    squares = Squares()

    def label(p):
        return np.where((np.abs(p[:, 1:] - LENGTH / 2) < 12), RED, GRAY)

    image = squares.draw(plain(GRAY), label).astype(np.float32)
    for run in filters(seams="auto"):
        one, _ = squares.read(run(squares, image))
        y = np.arange(1.5, LENGTH - 1)
        assert np.abs(one - GRAY)[np.abs(np.abs(y - LENGTH / 2) - 12) > 2].max() < 3 / 255


def test_a_sliver_without_texels_does_not_join_what_lies_beside_it():
    # Between two squares lies a strip of a quarter of a texel, a chart of its own.
    x = np.array([0.0, 40.0, 40.25, 80.25])
    vertices, faces = grid(3, 1)
    vertices = np.stack([x[vertices[:, 0].astype(int)], 40 * vertices[:, 1]], axis=-1)
    mesh = core.TriangleMesh(np.pad(vertices, ((0, 0), (0, 1))), faces)
    corners = vertices[faces]
    piece = np.searchsorted(x, corners.mean(axis=1)[:, 0]) - 1
    uv = (corners + 8 + np.array([[0.0, 0.3], [20.6, 0.0], [40.0, 0.3]])[piece][:, None]) / 160
    image = np.zeros((160, 160, 3), dtype=np.float32)
    face = core.TextureAtlas(mesh, uv, size=(160, 160)).masks().face
    image[face >= 0] = np.array([RED, RED, GRAY])[piece[face[face >= 0]]]
    out = core.dilate_texture(mesh, uv, image, core.DilateSettings(gutter=4))
    y = np.arange(12, 45, 0.7)
    for place, color in ((48.0, RED), (88.25, GRAY)):
        found = sample(out, np.stack([np.full_like(y, place), y], -1) / 160)
        assert np.abs(found - color).max() < 3 / 255
    same = np.where(image > 0, RED, 0.0).astype(np.float32)
    atlas = core.TextureAtlas(mesh, uv, size=(160, 160))
    assert settle_seams(atlas, atlas.gather(same), "auto", 0.0) is atlas


def test_colors_that_are_transparent_do_not_part_anything():
    squares = Squares()
    image = squares.draw(plain((*RED, 0.0)), plain((*GRAY, 0.0)))
    assert not squares.closed(image, alpha=3).any()
    image = squares.draw(plain((*RED, 1.0)), plain((*RED, 0.0)))
    assert squares.closed(image, alpha=3).all()
    image = squares.draw(plain((*RED, 0.5)), plain((*GRAY, 0.5))).astype(np.float32)
    for run in filters(seams="auto"):
        one, other = squares.read(run(squares, image))
        assert np.abs(one - (*RED, 0.5)).max() < 3 / 255
        assert np.abs(other - (*GRAY, 0.5)).max() < 3 / 255


def test_normals_are_compared_on_the_surface():
    squares = Squares(angles=(0.0, 1.1))

    def on(side, normal):
        # A normal of the plane, as a chart that is turned has it.
        turned = squares.turns[side] @ normal[:2]
        return plain(0.5 + 0.5 * np.array([*turned, normal[2]]))

    leaning = np.array([0.6, 0.0, 0.8])
    image = squares.draw(on(0, leaning), on(1, leaning))
    assert not squares.closed(image, normals=True).any()
    assert squares.closed(image).all()
    other = squares.draw(on(0, leaning), on(1, leaning * (-1, 1, 1))).astype(np.float32)
    assert squares.closed(other, normals=True).all()
    settings = core.TextureSettings(time=64.0, content="normals")
    out = core.sharpen_texture(squares.mesh, squares.uv, other, settings)
    for found, side, x in zip(squares.read(out), (0, 1), (0.6, -0.6), strict=True):
        color = on(side, np.array([x, 0.0, 0.8]))(np.zeros((1, 2)))
        assert np.abs(found - color).max() < 3 / 255


def test_a_mask_keeps_materials_apart_as_well():
    squares = Squares()
    image = squares.draw(plain(RED), plain(GRAY)).astype(np.float32)
    mask = np.zeros((SIZE, SIZE))
    mask[:, : SIZE // 2] = 0.5
    out = core.sharpen_texture(
        squares.mesh, squares.uv, image, core.TextureSettings(time=256.0), mask=mask
    )
    for found, color in zip(squares.read(out), (RED, GRAY), strict=True):
        assert np.abs(found - color).max() < 3 / 255
    kept = squares.atlas.inside & (mask == 0)
    assert np.array_equal(out[kept], image[kept])


def test_a_cube_of_six_colors_keeps_its_edges_straight():
    # Two sides have the same color, so that their charts go on into one another.
    steps = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    colors = np.random.default_rng(2).random((6, 3))
    colors[1] = colors[0]
    quads, uv = [], []
    for side in range(6):
        axis, sign = side % 3, side // 3
        corner = np.empty((4, 3))
        corner[:, axis] = sign
        order = steps if sign else steps[::-1]
        corner[:, (axis + 1) % 3], corner[:, (axis + 2) % 3] = order.T
        quads.append(corner)
        a = 0.3 * side
        turn = np.array([[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]])
        uv.append((order - 0.5) @ turn.T * 24 + 20 + 40 * np.array([side % 3, side // 3]))
    _, faces = np.unique(np.concatenate(quads), axis=0, return_inverse=True)
    vertices = np.unique(np.concatenate(quads), axis=0)
    triangles = np.array([[0, 1, 2], [0, 2, 3]])
    faces = faces.reshape(6, 4)[:, triangles].reshape(-1, 3)
    uv = np.array(uv)[:, triangles].reshape(-1, 3, 2) / 120
    mesh = core.TriangleMesh(vertices, faces)
    atlas = core.TextureAtlas(mesh, uv, size=(120, 120))
    face = atlas.masks().face
    image = np.where(face[..., None] >= 0, colors[face // 2], 0.0)
    image = np.round(255 * image).astype(np.uint8)
    out = core.sharpen_texture(mesh, uv, image, core.TextureSettings(time=256.0), atlas=atlas)
    half = core.dilate_texture(mesh, uv, image, atlas=atlas)
    share = np.linspace(0.02, 0.98, 40)[:, None]
    for side in range(6):
        corners = uv[2 * side, 0], uv[2 * side, 1], uv[2 * side, 2], uv[2 * side + 1, 2]
        for k in range(4):
            at = corners[k] + share * (corners[(k + 1) % 4] - corners[k])
            for found in (sample(out, at), sample(smaller(half, 2), at)):
                assert np.abs(found / 255 - colors[side]).max() < 3 / 255


def test_materials_in_two_tiles_are_kept_apart():
    sizes = {1001: (80, 80), 1002: (80, 80)}
    mosaic = Mosaic.of(sizes, 8)
    vertices, faces = grid(2, 1)
    mesh = core.TriangleMesh(vertices * 60.0, faces)
    corners = (vertices * 60.0)[faces][..., :2]
    right = corners.mean(axis=1)[:, 0] > 60
    tiles = {
        number: np.zeros((80, 80, 3), dtype=np.float32) + color
        for number, color in ((1001, RED), (1002, GRAY))
    }
    image = mosaic.compose(tiles)
    origin = np.array([[mosaic.places[n][1], mosaic.places[n][0]] for n in (1001, 1002)])
    local = corners - np.where(right, 60, 0)[:, None, None] * [1, 0] + (10.3, 9.6)
    uv = (local + origin[right.astype(int)][:, None]) / (mosaic.width, mosaic.height)
    out = core.sharpen_texture(mesh, uv, image, core.TextureSettings(time=64.0))
    y = np.arange(11.0, 68.0)
    for side, x, color in ((0, 70.3, RED), (1, 10.3, GRAY)):
        at = (np.stack([np.full_like(y, x), y], -1) + origin[side]) / (mosaic.width, mosaic.height)
        assert np.abs(sample(out, at) - color).max() < 3 / 255


def test_results_do_not_depend_on_the_order_of_faces():
    squares = Squares(cells=8)
    image = squares.draw(plain(RED), lambda p: np.where(p[:, 1:] < 30, RED, GRAY))
    expected = filters(seams="auto")[0](squares, image.astype(np.float32))
    order = np.random.default_rng(0).permutation(squares.mesh.face_count)
    mesh = core.TriangleMesh(squares.mesh.vertices, squares.mesh.faces[order])
    out = core.sharpen_texture(
        mesh, squares.uv[order], image.astype(np.float32), core.TextureSettings(time=256.0)
    )
    assert np.abs(out - expected).max(axis=-1).mean() < 1e-4


def palette(points, tail):
    """A red chart beside faces on points of a gray swatch; `tail`: the last ones show a part of it.

    64 texels wide, red on the left and gray on the right.
    """
    vertices, faces = grid(2 + tail, 1)
    mesh = core.TriangleMesh(vertices, faces)
    cell = vertices[faces].mean(axis=1)[:, 0].astype(int)
    uv = vertices[faces][..., :2] * 0.2 + [0.1, 0.4]  # the first cell: 13 texels of red
    uv[cell == 1] = points
    if tail:  # the point is the start of a square
        uv[cell == 2] = (vertices[faces][cell == 2][..., :2] - [2, 0]) * 0.2 + points
    image = np.where(np.arange(64)[None, :, None] < 32, RED, GRAY).repeat(64, axis=0)
    return mesh, uv, image


@pytest.mark.parametrize("tail", [False, True])
def test_faces_on_a_point_of_a_palette_lend_no_color_and_keep_theirs(tail):
    mesh, uv, image = palette((0.7, 0.6), tail)
    for result in (
        core.dilate_texture(mesh, uv, image, core.DilateSettings(gutter=8)),
        core.sharpen_texture(mesh, uv, image, core.TextureSettings(gutter=8)),
        core.filter_texture(mesh, uv, image, core.FilterSettings(gutter=8)),
    ):
        assert np.abs(result - image).max() < 1e-4


def test_what_lies_on_a_point_stays_where_the_rest_is_filled():
    mesh, uv, image = palette((0.7, 0.6), False)
    settings = core.FillSettings(gutter=8)
    hole = np.zeros((64, 64), dtype=bool)
    hole[28:36, 10:16] = True
    holed = np.where(hole[..., None], 0.0, image)
    filled = core.fill_texture(mesh, uv, holed, settings, missing=hole)
    assert np.abs(filled - image).max() < 1e-4
    hole[:, 40:50] = True  # the point itself is missing
    filled = core.fill_texture(mesh, uv, holed, settings, missing=hole)
    assert np.abs(filled[38, 44] - RED).max() < 1e-2


def test_images_that_are_made_show_points_as_what_lies_beside_them():
    mesh, uv, _ = palette((0.7, 0.6), False)
    place = core.geodesic_distance(mesh, uv, size=(64, 64), vertices=[0])[36:40, 42:46]
    assert place.max() > 0
