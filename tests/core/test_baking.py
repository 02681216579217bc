# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests of maps baked together, and of those of a detailed mesh onto a simple one."""

import numpy as np
import pytest
from PIL import Image
from shapes import grid, icosphere
from shock_filter import core
from shock_filter.core import cli
from shock_filter.core.base import parallel
from shock_filter.core.base.findings import gathering
from shock_filter.core.maps.baking import MAPS

SIZE = 48, 48


def sheets(height=0.0, cells=40):
    """A square of two triangles, and a fine one above it, with a bump of this height."""
    low = core.TriangleMesh(
        [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], [[0, 1, 2], [0, 2, 3]]
    )
    vertices, faces = grid(cells, cells)
    vertices = 2 * vertices / np.ptp(vertices[:, 0])
    vertices -= 0.5 * (vertices.min(axis=0) + vertices.max(axis=0))
    x, y = vertices[:, 0], vertices[:, 1]
    vertices[:, 2] = height * np.exp(-8 * (x * x + y * y))
    if core.TriangleMesh(vertices, faces).normals[0, 2] < 0:
        faces = faces[:, ::-1]
    return low, core.TriangleMesh(vertices, faces), 0.5 + 0.5 * low.vertices[low.faces][..., :2]


def centres():
    place = -1 + 2 * (np.arange(SIZE[0]) + 0.5) / SIZE[0]
    return np.meshgrid(place, place)


def test_each_map_is_that_of_its_own_function():
    mesh, _, uv = sheets()
    settings = core.BakeSettings(rays=16)
    few = core.OcclusionSettings(rays=16)
    wall = core.TriangleMesh([[0, -9, 0], [0, 9, 0], [0, 0, 9]], [[0, 1, 2]])
    baked = core.bake_maps(mesh, uv, settings, size=SIZE, occluders=[wall])
    assert list(baked) == ["curvature", "occlusion", "bent_normals", "thickness"]
    wanted = core.ambient_occlusion(mesh, uv, few, size=SIZE, occluders=[wall])
    assert np.array_equal(baked["occlusion"], wanted)
    bent = core.bent_normals(mesh, uv, few, size=SIZE, occluders=[wall])
    assert np.abs(2 * baked["bent_normals"] - 1 - bent).max() < 0.02
    assert np.array_equal(baked["curvature"], core.curvature_map(mesh, uv, size=SIZE))


def test_heights_and_normals_of_a_bump():
    low, high, uv = sheets(0.08)
    baked = core.bake_maps(low, uv, size=SIZE, maps=["normals", "displacement"], high=high)
    x, y = centres()
    wanted = 0.08 * np.exp(-8 * (x * x + y * y))
    assert np.abs(baked["displacement"] - wanted).max() < 1e-3
    normals = np.stack([16 * x * wanted, 16 * y * wanted, np.ones_like(x)], axis=-1)
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    found = 2 * baked["normals"] - 1  # u runs along x, and v along y
    assert np.abs(found - normals)[2:-2, 2:-2].max() < 0.03


def test_occluders_make_no_holes_and_undersides_do_not_count():
    low, high, uv = sheets(0.08)
    words = {"size": SIZE, "maps": ["displacement"]}
    wanted = core.bake_maps(low, uv, high=high, **words)["displacement"]
    between = core.TriangleMesh(low.vertices + [0, 0, 0.01], low.faces)
    found = core.bake_maps(low, uv, high=high, occluders=[between], **words)["displacement"]
    assert np.array_equal(found, wanted)
    below = core.TriangleMesh(low.vertices + [0, 0, 0.004], low.faces[:, ::-1])
    plate = core.TriangleMesh(
        np.concatenate([high.vertices + [0, 0, 0.02], below.vertices]),
        np.concatenate([high.faces, below.faces + high.vertex_count]),
    )
    found = core.bake_maps(low, uv, high=plate, **words)["displacement"]
    assert np.abs(found - wanted - 0.02).max() < 1e-3


