# SPDX-License-Identifier: GPL-3.0-or-later
import numpy as np
import pytest
from atlases import Blocks, apart
from shapes import fan, grid, icosphere
from shock_filter import core
from shock_filter.core.atlas import advect, charts, potential
from shock_filter.core.atlas.ghosts import fill_ghosts
from shock_filter.core.atlas.metric import MOST_FACES, exponential_map, measure_metric
from shock_filter.core.atlas.walk import given_flow
from shock_filter.core.grid.channels import Channels


def square(cells=4):
    vertices, faces = grid(cells, cells)
    return core.TriangleMesh(vertices, faces), vertices[faces][..., :2] / cells


def inside_by_hand(uv, height, width):
    """Faces around each texel's centre by testing each face: (h, w) lists as sets."""
    y, x = np.mgrid[:height, :width] + 0.5
    hit = np.zeros((len(uv), height, width), dtype=bool)
    for f, corners in enumerate(uv * (width, height)):
        a, b, c = corners
        det = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
        second = ((x - a[0]) * (c[1] - a[1]) - (y - a[1]) * (c[0] - a[0])) / det
        third = ((b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0])) / det
        hit[f] = (second >= 0) & (third >= 0) & (second + third <= 1)
    return hit


@pytest.mark.parametrize("size", [(40, 40), (23, 37), (128, 96)])
def test_texels_lie_in_the_faces_that_brute_force_finds(size):
    mesh = core.TriangleMesh(*icosphere(1))
    uv, _ = apart(mesh, texels_per_length=9.0)
    masks = core.TextureAtlas(mesh, uv, size=size).masks()
    hit = inside_by_hand(uv, *size)
    assert np.array_equal(masks.face >= 0, hit.any(axis=0))
    y, x = np.nonzero(masks.face >= 0)
    assert hit[masks.face[y, x], y, x].all()
    assert np.array_equal(masks.chart, masks.face)  # each face is a chart


def test_masks_agree_with_brute_force():
    # Active: a face touches the texel's four squares; boundary: they are not covered.
    mesh = core.TriangleMesh(*icosphere(1))
    uv, _ = apart(mesh, margin=3.0, texels_per_length=9.0)
    size = 90
    masks = core.TextureAtlas(mesh, uv, size=(size, size)).masks()
    fine = 9  # points a texel
    hit = inside_by_hand(uv, fine * size, fine * size)
    chart = np.where(hit.any(axis=0), hit.argmax(axis=0), -1)
    padded = np.pad(chart, fine, constant_values=-1)
    wrong = 0
    for y in range(2, size - 2):
        for x in range(2, size - 2):
            part = padded[
                fine * (y + 1) - fine // 2 : fine * (y + 2) + fine // 2 + 1,
                fine * (x + 1) - fine // 2 : fine * (x + 2) + fine // 2 + 1,
            ]
            seen = len(set(np.unique(part)) - {-1})
            covered = seen == 1 and (part >= 0).all()
            found = masks.count[y, x], masks.active[y, x], masks.boundary[y, x]
            # Between the points, slivers of faces may be missed, never invented.
            assert found[0] >= seen
            assert found[1] == (found[0] > 0)
            assert covered or not seen or found[2]
            wrong += found != (seen, seen > 0, seen > 0 and not covered)
    assert wrong < 0.05 * size * size


