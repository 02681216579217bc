# SPDX-License-Identifier: GPL-3.0-or-later
"""Denoise, then sharpen: arrays, files, and the command line."""

import numpy as np
import pytest
from on_files import denoise_colors_file, denoise_file, denoise_image_file
from PIL import Image
from shapes import cube, grid
from shock_filter import core
from shock_filter.core import cli
from shock_filter.core.files.output import Outcome
from shock_filter.core.registry import find
from shock_filter.core.shape.denoising import beltrami_joint_corners
from shock_filter.core.then_sharpen import sharpen_both, then_sharpen

GEOMETRY = core.BeltramiGeometrySettings(repeat=1)
SIGNAL = core.BeltramiMeshSettings()
IMAGE = core.BeltramiSettings(iterations=1)


def noisy_cube(cells=12, noise=0.15):
    vertices, faces = cube(cells)
    return vertices, vertices + np.random.default_rng(0).normal(size=vertices.shape) * noise, faces


def tilt(vertices, faces):
    """Mean angle between the faces and the cube's sides, in degrees."""
    upright = abs(core.TriangleMesh(vertices, faces).normals).max(axis=1)
    return np.degrees(np.arccos(np.minimum(upright, 1.0))).mean()


def painted(vertices, noise=0.05):
    """Two colors that meet, with noise; and on which side each vertex lies."""
    right = vertices[:, 0] > 0.1
    colors = np.where(right[:, None], [0.8, 0.2, 0.1], [0.1, 0.3, 0.7])
    return colors + noise * np.random.default_rng(1).normal(size=colors.shape), right


def photo(noise=0.05):
    pixels = np.where(np.arange(40) < 20, 0.2, 0.8) * np.ones((30, 1))
    return pixels + noise * np.random.default_rng(2).normal(size=pixels.shape)


# ------------------------------------------------------------------------------------------ arrays


def joint(time):
    sharpening = find("beltrami_vertex_signal").sharpening(time)
    return then_sharpen(beltrami_joint_corners, sharpen_both, sharpening)


@pytest.mark.parametrize("name", ["denoise_geometry", "beltrami_vertex_signal", "beltrami_image"])
def test_a_time_is_checked_before_work_begins(name):
    assert find(name).function(None) is getattr(core, name)
    for time, reason in ((-1.0, "time is -1"), (float("nan"), "time is nan"), ("1", "a number")):
        with pytest.raises(core.InvalidSettings, match=reason):
            find(name).function(time)


@pytest.mark.parametrize("alpha", ["auto", "none"])
def test_opacity_of_an_image_stays_or_is_denoised_and_sharpened(alpha):
    image = np.repeat(photo(0.1)[..., None], 4, axis=2)
    settings = core.BeltramiSettings(iterations=1, alpha=alpha)
    smooth = core.beltrami_image(image, settings)
    sharp = core.sharpen_image(smooth, core.ImageSettings(time=64, alpha=alpha))
    result = find("beltrami_image").function(64.0)(image, settings=settings)
    np.testing.assert_array_equal(result, sharp)
    assert (result[..., 3] == image[..., 3]).all() == (alpha == "auto")
    mask = np.zeros(image.shape[:2])
    result = find("beltrami_image").function(64.0)(image, settings=settings, mask=mask)
    np.testing.assert_array_equal(result, image)