def test_a_mesh_onto_itself_is_flat_and_keeps_its_colors():
    vertices, faces = icosphere(3)
    ball = core.TriangleMesh(vertices, faces)
    corners = ball.vertices[ball.faces]
    upper = np.where(corners[:, :, 2:].mean(axis=1, keepdims=True) > 0, 0.25, 0.75)
    uv = upper + 0.2 * corners[..., :2]
    atlas = core.TextureAtlas(ball, uv, size=SIZE)
    colors = 0.5 + 0.5 * ball.vertices
    baked = core.bake_maps(
        ball,
        uv,
        core.BakeSettings(gutter=0),
        size=SIZE,
        maps=["normals", "displacement", "colors"],
        high=ball,
        colors=colors,
        atlas=atlas,
    )
    inside = atlas.inside
    assert np.abs(baked["displacement"][inside]).max() < 1e-4
    assert np.abs(baked["normals"][inside] - [0.5, 0.5, 1.0]).max() < 0.01
    wanted = 0.5 + 0.5 * atlas.bake(ball.vertices[ball.faces])
    assert np.abs(baked["colors"] - wanted)[inside].max() < 0.01


def test_what_the_cage_does_not_reach_stays_flat():
    low, high, uv = sheets()
    away = core.TriangleMesh(high.vertices + [0, 0, 0.5], high.faces)
    settings = core.BakeSettings(cage=0.1)
    baked = core.bake_maps(
        low, uv, settings, size=SIZE, maps=["normals", "displacement"], high=away
    )
    assert not baked["displacement"].any()
    assert np.abs(baked["normals"] - [0.5, 0.5, 1.0]).max() < 1e-4
    reached = core.BakeSettings(cage=0.6, look="gray")
    baked = core.bake_maps(low, uv, reached, size=SIZE, maps=["displacement"], high=away)
    assert np.abs(baked["displacement"] - (0.5 + 0.5 * 0.5 / 0.6)).max() < 1e-3


def test_texels_that_meet_nothing_are_filled_from_around_and_told():
    low, high, uv = sheets(0.08)
    x, y, z = high.vertices.T
    middle = high.vertices[high.faces].mean(axis=1)
    is_hole = (np.abs(middle[:, 0]) < 0.3) & (np.abs(middle[:, 1] - 0.4) < 0.3)
    torn = core.TriangleMesh(high.vertices, high.faces[~is_hole])
    colors = np.stack([0.5 + 0.5 * x, 0.5 + 0.4 * y, np.full_like(z, 0.7)], axis=1)
    maps = ["colors", "occlusion", "curvature", "normals", "displacement"]
    few = core.BakeSettings(rays=16)
    with gathering() as findings:
        baked = core.bake_maps(low, uv, few, size=SIZE, maps=maps, high=torn, colors=colors)
    x, y = centres()
    wanted = np.stack([0.5 + 0.5 * x, 0.5 + 0.4 * y, np.full_like(x, 0.7)], axis=-1)
    inside = (np.abs(x) < 0.25) & (np.abs(y - 0.4) < 0.25)
    assert not baked["displacement"][inside].any()
    assert np.abs(baked["normals"][inside] - [0.5, 0.5, 1.0]).max() < 1e-4
    assert np.abs(baked["colors"] - wanted)[2:-2, 2:-2].max() < 0.01
    assert baked["occlusion"][inside].min() > 0.9
    assert np.abs(baked["curvature"][inside]).min() > 0  # it goes on from the bump beside
    (said,) = map(str, findings)
    share = 100 * (baked["displacement"] == 0).mean()
    assert float(said.split("%")[0]) == pytest.approx(share, abs=0.01)
    assert said.endswith("within 0.14; there is nothing beside them.")