def test_charts_are_what_hangs_together_in_the_texture():
    blocks = Blocks(np.zeros((64, 64, 1), dtype=np.float32))
    mesh = core.TriangleMesh(blocks.vertices, blocks.faces)
    atlas = core.TextureAtlas(mesh, blocks.uv, size=(blocks.width, blocks.width))
    assert atlas.report.charts == 16
    chart = atlas.masks().chart
    pitch = blocks.width // 4
    for b in range(16):
        tile = chart[(b // 4) * pitch :, (b % 4) * pitch :][:pitch, :pitch]
        assert len(np.unique(tile[tile >= 0])) == 1
        assert (tile >= 0).sum() == 16 * 16
    assert len(atlas.report.mirrored) == 5 * 8  # every third chart from the second
    assert atlas.report.sentences() == []


def test_charts_that_touch_are_kept_apart():
    # Two charts side by side in the texture that are far apart on the surface.
    vertices, faces = grid(4, 2)
    left = vertices[faces][:, :, 0].max(axis=1) <= 2
    apart_vertices = np.concatenate([vertices, vertices + (50, 0, 9)])
    mesh = core.TriangleMesh(apart_vertices, np.where(left[:, None], faces, faces + len(vertices)))
    uv = (vertices[faces][..., :2] + 0.013) / (4.1, 2.1)
    image = np.zeros((41, 82, 1), dtype=np.float32)
    image[:, 40:] = 1.0  # a jump between the charts
    image[:, 40] = 0.5
    atlas = core.TextureAtlas(mesh, uv, size=(41, 82))
    assert atlas.report.charts == 2
    assert atlas.masks().count.max() == 2
    out = core.sharpen_texture(mesh, uv, image, core.TextureSettings(time=1000.0))
    inside = atlas.inside
    chart = atlas.masks().chart
    for number in (0, 1):
        mine = inside & (chart == number)
        assert out[mine].min() >= image[mine].min()
        assert out[mine].max() <= image[mine].max()


def test_bake_is_linear_in_each_face():
    blocks = Blocks(np.zeros((64, 64, 1), dtype=np.float32), angle=0.3)
    mesh = core.TriangleMesh(blocks.vertices, blocks.faces)
    atlas = core.TextureAtlas(mesh, blocks.uv, size=(blocks.width, blocks.width))
    places = atlas.bake(blocks.vertices[blocks.faces][..., :2])
    y, x = np.nonzero(atlas.inside)
    uv = (np.stack([x, y], axis=-1) + 0.5) / blocks.width
    assert np.allclose(blocks.to_uv(places[y, x]), uv, atol=1e-5)
    assert (places[~atlas.inside] == 0).all()
    assert atlas.bake(np.ones((mesh.face_count, 3))).shape == (blocks.width, blocks.width)
    with pytest.raises(core.InvalidSignal, match="shape"):
        atlas.bake(np.ones(mesh.face_count))
    with pytest.raises(core.InvalidSignal, match="NaN"):
        atlas.bake(np.full((mesh.face_count, 3), np.nan))


def test_texel_size_is_the_square_root_of_area_by_texels():
    mesh, uv = square(4)
    assert core.TextureAtlas(mesh, uv, size=(64, 32)).texel_size == pytest.approx(
        4 / np.sqrt(64 * 32)
    )
    assert core.TextureAtlas(mesh, 0.5 * uv, size=(64, 32)).texel_size == pytest.approx(
        8 / np.sqrt(64 * 32)
    )


def test_straight_walks_follow_the_unfolded_surface():
    # Over a roof's ridge and back into the plane: compare with the flat pattern.
    flat, faces = grid(6, 6, jitter=0.2)
    bent = flat.copy()
    over = flat[:, 0] > 3
    flat[np.abs(flat[:, 0] - 3) < 0.4, 0] = 3.0
    bent[:, 0] = np.where(over, 3 + (flat[:, 0] - 3) * 0.6, flat[:, 0])
    bent[:, 2] = np.where(over, (flat[:, 0] - 3) * 0.8, 0.0)
    mesh = core.TriangleMesh(bent, faces)
    cut = charts.find_charts(mesh, flat[faces][..., :2] / 6, 60, 60)
    metric = measure_metric(mesh, cut, cut.points)
    rng = np.random.default_rng(0)
    b = np.empty(3)
    tried = 0
    for edge in rng.integers(0, 3 * mesh.face_count, 400):
        f, k = divmod(int(edge), 3)
        if mesh.twins[f, k] < 0:
            continue
        share = rng.uniform(0.1, 0.9)
        start = (1 - share) * cut.points[f, k] + share * cut.points[f, (k + 1) % 3]
        third = cut.points[f, (k + 2) % 3]
        away = start - third + rng.normal(size=2)
        away *= rng.uniform(1, 25) / np.linalg.norm(away)
        end = start + away
        normal = [-1, 1] * (cut.points[f, (k + 1) % 3] - cut.points[f, k])[::-1]
        leaves = (normal @ away) * (normal @ (third - start)) < 0
        if (end < 0).any() or (end > 59).any() or not leaves:
            continue
        face, cosine, sine = exponential_map(
            metric.ways, metric.shapes, metric.jacobians, int(edge), share, away[0], away[1], b
        )
        assert np.allclose(b @ cut.points[face], end, atol=1e-6)
        assert cosine**2 + sine**2 == pytest.approx(1.0)
        step = np.array([[cosine, -sine], [sine, cosine]]) @ metric.jacobians[f] @ away
        assert np.allclose(metric.inverse_jacobians[face] @ step, away, atol=1e-6)
        tried += 1
    assert tried > 50


@pytest.mark.parametrize("count", [5000, 30_000])
def test_straight_walks_across_very_many_faces_end_on_their_way(count):
    # Past a hub: a straight line across the fan meets nearly half of its faces.
    vertices, faces = fan(count)
    mesh = core.TriangleMesh(vertices, faces)
    uv = (1.2 + vertices[faces][..., :2]) / 2.4
    cut = charts.find_charts(mesh, uv, 60, 60)
    metric = measure_metric(mesh, cut, cut.points)
    plane = np.column_stack([vertices[:, :2], np.ones(len(vertices))])
    to_texels, *_ = np.linalg.lstsq(
        plane[faces].reshape(-1, 3), cut.points.reshape(-1, 2), rcond=None
    )
    start, end = np.array([[0.5, 0.0, 1.0], [-0.4, -0.6, 1.0]]) @ to_texels
    b = np.empty(3)
    face, cosine, sine = exponential_map(
        metric.ways, metric.shapes, metric.jacobians, 0, 0.5, *(end - start), b
    )
    way = (b @ cut.points[face] - start) / (end - start)  # down and across
    assert way[0] == pytest.approx(way[1], abs=1e-6)
    if count == 5000:
        assert way[0] == pytest.approx(1.0)
    else:
        assert face == count - MOST_FACES
        assert 0.3 < way[0] < 1
    step = np.array([[cosine, -sine], [sine, cosine]]) @ metric.jacobians[0] @ (end - start)
    assert np.allclose(metric.inverse_jacobians[face] @ step, end - start, atol=1e-6)


# --------------------------------------------------------------------------------------- given flow


BOTH = Channels(0, 2, -1, np.empty(0, dtype=np.float32))


def places_after(mesh, uv, size, vectors, time):
    """Follow vectors in space from each texel: where it lies, and where one comes, in the plane."""
    atlas = core.TextureAtlas(mesh, uv, size=(size, size))
    places = atlas.bake(mesh.vertices[mesh.faces][..., :2])
    values = atlas.gather(places)
    fill_ghosts(atlas.sheet, atlas.sources, values)
    out = values.copy()
    advect.advect_texels(atlas, values, BOTH, given_flow(atlas, vectors), time, out)
    return places[atlas.inside], out.reshape(-1, 2)[atlas.owners[atlas.inside]]


def within(places):
    """Places that are not near the border of a square of 64 x 64."""
    return (abs(places - 32) < 30).all(axis=1)


@pytest.mark.parametrize("angle", [None, 0.3])
@pytest.mark.parametrize("way", [(1.0, 0.0), (-0.6, 0.35), (0.2, 0.9)])
def test_a_uniform_given_flow_is_straight_across_seams_as_without(angle, way):
    blocks = Blocks(np.zeros((64, 64, 1)), angle)
    mesh = core.TriangleMesh(blocks.vertices, blocks.faces)
    vectors = np.broadcast_to([*way, 7.0], (mesh.face_count, 3))  # what points out is left out
    uncut = mesh.vertices[mesh.faces][..., :2] / 64
    for uv, size in ((blocks.uv, blocks.width), (uncut, 64)):
        starts, ends = places_after(mesh, uv, size, vectors, 30.0)
        expected = starts + 30.0 * np.array(way)
        stays = within(starts) & within(expected)
        assert stays.sum() > 800
        # At seams, values are read between ghosts, which are right up to interpolation.
        errors = abs(ends[stays] - expected[stays]).max(axis=1)
        assert (np.quantile(errors, [0.5, 0.9, 1.0]) < [1e-4, 5e-3, 0.5]).all()


@pytest.mark.parametrize("angle", [None, 0.3])
def test_normals_that_cross_seams_point_the_same_way_in_space(angle):
    # One direction in the plane, as the charts' own frames have it; long walks cross several seams.
    blocks = Blocks(np.zeros((64, 64, 1)), angle)
    mesh = core.TriangleMesh(blocks.vertices, blocks.faces)
    pitch = blocks.width // 4
    colors = np.array([0.5 + 0.5 * turn @ [0.6, -0.3] for turn in blocks.turns])
    image = np.kron(colors.reshape(4, 4, 2), np.ones((pitch, pitch, 1))).astype(np.float32)
    atlas = core.TextureAtlas(mesh, blocks.uv, size=(blocks.width, blocks.width))
    values = atlas.gather(image)
    fill_ghosts(atlas.sheet, atlas.sources, values, -1, 0.5)
    flow = given_flow(atlas, np.tile([0.7, 0.4, 0.0], (mesh.face_count, 1)))
    for time in (10.0, 45.0):
        out = values.copy()
        advect.advect_texels(atlas, values, BOTH, flow, time, out, normals=True)
        inside = atlas.sheet.nodes >= 0
        assert np.abs(out - values)[inside].max() < 1e-4


def test_a_given_flow_lies_on_the_surface_and_ends_at_its_border():
    # Up a slope of 3 in 4, lengths on it are 5/4 of those in the plane.
    blocks = Blocks(np.zeros((64, 64, 1)), None)
    slope = blocks.vertices.copy()
    slope[:, 2] = 0.75 * slope[:, 0]
    mesh = core.TriangleMesh(slope, blocks.faces)
    given = mesh, blocks.uv, blocks.width, np.broadcast_to([0.8, 0.0, 0.6], (mesh.face_count, 3))
    texel = core.TextureAtlas(*given[:2], size=2 * given[2:3]).texel_size
    starts, ends = places_after(*given, 20.0)
    expected = starts + [20.0 * texel * 0.8, 0.0]
    stays = within(starts) & within(expected)
    assert stays.sum() > 800
    assert abs(ends[stays] - expected[stays]).max() < 5e-3
    starts, ends = places_after(*given, 200.0)
    assert ends[within(starts), 0].min() > 62


def test_a_given_flow_into_a_seam_from_both_sides_stays_there(caplog):
    blocks = Blocks(np.zeros((64, 64, 1)), 0.3)
    mesh = core.TriangleMesh(blocks.vertices, blocks.faces)
    left = mesh.vertices[mesh.faces].mean(axis=1)[:, 0] < 32
    vectors = np.where(left[:, None], [1.0, 0.0, 0.0], [-1.0, 0.0, 0.0])
    starts, ends = places_after(mesh, blocks.uv, blocks.width, vectors, 40.0)
    assert abs(ends[within(starts), 0] - 32).max() < 1.5
    assert not caplog.records


@pytest.mark.parametrize("bad", [np.ones((3, 3)), np.full((32, 3), np.nan)])
def test_given_flows_that_cannot_be_used_are_named(bad):
    mesh, uv = square()
    atlas = core.TextureAtlas(mesh, uv, size=(16, 16))
    with pytest.raises(core.InvalidSignal, match="vectors"):
        given_flow(atlas, bad)


def test_endless_walks_of_given_flows_are_refused():
    mesh, uv = square()
    with pytest.raises(ValueError, match="finite"):
        places_after(mesh, uv, 16, np.ones((mesh.face_count, 3)), np.inf)


@pytest.mark.parametrize("guard", ["MOST_STEPS", "MOST_SEAMS"])
def test_walks_that_are_cut_off_are_counted(monkeypatch, caplog, guard):
    blocks = Blocks(np.zeros((64, 64, 1)), 0.3)
    mesh = core.TriangleMesh(blocks.vertices, blocks.faces)
    given = mesh, blocks.uv, blocks.width, np.broadcast_to([0.6, 0.8, 0.0], (mesh.face_count, 3))
    places_after(*given, 40.0)
    assert not caplog.records
    monkeypatch.setattr(advect, guard, 1)
    places_after(*given, 40.0)
    (record,) = caplog.records
    assert 1000 < record.args[0] <= 4 * 64 * 64


# ---------------------------------------------------------------------------------------- bad input


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda uv: None, "no texture coordinates"),
        (lambda uv: uv[:-1], "shape"),
        (lambda uv: uv.reshape(-1, 2), "shape"),
        (lambda uv: np.zeros_like(uv), "zero area"),
        (lambda uv: uv * (1.0, 0.0), "zero area"),
        (lambda uv: np.where(np.arange(len(uv))[:, None, None] == 3, np.nan, uv), "face 3"),
        (lambda uv: np.where(np.arange(len(uv))[:, None, None] == 3, np.inf, uv), "infinite"),
        (lambda uv: uv.astype(str), "floats"),
        (lambda uv: uv * 50.0, "not tiled"),
        (lambda uv: uv + 1e8, "1e6"),
    ],
)
def test_unusable_coordinates_are_named_and_the_image_stays(change, words):
    mesh, uv = square()
    image = np.random.default_rng(0).random((16, 16, 3))
    before = image.copy()
    for filter_ in (core.sharpen_texture, core.dilate_texture):
        with pytest.raises(core.InvalidUV, match=words):
            filter_(mesh, change(uv), image)
    assert np.array_equal(image, before)