def test_sharpening_works_on_the_result():
    _, vertices, faces = noisy_cube(noise=0.6)
    mesh = core.TriangleMesh(vertices, faces)
    colors, _ = painted(vertices)
    close = np.testing.assert_allclose
    denoised = core.TriangleMesh(core.denoise_geometry(mesh, GEOMETRY), faces)
    settings = core.GeometrySettings(time=256)
    sharp = core.sharpen_geometry(denoised, settings)
    assert abs(sharp - denoised.vertices).max() > 0.001
    close(find("denoise_geometry").function(256.0)(mesh, settings=GEOMETRY), sharp, atol=1e-9)

    smooth = core.beltrami_vertex_signal(mesh, colors, SIGNAL)
    sharp = core.sharpen_vertex_signal(mesh, smooth, core.ShockSettings(time=64))
    assert abs(sharp - smooth).max() > 0.01
    function = find("beltrami_vertex_signal").function(64.0)
    close(function(mesh, colors, settings=SIGNAL), sharp, atol=1e-12)

    smooth = core.beltrami_corner_signal(mesh, colors[faces], SIGNAL)
    sharp = core.sharpen_corner_signal(mesh, smooth, core.ShockSettings(time=64))
    assert abs(sharp - smooth).max() > 0.01
    function = find("beltrami_vertex_signal").function(64.0, corners=True)
    close(function(mesh, colors[faces], settings=SIGNAL), sharp, atol=1e-12)

    smooth = core.beltrami_image(photo(0.1), IMAGE)
    sharp = core.sharpen_image(smooth, core.ImageSettings(time=64))
    assert abs(sharp - smooth).max() > 0.01
    close(find("beltrami_image").function(64.0)(photo(0.1), settings=IMAGE), sharp, atol=1e-12)


@pytest.mark.parametrize("turned", [False, True])
def test_both_are_those_of_the_vertices_where_corners_agree(turned):
    _, vertices, faces = noisy_cube()
    if turned:  # faces wound the other way are turned back, with their corners
        faces = faces.copy()
        faces[::3] = faces[::3, ::-1]
    mesh = core.TriangleMesh(vertices, faces)
    assert mesh.flipped.any() == turned
    colors, _ = painted(vertices)
    points, values = core.beltrami_joint(mesh, colors, SIGNAL)
    positions, corners = beltrami_joint_corners(mesh, colors[faces], SIGNAL)
    np.testing.assert_allclose(positions, points, atol=1e-9)
    np.testing.assert_allclose(corners, values[faces], atol=1e-9)
    both = joint(64.0)
    positions, corners = both(mesh, colors[faces], settings=SIGNAL)
    moved = core.TriangleMesh(positions, faces)
    sharp = core.sharpen_corner_signal(moved, values[faces], core.ShockSettings(time=64))
    np.testing.assert_allclose(corners, sharp, atol=1e-9)


def test_both_keep_jumps_and_move_their_vertices_as_one():
    vertices, faces = grid(10, 10)
    vertices[:, 2] = 0.1 * np.random.default_rng(3).normal(size=len(vertices))
    mesh = core.TriangleMesh(vertices, faces)
    centers = vertices[faces].mean(axis=1)[:, 0]
    corners = np.repeat((centers > 5).astype(float)[:, None], 3, axis=1)
    positions, values = beltrami_joint_corners(mesh, corners, SIGNAL)
    np.testing.assert_array_equal(values, corners)
    middle = slice(33, 88)
    assert abs(positions[middle, 2]).mean() < 0.6 * abs(vertices[middle, 2]).mean()
    assert positions.shape == vertices.shape


@pytest.mark.parametrize("sharpen_time", [None, 16.0])
def test_weight_zero_stays_bit_for_bit(sharpen_time):
    _, vertices, faces = noisy_cube()
    mesh = core.TriangleMesh(vertices, faces)
    colors, right = painted(vertices)
    mask = np.where(right, 1.0, 0.0)
    denoise = find("denoise_geometry").function(sharpen_time)
    positions = denoise(mesh, settings=GEOMETRY, mask=mask)
    np.testing.assert_array_equal(positions[~right], vertices[~right])
    assert (positions[right] != vertices[right]).any(axis=1).mean() > 0.9
    both = joint(sharpen_time)
    positions, corners = both(mesh, colors[faces], settings=SIGNAL, mask=mask)
    np.testing.assert_array_equal(positions[~right], vertices[~right])
    np.testing.assert_array_equal(corners[~right[faces]], colors[faces][~right[faces]])