def test_the_cage_that_would_do_is_told():
    low, high, uv = sheets()
    away = core.TriangleMesh(high.vertices + [0, 0, 0.5], high.faces)
    settings = core.BakeSettings(cage=0.1)
    words = {"size": SIZE, "maps": ["displacement"], "high": away}
    with gathering() as findings:
        core.bake_maps(low, uv, settings, **words)
    said = str(findings[0])
    assert said == (
        "100% of the texels meet nothing of the detailed mesh within 0.1; raise Cage to about 0.52."
    )
    with gathering() as findings:
        core.bake_maps(low, uv, settings.changed(cage=0.53), **words)
    assert not findings


@pytest.mark.parametrize(("cells", "is_told"), [(100, False), (40, True)])
def test_texels_too_few_to_be_seen_are_not_told(cells, is_told):
    """Of a detailed mesh that lacks a triangle: .005 or .03 percent of the texels."""
    low, high, uv = sheets(cells=cells)
    torn = core.TriangleMesh(high.vertices, np.delete(high.faces, cells * cells, axis=0))
    words = {"size": (256, 256), "maps": ["normals"], "high": torn}
    with gathering() as findings:
        core.bake_maps(low, uv, core.BakeSettings(cage=0.01), **words)
    assert bool(findings) == is_told


def test_whites_of_grays_are_told():
    low, high, uv = sheets(0.08)
    words = {"size": SIZE, "maps": ["displacement", "curvature"], "high": high}
    values = core.bake_maps(low, uv, core.BakeSettings(rays=2), **words)
    with gathering() as findings:
        grays = core.bake_maps(low, uv, core.BakeSettings(rays=2, look="gray"), **words)
    whites = dict(zip(words["maps"], (each.values["white"] for each in findings), strict=True))
    for name, white in whites.items():
        wanted = np.clip(0.5 + 0.5 * values[name] / white, 0, 1)
        assert np.abs(grays[name] - wanted).max() < 1e-6, name
    assert whites["displacement"] == values["displacement"].max()
    with gathering() as findings:
        core.bake_maps(low, uv, core.BakeSettings(rays=2, look="gray", cage=0.2), **words)
    assert "In the map of heights, white is 0.2 above, black as much below." in map(str, findings)


def test_wrong_input_and_cancelling():
    low, high, uv = sheets()
    with pytest.raises(core.InvalidSettings, match="give it as `high`"):
        core.bake_maps(low, uv, size=SIZE, maps=["normals"])
    with pytest.raises(core.InvalidSettings, match="there are curvature"):
        core.bake_maps(low, uv, size=SIZE, maps=["albedo"])
    with pytest.raises(core.InvalidSettings, match="give `colors`"):
        core.bake_maps(low, uv, size=SIZE, maps=["colors"], high=high)
    with pytest.raises(core.InvalidSignal, match="colors have the shape"):
        core.bake_maps(low, uv, size=SIZE, maps=["colors"], high=high, colors=[[1, 2, 3]])
    with pytest.raises(core.Cancelled):
        core.bake_maps(low, uv, size=SIZE, progress=lambda *_: False)


def write_obj(path, mesh, uv=None):
    lines = [f"v {x:.9f} {y:.9f} {z:.9f}" for x, y, z in mesh.vertices]
    corner = [[f"{v + 1}" for v in face] for face in mesh.faces]
    if uv is not None:
        lines += [f"vt {u:.9f} {v:.9f}" for u, v in uv.reshape(-1, 2)]
        corner = [
            [f"{v}/{3 * number + k + 1}" for k, v in enumerate(face)]
            for number, face in enumerate(corner)
        ]
    path.write_text("\n".join([*lines, *(f"f {' '.join(face)}" for face in corner)]) + "\n")