def test_overlapping_faces_are_reported():
    mesh, uv = square()
    fold = uv.copy()
    fold[..., 0] = np.abs(uv[..., 0] - 0.5)  # the left half lies on the right one, mirrored
    atlas = core.TextureAtlas(mesh, fold, size=(64, 64))
    assert len(atlas.report.overlapping) == mesh.face_count
    assert len(atlas.report.mirrored) == mesh.face_count // 2
    assert "overlap" in atlas.report.sentences()[0]
    apart_charts = uv.copy()
    apart_charts[uv[..., 0].min(axis=1) >= 0.5] -= (0.5, 0.0)  # two charts at one place
    report = core.TextureAtlas(mesh, apart_charts, size=(64, 64)).report
    assert len(report.overlapping) == mesh.face_count
    assert len(core.TextureAtlas(mesh, uv, size=(64, 64)).report.overlapping) == 0


def test_charts_that_lie_on_each_other_flow_alike():
    # Both halves of a symmetric picture share texels: the same as one half alone, doubled.
    rng = np.random.default_rng(1)
    image = np.repeat(rng.random((32, 8, 3)), 4, axis=1).astype(np.float32)
    vertices, faces = grid(4, 4)
    two = np.concatenate([vertices, vertices + (0, 0, 100.0)])
    mesh = core.TriangleMesh(two, np.concatenate([faces, faces + len(vertices)]))
    uv = np.tile(vertices[faces][..., :2] / 4, (2, 1, 1))
    settings = core.TextureSettings(time=32.0)
    once = core.sharpen_texture(
        core.TriangleMesh(vertices, faces), uv[: len(faces)], image, settings
    )
    assert np.allclose(core.sharpen_texture(mesh, uv, image, settings), once, atol=1e-5)