@pytest.mark.parametrize("sharpen_time", [None, 16.0])
def test_weight_zero_keeps_the_sign_of_zero(sharpen_time):
    vertices, faces = grid(6, 6)
    vertices[:, 2] = -0.0
    mesh = core.TriangleMesh(vertices, faces)
    nothing = np.zeros(len(vertices))
    colors = np.random.default_rng(0).random((len(faces), 3))
    denoise = find("denoise_geometry").function(sharpen_time)
    positions = denoise(mesh, settings=GEOMETRY, mask=nothing)
    assert positions.tobytes() == vertices.tobytes()
    both = joint(sharpen_time)
    positions, _ = both(mesh, colors, settings=SIGNAL, mask=nothing)
    assert positions.tobytes() == vertices.tobytes()


@pytest.mark.parametrize("sharpen_time", [None, 64.0])
def test_progress_rises_to_one_and_cancels(sharpen_time):
    _, vertices, faces = noisy_cube()
    mesh = core.TriangleMesh(vertices, faces)
    colors, _ = painted(vertices)
    geometry = find("denoise_geometry").function(sharpen_time)
    both = joint(sharpen_time)
    image = find("beltrami_image").function(sharpen_time)
    runs = [
        lambda progress: geometry(mesh, settings=GEOMETRY, progress=progress),
        lambda progress: both(mesh, colors[faces], settings=SIGNAL, progress=progress),
        lambda progress: image(photo(), settings=IMAGE, progress=progress),
    ]
    for run in runs:
        seen = []

        def follow(fraction, message, seen=seen):
            seen.append((fraction, message))
            return True

        run(follow)
        fractions = [fraction for fraction, _ in seen]
        assert fractions == sorted(fractions)
        assert fractions[-1] == pytest.approx(1.0)
        assert (seen[-1][1] != seen[0][1]) or sharpen_time is None
        with pytest.raises(core.Cancelled):
            run(lambda fraction, message: fraction < 0.7)


# ------------------------------------------------------------------------------------------- files


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def write_ply(name, vertices, faces, colors=None, weight=None):
    kinds = ["x", "y", "z"]
    columns = [np.char.mod("%.9g", vertices)]
    header = [f"property float {kind}" for kind in kinds]
    if colors is not None:
        header += [f"property uchar {kind}" for kind in ("red", "green", "blue")]
        columns.append(np.char.mod("%d", np.rint(255 * np.clip(colors, 0, 1))))
    if weight is not None:
        header.append("property float weight")
        columns.append(np.char.mod("%g", weight[:, None]))
    rows = [" ".join(row) for row in np.concatenate(columns, axis=1)]
    rows += [f"3 {a} {b} {c}" for a, b, c in faces]
    start = ["ply", "format ascii 1.0", f"element vertex {len(vertices)}", *header]
    start += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header"]
    with open(name, "w") as file:
        file.write("\n".join([*start, *rows]) + "\n")


def read_ply(name):
    with open(name) as file:
        lines = file.read().split("end_header\n")[1].splitlines()
    rows = [line.split() for line in lines]
    return np.array([row for row in rows if row[0] != "3" or len(row) != 4], dtype=float)


def test_meshes_on_disk_lose_their_noise(folder):
    _, vertices, faces = noisy_cube(noise=0.6)
    colors, right = painted(vertices)
    write_ply("in.ply", vertices, faces, colors, right.astype(float))
    outcome = denoise_file("in.ply", "out.ply")
    after = read_ply("out.ply")
    assert tilt(after[:, :3], faces) < tilt(vertices, faces) / 3
    np.testing.assert_array_equal(after[:, 3:], read_ply("in.ply")[:, 3:])
    assert (outcome.total, outcome.changed) == (len(vertices), len(vertices))
    denoise_file("in.ply", "sharp.ply", sharpen_time=256.0)
    assert abs(read_ply("sharp.ply")[:, :3] - after[:, :3]).max() > 0.001
    denoise_file("in.ply", "half.ply", mask="weight")
    half = read_ply("half.ply")[:, :3]
    np.testing.assert_array_equal(half[~right], read_ply("in.ply")[~right, :3])
    assert (half[right] != vertices[right]).any()


