# SPDX-License-Identifier: GPL-3.0-or-later
"""The command visualize-flow: from files of velocities to files of frames."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from shock_filter import core
from shock_filter.core import cli
from shock_filter.core.advection import pictures
from shock_filter.core.files import flows
from shock_filter.core.files.image_formats import read_pixels
from test_velocities import square

H, W = 24, 36


def vortex(shape=(H, W)):
    """Turn round the middle, the faster the farther from it."""
    rows, columns = shape
    y, x = np.mgrid[1 : -1 : rows * 1j, -1 : 1 : columns * 1j]
    return np.stack([-y, x], axis=-1).astype(np.float32)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    np.save("field.npy", vortex())
    return tmp_path


def visualize(*words):
    return cli.main(["visualize-flow", *map(str, words)])


def frames(name):
    return [read_pixels(path, False) for path in sorted(Path(name).iterdir())]


def numbers(frame):
    return np.floor(np.clip(frame, 0, 1) * np.float32(255) + np.float32(0.5)).astype(np.uint8)


def test_a_folder_gets_the_frames_of_the_core(folder, capsys):
    words = ["--frames", 4, "--step", 3, "--seed", 7, "--blending", 0.2]
    assert visualize("field.npy", "out", *words) == cli.DONE
    settings = core.NoiseSettings(step=3, seed=7, blending=0.2)
    wanted = core.advect_noise(vortex(), settings, frames=4)
    for entry, frame in zip(sorted(os.listdir("out")), wanted, strict=True):
        np.testing.assert_array_equal(np.array(Image.open(f"out/{entry}")), numbers(frame))
    assert "field.npy -> out: 4 frames of 36 x 24 pixels in" in capsys.readouterr().out


@pytest.mark.parametrize("name", ["take.v2/", "a.png/"])
def test_a_name_that_ends_in_a_slash_is_a_folder(folder, name, capsys):
    assert visualize("field.npy", name, "--frames", 2) == cli.DONE
    assert sorted(os.listdir(name)) == ["frame_0001.png", "frame_0002.png"]
    Path("file").write_text("")
    with pytest.raises(SystemExit):
        visualize("field.npy", "file/", "--frames", 2)
    assert "Cannot make the folder file (" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["a.webp", "a.png", "a.apng"])
def test_one_file_gets_them_all(folder, name):
    words = ["--frames", 3, "--size", "40x20", "--fps", 10, "--quiet"]
    assert visualize("field.npy", name, *words) == cli.DONE
    with Image.open(name) as image:
        image.load()
        assert (image.n_frames, image.size, image.info["duration"]) == (3, (40, 20), 100)


def test_lines_are_one_picture(folder, capsys):
    assert visualize("field.npy", "lines.tif", "--kind", "lines", "--length", 8) == cli.DONE
    wanted = core.line_integral_convolution(vortex(), settings=core.ConvolutionSettings(length=8))
    np.testing.assert_array_equal(read_pixels("lines.tif", False), numbers(wanted))
    assert visualize("field.npy", "lines", "--kind", "lines") == cli.FAILED
    assert "lines are a still picture; name an image" in capsys.readouterr().err


def test_dye_comes_from_where_it_is_told(folder):
    words = ["--kind", "dye", "--frames", 2, "--source", "0.75,0.25", "--source-width", 6]
    assert visualize("field.npy", "out", *words) == cli.DONE
    first = np.array(Image.open("out/frame_0001.png"))
    assert first.shape == (H, W, 4)
    row, column = np.argwhere(first[..., 3] > 0).mean(axis=0)
    assert abs(row - 0.75 * H) < 1.5 and abs(column - 0.75 * W) < 1.5
    assert visualize("field.npy", "over", *words, "--over-noise", "--quiet") == cli.DONE
    assert (np.array(Image.open("over/frame_0001.png"))[..., 3] == 255).all()


def test_spots_of_dye_repeat_with_a_loop(folder, capsys):
    words = ["--kind", "dye", "--loop", 4, "--quiet"]
    assert visualize("field.npy", "out", *words, "--frames", 20) == cli.DONE
    assert visualize("field.npy", "odd", *words, "--frames", 21) == cli.FAILED
    assert "21 frames, and 2 colors of dye do not come out even" in capsys.readouterr().err
    assert [pictures.releases_in(count, 2) for count in (20, 96, 100, 2)] == [10, 24, 10, 1]


def test_a_background_shows_where_the_flow_is_slow(folder):
    picture = np.random.default_rng(0).integers(0, 256, (H, W, 3), dtype=np.uint8)
    Image.fromarray(picture).save("behind.png")
    np.save("still.npy", np.full((3, 3, 2), np.nan))  # undefined everywhere
    words = ["--frames", 1, "--background", "behind.png"]
    assert visualize("still.npy", "out", *words) == cli.DONE  # of the background's size
    np.testing.assert_array_equal(np.array(Image.open("out/frame_0001.png")), picture)


def test_colors_say_how_fast_it_is(folder):
    assert visualize("field.npy", "out", "--frames", 1, "--colors") == cli.DONE
    shown = np.array(Image.open("out/frame_0001.png")).astype(float)
    assert shown.shape == (H, W, 3)
    speed = np.hypot(*np.moveaxis(vortex(), -1, 0))
    slow, fast = shown[speed < 0.3].mean(axis=0), shown[speed > 1.0].mean(axis=0)
    assert slow[2] > slow[0] and fast[0] > fast[2]


def test_a_flow_map_and_its_array_give_the_same(folder):
    values = np.dstack([vortex(), np.zeros((H, W))])
    Image.fromarray(np.rint(128 + 127 * values).astype(np.uint8)).save("map.png")
    np.save("array.npy", (np.rint(127 * vortex()) / 127).astype(np.float32))
    for name, target in (("map.png", "map"), ("array.npy", "array")):
        assert visualize(name, target, "--frames", 3, "--quiet") == cli.DONE
    for one, other in zip(frames("map"), frames("array"), strict=True):
        np.testing.assert_array_equal(one, other)
    assert visualize("map.png", "down", "--frames", 3, "--y-axis", "down", "--quiet") == cli.DONE
    assert (frames("down")[2] != frames("map")[2]).any()


def test_a_mesh_gives_a_texture_of_its_surface(folder, capsys):
    path = square(folder / "mesh.ply", "flow_x", "flow_y", "flow_z")
    assert visualize(path, "none") == cli.FAILED
    assert "A texture needs a size; add one such as --size" in capsys.readouterr().err
    assert visualize(path, "out", "--size", "32x32", "--frames", 3) == cli.DONE
    field = 0.5 * np.outer(np.arange(1, 5), np.arange(1, 4))
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=float)
    mesh = core.TriangleMesh(corners, [[0, 1, 2], [0, 2, 3]])
    uv = corners[mesh.faces][..., :2]
    wanted = core.advect_on_surface(mesh, uv, field, size=(32, 32), frames=3)
    for found, frame in zip(frames("out"), wanted, strict=True):
        np.testing.assert_array_equal(found, numbers(frame)[::-1])
    words = ["--size", "32x32", "--kind", "dye"]
    assert visualize(path, "dye", *words) == cli.FAILED
    assert "On a mesh flows are shown as noise" in capsys.readouterr().err


def test_key_frames_move_at_once(folder):
    np.save("moving.npy", np.stack([vortex(), -vortex()]))
    assert visualize("moving.npy", "out", "--frames", 9, "--quiet") == cli.DONE
    wanted = list(core.advect_noise(np.stack([vortex(), -vortex()]), frames=9))
    np.testing.assert_array_equal(frames("out")[8], numbers(wanted[8]))


@pytest.mark.parametrize(
    "words, sentence",
    [
        (["--length", "5"], "--length is of --kind lines; leave it out"),
        (["--kind", "dye", "--blending", "0.5"], "--blending is of --kind noise"),
        (["--kind", "lines", "--sharpness", "1"], "--sharpness is of --kind dye"),
        (["--source", "0.5,0.5"], "--source is of --kind dye"),
        (["--kind", "dye", "--colors"], "--colors is of --kind noise"),
        (["--kind", "lines", "--background", "a.png"], "lines have no background"),
        (["--blending", "7"], "blending is 7; give a value from 0.005 to 1"),
        (["--kind", "dye", "--source", "1,2,3"], "invalid place, such as 0.5,0.5 value"),
        (["--select", "depth"], "invalid choice, such as depth=0 value"),
        (["--size", "32"], "invalid size, such as 1024x512 value"),
    ],
)
def test_what_does_not_fit_is_a_usage_error(folder, capsys, words, sentence):
    with pytest.raises(SystemExit) as stop:
        visualize("field.npy", "out", *words)
    assert stop.value.code == 2
    assert sentence in capsys.readouterr().err
    assert not os.path.exists("out")


def test_targets_are_checked_before_anything_is_read(folder, capsys):
    os.mkdir("full")
    (folder / "full" / "mine.txt").write_text("")
    for target, sentence in (("full", "is not empty; add --overwrite"), ("a.gif", "name a folder")):
        assert visualize("no such file.npy", target) == cli.FAILED
        assert sentence in capsys.readouterr().err
    assert visualize("field.npy", "full", "--overwrite", "--frames", 1, "--quiet") == cli.DONE
    assert sorted(os.listdir("full")) == ["frame_0001.png", "mine.txt"]


@pytest.mark.parametrize(
    "velocity, sentence",
    [
        (np.full((4, 4, 2), np.inf), "infinity or values beyond 1e30"),
        (np.full((4, 4, 2), 2000.0), "give at most 1000"),
        (np.array([["a"]]), "holds values of type <U1; save real numbers"),
        (np.zeros((4, 4)), "has the shape"),
    ],
)
def test_velocities_that_cannot_be_used_are_named(folder, capsys, velocity, sentence):
    np.save("bad.npy", velocity)
    assert visualize("bad.npy", "out", "--step", 0) == cli.FAILED
    assert sentence in capsys.readouterr().err


def test_still_and_tiny_flows_are_shown(folder):
    for number, velocity in enumerate((np.zeros((5, 6, 2)), np.ones((1, 1, 2)))):
        np.save("a.npy", velocity)
        assert visualize("a.npy", f"out{number}", "--frames", 2, "--quiet") == cli.DONE
        assert len(os.listdir(f"out{number}")) == 2


INTERRUPTED = """
import os, signal, sys
from shock_filter.core import cli
from shock_filter.core.files import frames
encoded, count = frames.encoded_png, iter(range(99))
def encode(pixels):
    if next(count) == 2:
        os.kill(os.getpid(), signal.SIGINT)
    return encoded(pixels)
frames.encoded_png = encode
sys.exit(cli.main(["visualize-flow", "field.npy", "out", "--frames", "50"]))
"""


def test_an_interrupt_keeps_the_frames_that_are_done(folder):
    run = subprocess.run(
        [sys.executable, "-c", INTERRUPTED], capture_output=True, text=True, timeout=120
    )
    assert run.returncode == cli.INTERRUPTED, run.stderr
    assert "Interrupted; 3 of 50 frames are in out." in run.stderr
    assert sorted(os.listdir("out")) == [f"frame_000{number}.png" for number in (1, 2, 3)]


def test_frames_are_drawn_as_they_are_written(folder, monkeypatch):
    made = []

    def counted(*words, **more):
        for frame in drawn(*words, **more):
            made.append(len(os.listdir("out")))
            yield frame

    drawn = flows.pictures_of_plane
    monkeypatch.setattr(flows, "pictures_of_plane", counted)
    assert visualize("field.npy", "out", "--frames", 4, "--quiet") == cli.DONE
    assert made == [1, 2, 3, 4]  # with the folder in which one is written