def test_degenerate_faces_are_reported_and_crossed():
    mesh, uv = square(8)
    flat = uv.copy()
    # A column of squares is squeezed to a line of the texture: a seam runs along both sides.
    squeezed = (uv[..., 0].min(axis=1) > 0.49) & (uv[..., 0].max(axis=1) < 0.63)
    flat[squeezed, :, 0] = 0.5
    atlas = core.TextureAtlas(mesh, flat, size=(64, 64))
    assert np.array_equal(atlas.report.degenerate, np.flatnonzero(squeezed))
    image = np.random.default_rng(0).random((64, 64, 3))
    out = core.sharpen_texture(mesh, flat, image, core.TextureSettings(time=64.0))
    assert np.isfinite(out).all()
    assert 0 <= out.min() <= out.max() <= 1


def messy():
    rng = np.random.default_rng(3)
    vertices, faces = icosphere(2)
    faces = np.concatenate(
        [faces, [[0, 1, 2], [5, 5, 7], [9, 40, 9]], rng.integers(0, 100, (40, 3))]
    )
    return core.TriangleMesh(vertices, faces), rng.random((len(faces), 3, 2)) * 1.6 - 0.3


@pytest.mark.parametrize("size", [(1, 1), (1, 9), (2, 2), (5, 64), (64, 64)])
def test_nonsense_gives_finite_values_in_range(size):
    # Random coordinates: faces overlap, fold, leave the image; edges with many faces.
    mesh, uv = messy()
    image = np.random.default_rng(0).random((*size, 3)).astype(np.float32)
    for time in (1.0, 100.0, np.inf):
        out = core.sharpen_texture(mesh, uv * 0.2, image, core.TextureSettings(time=time))
        assert np.isfinite(out).all()
        inside = core.TextureAtlas(mesh, uv * 0.2, size=size).inside
        assert image.min() <= out[inside].min(initial=1.0)
        assert out[inside].max(initial=0.0) <= image.max()
    assert np.isfinite(core.dilate_texture(mesh, uv * 0.2, image)).all()
    core.TextureAtlas(mesh, uv * 0.2, size=size).masks()