def test_colors_on_disk_lose_their_noise(folder):
    vertices, _, faces = noisy_cube()
    colors, right = painted(vertices)
    write_ply("in.ply", vertices, faces, colors, right.astype(float))
    outcome = denoise_colors_file("in.ply", "out.ply")
    before, after = read_ply("in.ply"), read_ply("out.ply")
    np.testing.assert_array_equal(after[:, :3], before[:, :3])
    for side, far in ((right, vertices[:, 0] > 2), (~right, vertices[:, 0] < -2)):
        inner = side & far
        assert after[inner, 3:6].std(axis=0).max() < before[inner, 3:6].std(axis=0).max() / 2
    assert after[right, 3].min() - after[~right, 3].max() > 100
    assert outcome.total == len(vertices)
    denoise_colors_file("in.ply", "half.ply", mask="weight", invert_mask=True)
    np.testing.assert_array_equal(read_ply("half.ply")[right], before[right])


@pytest.mark.parametrize("kind", ["uint8", "uint16", "float16", "float32"])
def test_images_on_disk_lose_their_noise(folder, kind):
    largest = np.iinfo(kind).max if kind.startswith("uint") else 1
    pixels = (np.clip(photo(), 0, 1) * largest).astype(kind)
    np.save("in.npy", pixels)
    outcome = denoise_image_file("in.npy", "out.npy")
    after = np.load("out.npy")
    assert after.dtype == pixels.dtype
    assert after[:, :18].std() < pixels[:, :18].std() / 3
    assert (after[:, 20].astype(float) - after[:, 19]).min() > 0.45 * largest
    assert outcome.total == pixels.size
    assert outcome.changed > 0.9 * pixels.size
    mask = np.zeros(pixels.shape, dtype=np.uint8)
    mask[:, 20:] = 255
    np.save("mask.npy", mask)
    denoise_image_file("in.npy", "half.npy", mask="mask.npy", sharpen_time=16.0)
    half = np.load("half.npy")
    np.testing.assert_array_equal(half[:, :20], pixels[:, :20])
    assert (half[:, 20:] != pixels[:, 20:]).mean() > 0.9


def test_cancelling_leaves_no_file(folder):
    _, vertices, faces = noisy_cube()
    write_ply("in.ply", vertices, faces)
    with pytest.raises(core.Cancelled):
        denoise_file("in.ply", "out.ply", progress=lambda fraction, message: fraction < 0.3)
    assert [path.name for path in folder.iterdir()] == ["in.ply"]


# ------------------------------------------------------------------------------------ command line


class Recorder:
    """A backend that remembers what it was asked."""

    prog = "shock-filter"
    offered = cli.COMMANDS

    def __init__(self):
        self.asked = []

    def formats(self, command):
        return "any files"

    def add_arguments(self, parser, command):
        pass

    def filter(self, command, source, target, settings, options, progress):
        self.asked.append(options.then_sharpen)
        return Outcome(1, 1)


@pytest.mark.parametrize(
    ("command", "default"),
    [("denoise-geometry", 256.0), ("denoise-colors", 256.0), ("denoise-image", 16.0)],
)
def test_sharpening_may_follow_for_a_time(folder, command, default, capsys):
    recorder = Recorder()
    words = [[], ["--then-sharpen"], ["--then-sharpen", "64"], ["--then-sharpen=0"]]
    for number, more in enumerate(words):
        assert cli.main([command, "a.ply", f"{number}.ply", *more], recorder) == 0
    assert recorder.asked == [None, default, 64, 0]
    for more, sentence in (
        (["--then-sharpen", "b.ply"], "'b.ply' is no time; give one, or --then-sharpen after OUT"),
        (["--then-sharpen", "inf"], "must be finite"),
        (["--then-sharpen=-1"], "time is -1; give a value from 0"),
    ):
        with pytest.raises(SystemExit) as stop:
            cli.main([command, "a.ply", "c.ply", *more], recorder)
        assert stop.value.code == 2
        assert sentence in capsys.readouterr().err
    assert len(recorder.asked) == 4
    with pytest.raises(SystemExit):
        cli.main(["sharpen-image", "a.png", "b.png", "--then-sharpen"], recorder)