def test_files_get_the_maps_of_the_functions(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    low, high, uv = sheets(0.08)
    write_obj(tmp_path / "low.obj", low, uv)
    write_obj(tmp_path / "high.obj", high)
    words = ["bake-maps", "low.obj", "--size", "48x48", "--high", "high.obj"]
    assert cli.main([*words, "height.npy", "--map", "displacement"]) == 0
    wanted = core.bake_maps(low, uv, size=SIZE, maps=["displacement"], high=high)["displacement"]
    np.testing.assert_allclose(np.load("height.npy")[::-1], wanted, atol=1e-6)
    assert cli.main([*words, "normals.png", "--map", "normals"]) == 0
    with Image.open("normals.png") as image:
        assert image.size == (48, 48)
    capsys.readouterr()
    assert cli.main([*words, "height.png", "--map", "displacement"]) == 1
    assert "--look gray" in capsys.readouterr().err
    assert cli.main([*words[:4], "normals.npy", "--map", "normals"]) == 1
    assert "--high" in capsys.readouterr().err
    assert not (tmp_path / "height.png").exists() and not (tmp_path / "normals.npy").exists()


def test_several_maps_come_in_one_run_under_the_names_that_others_know(
    tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    low, high, uv = sheets(0.08)
    write_obj(tmp_path / "low.obj", low, uv)
    write_obj(tmp_path / "high.obj", high)
    words = ["bake-maps", "low.obj", "part.png", "--high", "high.obj", "--size", "48x48"]
    words += ["--rays", "8", "--look", "gray", "--map", "normals", "displacement", "normals"]
    assert cli.main([*words, "--map", "occlusion"]) == 0
    said = capsys.readouterr().out
    assert "low.obj -> part_normal.png: part_normal.png, part_height.png, part_ao.png on" in said
    assert "In the map of heights, white is" in said
    files = {path.name for path in tmp_path.glob("*.png")}
    assert files == {"part_normal.png", "part_height.png", "part_ao.png"}
    settings = core.BakeSettings(rays=8, look="gray")
    maps = ["normals", "displacement", "occlusion"]
    wanted = core.bake_maps(low, uv, settings, size=SIZE, maps=maps, high=high)
    with Image.open("part_height.png") as image:
        assert image.mode.startswith("I;16")
        height = np.asarray(image) / 65535
    np.testing.assert_allclose(height[::-1], wanted["displacement"], atol=2e-5)


def test_no_map_of_several_is_written_over_a_file_or_without_the_others(
    tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    low, _, uv = sheets()
    write_obj(tmp_path / "low.obj", low, uv)
    words = ["bake-maps", "low.obj", "part.npy", "--size", "16x16", "--rays", "2", "--map"]
    words += ["curvature", "occlusion"]
    (tmp_path / "part_ao.npy").write_bytes(b"old")
    assert cli.main(words) == 1
    assert "part_ao.npy exists already" in capsys.readouterr().err
    assert not (tmp_path / "part_curvature.npy").exists()
    assert cli.main([*words, "--overwrite"]) == 0
    assert np.load("part_ao.npy").shape == np.load("part_curvature.npy").shape == (16, 16)
    (tmp_path / "part_ao.npy").unlink()
    (tmp_path / "part_curvature.npy").unlink()
    capsys.readouterr()
    assert cli.main([*words, "--resume"]) == 0
    assert cli.main([*words, "--resume"]) == 0
    assert "Skipped, as they are done already: 1" in capsys.readouterr().out


@pytest.mark.parametrize("maps", [MAPS, ("curvature",), ("thickness", "normals")])
def test_progress_rises_to_its_end_and_does_not_stand_still(maps, monkeypatch):
    monkeypatch.setattr(parallel, "most_threads", 1)  # others might do all between two questions
    low, high, uv = sheets(0.08)
    torn = core.TriangleMesh(high.vertices, high.faces[40:])  # so that texels are filled
    seen = []

    def progress(fraction, message):
        seen.append((fraction, message))
        return True

    core.bake_maps(
        low, uv, core.BakeSettings(rays=16), size=(96, 96), maps=maps, high=torn,
        colors=torn.vertices, progress=progress,
    )  # fmt: skip
    fractions = np.array([fraction for fraction, _ in seen])
    assert (np.diff(fractions) >= 0).all() and fractions[0] < 0.02 and fractions[-1] == 1
    assert np.diff(fractions).max() < 0.2
    moves = np.flatnonzero(np.diff(fractions, prepend=-1) > 0)
    assert len(moves) > 30
    assert all(message for _, message in seen[:-1])


def test_maps_of_rays_go_on_across_seams():
    """A ball in six charts, beside a wall; places on seams are read in both charts."""
    vertices, faces = icosphere(3)
    ball = core.TriangleMesh(vertices, faces)
    corners = ball.vertices[ball.faces]
    middle = corners.mean(axis=1)
    axis = np.abs(middle).argmax(axis=1)
    side = (middle[np.arange(len(middle)), axis] > 0).astype(int)
    rows = np.arange(len(faces))[:, None]
    across = np.stack([(axis + 1) % 3, (axis + 2) % 3], axis=1)
    flat = corners[rows[..., None], np.arange(3)[None, :, None], across[:, None, :]]
    chart = 2 * axis + side
    uv = np.stack([chart % 3, chart // 3], axis=1)[:, None, :] / (3, 2)
    uv = uv + (0.5 + 0.48 * flat) / (3, 2)
    size = 192, 288
    atlas = core.TextureAtlas(ball, uv, size=size)
    wall = core.TriangleMesh([[2, -9, -3], [2, 9, -3], [2, 0, 9]], [[0, 1, 2]])
    maps = ["occlusion", "thickness"]
    baked = core.bake_maps(
        ball, uv, core.BakeSettings(), size=size, maps=maps, occluders=[wall], atlas=atlas
    )
    ends = {}
    for face, corner in np.ndindex(len(faces), 3):
        one, two = faces[face, corner], faces[face, (corner + 1) % 3]
        ends.setdefault((min(one, two), max(one, two)), []).append((face, corner, one > two))
    pairs = []
    for shared in ends.values():
        both = []
        for face, corner, is_turned in shared:
            a, b = uv[face, corner], uv[face, (corner + 1) % 3]
            both.append((b, a) if is_turned else (a, b))
        if chart[shared[0][0]] != chart[shared[1][0]]:
            pairs.append(both)
    assert len(pairs) > 50
    for name in maps:
        image, scale = baked[name], baked[name].max()
        apart = []
        for one, two in pairs:
            for share in (0.1, 0.3, 0.5, 0.7, 0.9):
                places = [(1 - share) * a + share * b for a, b in (one, two)]
                first, second = (bilinear(image, place) for place in places)
                apart.append(abs(first - second) / scale)
        assert max(apart) < 1 / 255, name


def bilinear(image, place):
    """Read an image between its texels, as renderers do."""
    x, y = place[0] * image.shape[1] - 0.5, place[1] * image.shape[0] - 0.5
    left, low = int(np.floor(x)), int(np.floor(y))
    s, t = x - left, y - low
    four = image[low : low + 2, left : left + 2]
    return float((1 - t) * (1 - s) * four[0, 0] + (1 - t) * s * four[0, 1]
                 + t * (1 - s) * four[1, 0] + t * s * four[1, 1])  # fmt: skip


def test_thickness_follows_the_unit_of_length():
    mesh = core.TriangleMesh(*icosphere(2))
    flat = mesh.vertices[mesh.faces][..., :2]
    count = len(mesh.faces)
    side = int(np.ceil(np.sqrt(count)))
    place = np.stack(np.divmod(np.arange(count), side), 1)[:, None]
    low, high = flat.min(1, keepdims=True), flat.max(1, keepdims=True)
    uv = (place + 0.1 + 0.8 * (flat - low) / (high - low)) / side
    found = [
        core.bake_maps(
            core.TriangleMesh(scale * mesh.vertices, mesh.faces),
            uv,
            maps=["thickness"],
            size=(64, 64),
            settings=core.BakeSettings(rays=16),
        )["thickness"]
        / scale
        for scale in (1.0, 1e-6)
    ]
    np.testing.assert_allclose(found[1], found[0], atol=1e-4)