def test_faces_without_area_in_space_end_the_surface():
    vertices, faces = icosphere(2)
    mesh = core.TriangleMesh(vertices, faces)
    uv, size = apart(mesh, texels_per_length=9.0)
    vertices[faces[::9, 1]] = vertices[faces[::9, 0]]
    vertices[faces[4::9, 2]] = vertices[faces[4::9, :2]].mean(axis=1)
    mesh = core.TriangleMesh(vertices, faces)
    assert (mesh.areas == 0).sum() > 20
    image = np.random.default_rng(0).random((size, size, 3)).astype(np.float32)
    for time in (16.0, np.inf):
        out = core.sharpen_texture(mesh, uv, image, core.TextureSettings(time=time))
        assert np.isfinite(out).all()
        assert image.min() <= out.min() <= out.max() <= image.max()


@pytest.mark.parametrize(("seed", "angle"), [(19, 0.3), (24, 0.11), (27, None)])
def test_walks_that_go_round_over_seams_end(seed, angle, caplog):
    # Walks come back to the same place over two seams, as each chart reads its own texels.
    blocks = Blocks(np.zeros((64, 64, 3), dtype=np.float32), angle=angle)
    mesh = core.TriangleMesh(blocks.vertices, blocks.faces)
    shape = (blocks.width, blocks.width, 3)
    image = np.random.default_rng(seed).random(shape).astype(np.float32)
    core.sharpen_texture(mesh, blocks.uv, image, core.TextureSettings(time=np.inf))
    assert not caplog.records