def test_the_commands_do_what_the_functions_do(folder, capsys):
    _, vertices, faces = noisy_cube(8)
    colors, right = painted(vertices)
    write_ply("in.ply", vertices, faces, colors, right.astype(float))
    flags = ["--repeat", "2", "--mask", "weight", "--invert-mask", "--then-sharpen", "16"]
    assert cli.main(["denoise-geometry", "in.ply", "a.ply", *flags]) == 0
    settings = core.BeltramiGeometrySettings(repeat=2)
    words = {"mask": "weight", "invert_mask": True, "sharpen_time": 16}
    denoise_file("in.ply", "b.ply", settings, **words)
    np.testing.assert_array_equal(read_ply("a.ply"), read_ply("b.ply"))
    assert "in.ply -> a.ply: moved " in capsys.readouterr().out

    assert cli.main(["denoise-colors", "in.ply", "c.ply", "--beta", "5", "--then-sharpen"]) == 0
    denoise_colors_file("in.ply", "d.ply", core.BeltramiMeshSettings(beta=5), sharpen_time=256)
    np.testing.assert_array_equal(read_ply("c.ply"), read_ply("d.ply"))
    assert (read_ply("c.ply")[:, 3:6] != read_ply("in.ply")[:, 3:6]).any()

    Image.fromarray(np.rint(255 * np.clip(photo(), 0, 1)).astype(np.uint8)).save("in.png")
    assert cli.main(["denoise-image", "in.png", "a.png", "--beta", "8", "--then-sharpen"]) == 0
    denoise_image_file("in.png", "b.png", core.BeltramiSettings(beta=8), sharpen_time=16)
    a, b, old = (np.array(Image.open(name)) for name in ("a.png", "b.png", "in.png"))
    np.testing.assert_array_equal(a, b)
    assert a[:, :18].std() < old[:, :18].std() / 2


def test_bad_input_fails_with_a_sentence(folder, capsys):
    vertices, _, faces = noisy_cube(4)
    write_ply("in.ply", vertices, faces)
    assert cli.main(["denoise-colors", "in.ply", "out.ply"]) == 1
    assert "in.ply has no vertex colors; paint them" in capsys.readouterr().err
    assert cli.main(["denoise-geometry", "in.ply", "out.ply", "--mask", "weight"]) == 1
    assert "no vertex property 'weight'" in capsys.readouterr().err
    np.save("bad.npy", np.full((4, 4), np.nan, dtype=np.float32))
    assert cli.main(["denoise-image", "bad.npy", "out.npy"]) == 1
    assert "NaN or infinity" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        cli.main(["denoise-image", "bad.npy", "out.npy", "--window", "4"])
    assert "--window is no flag any more: the time alone says" in capsys.readouterr().err
    assert sorted(path.name for path in folder.iterdir()) == ["bad.npy", "in.ply"]


@pytest.mark.parametrize("top", [[0.5, 0.5, 1.0], [0.3, 0.4, 0.2]])
def test_solids_of_few_faces_come_out(top):
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], top])
    faces = [[0, 2, 1], [0, 3, 2], [0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]]
    mesh = core.TriangleMesh(vertices, faces)
    for strength in (0.001, 1.0):
        found = core.denoise_geometry(mesh, core.BeltramiGeometrySettings(strength=strength))
        assert core.TriangleMesh(found, faces).areas.max() > 0