@pytest.mark.parametrize("texels", [1.0, 2.0, 3.0])
def test_nothing_beside_charts_as_thin_as_texels_gets_in(texels):
    mesh = core.TriangleMesh(*icosphere(2))
    uv, size = apart(mesh, texels_per_length=texels)
    rng = np.random.default_rng(1)
    angle = 2 * np.pi * rng.random(mesh.face_count)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    centre = uv.mean(axis=1, keepdims=True)
    uv = centre + np.einsum("ijf,fkj->fki", turn, uv - centre)
    uv += rng.random((mesh.face_count, 1, 2)) / size
    atlas = core.TextureAtlas(mesh, uv, size=(size, size))
    image = np.full((size, size, 1), 50.0, dtype=np.float32)
    image[atlas.inside] = rng.random((np.count_nonzero(atlas.inside), 1))
    for time in (16.0, np.inf):
        out = core.sharpen_texture(mesh, uv, image, core.TextureSettings(time=time), atlas=atlas)
        assert atlas.inside.any()
        assert out[atlas.inside].max() <= 1.0


@pytest.mark.parametrize("scale", [1e-30, 1e-20, 1e20, 1e28])
def test_the_gutter_does_not_depend_on_the_unit_of_values(scale):
    blocks = Blocks(np.random.default_rng(0).random((32, 32, 3)).astype(np.float32), angle=0.3)
    mesh = core.TriangleMesh(blocks.vertices, blocks.faces)
    texture = blocks.texture()
    out = core.dilate_texture(mesh, blocks.uv, texture)
    scaled = core.dilate_texture(mesh, blocks.uv, texture * np.float32(scale))
    assert np.allclose(scaled / np.float64(scale), out, atol=1e-3)


def test_the_flow_stays_finite_where_squares_of_values_overflow():
    nodes = np.zeros((4, 4), dtype=np.int32)
    areas = np.ones(1, dtype=np.float32)
    for energy in (np.inf, -np.inf, np.nan):
        found = np.zeros((4, 4), dtype=np.float32)
        energies = np.full((4, 4), energy, dtype=np.float32)
        potential._average_energy(1, 4, nodes, nodes, areas, energies, found)
        assert np.isfinite(found).all()


def test_one_texel_and_charts_without_texels_stay_bit_for_bit():
    mesh, uv = square()
    one = np.array([[[0.1, 0.2, 0.7]]])  # float64: does not pass through float32
    assert np.array_equal(core.sharpen_texture(mesh, uv, one, mask=np.zeros((1, 1))), one)
    assert np.array_equal(core.dilate_texture(mesh, uv, one), one)
    image = np.random.default_rng(0).random((8, 8, 3))
    settings = core.DilateSettings(background="nearest")
    assert np.array_equal(core.dilate_texture(mesh, 0.3 + 1e-3 * uv, image, settings), image)


def test_results_are_the_same_on_any_number_of_threads(monkeypatch):
    from shock_filter.core.base import parallel

    mesh, uv = messy()
    image = np.random.default_rng(0).random((64, 64, 3)).astype(np.float32)
    several = core.sharpen_texture(mesh, uv * 0.3, image)
    monkeypatch.setattr(parallel, "thread_count", lambda: 1)
    assert np.array_equal(core.sharpen_texture(mesh, uv * 0.3, image), several)


def test_a_face_that_reaches_too_far_is_named():
    mesh, uv = square()
    far = 0.5 * uv
    far[5, 0] = (9000.0, far[5, 0, 1])
    far[5, 1] = (9000.0, far[5, 0, 1] + 1e-4)
    with pytest.raises(core.InvalidUV, match="chart is that of face 5"):
        core.TextureAtlas(mesh, far, size=(64, 64))


@pytest.mark.parametrize("values", [[[1, 2], [3]], [["a", "b", "c"]], np.full((1, 3), 1j)])
def test_values_that_are_no_numbers_are_refused(values):
    mesh = core.TriangleMesh(np.eye(3), [[0, 1, 2]])
    atlas = core.TextureAtlas(mesh, np.eye(3)[None, :, :2] * 0.8 + 0.1, size=(8, 8))
    with pytest.raises(core.InvalidSignal):
        atlas.bake(values)


def test_masked_coordinates_are_refused():
    hidden = np.ma.masked_array(np.eye(3), mask=np.eye(3))
    with pytest.raises(core.InvalidMesh, match="masked"):
        core.TriangleMesh(hidden, [[0, 1, 2]])
    mesh, flat = core.TriangleMesh(np.eye(3), [[0, 1, 2]]), np.eye(3)[None, :, :2]
    with pytest.raises(core.InvalidUV, match="masked"):
        core.TextureAtlas(mesh, np.ma.masked_array(flat, mask=flat > 0), size=(8, 8))
