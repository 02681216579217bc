# SPDX-License-Identifier: GPL-3.0-or-later
"""Frames on disk: folders of PNG, animated WebP and PNG, videos."""

import errno
import re
import subprocess
import sys
import tracemalloc

import numpy as np
import pytest
from PIL import Image
from shock_filter import core
from shock_filter.core.files import frames as files
from shock_filter.core.files.frames import write_frames
from shock_filter.core.files.image_formats import read_pixels
from shock_filter.core.files.output import Unfinished


def grays(count=5, size=(6, 9)):
    """Yield gray frames, each brighter than the one before."""
    ramp = np.linspace(0.0, 0.5, size[0] * size[1]).reshape(size)
    for number in range(count):
        yield (ramp + 0.5 * number / count).astype(np.float32)


def colors(count=5, size=(6, 9), channels=4):
    """Yield frames of colors."""
    for gray in grays(count, size):
        yield np.stack([gray, 1 - gray, gray**2, 0.5 + 0.5 * gray], axis=-1)[..., :channels]


def read(path):
    """Read all frames of an animation, with how long each is seen."""
    found, times = [], []
    with Image.open(path) as image:
        for number in range(image.n_frames):
            image.seek(number)
            image.load()
            times.append(image.info["duration"])
            found.append(np.array(image))
        assert image.info["loop"] == 0
    return found, times


@pytest.mark.parametrize("bits", [8, 16])
@pytest.mark.parametrize("make", [grays, colors])
def test_a_folder_holds_numbered_frames(tmp_path, bits, make):
    target = tmp_path / "new" / "frames"
    assert write_frames(make(), target, 5, bits=bits) == 5
    names = [f"frame_000{number}.png" for number in range(1, 6)]
    assert sorted(path.name for path in target.iterdir()) == names
    for name, frame in zip(names, make(), strict=True):
        pixels = read_pixels(target / name, False)
        assert pixels.dtype.itemsize == bits // 8
        assert np.abs(pixels - frame * np.float64(2**bits - 1)).max() < 0.51


def test_names_have_digits_enough(tmp_path):
    assert files.frame_name(7, 9999) == "frame_0007.png"
    assert files.frame_name(7, 10000) == "frame_00007.png"


@pytest.mark.parametrize("ending", [".png", ".apng"])
@pytest.mark.parametrize("make", [grays, colors])
def test_animated_png_keeps_all_values(tmp_path, ending, make):
    target = tmp_path / f"moving{ending}"
    write_frames(make(), target, 5, fps=24.0)
    found, times = read(target)
    assert times == pytest.approx([1000 / 24] * 5, abs=0.01)
    for pixels, frame in zip(found, make(), strict=True):
        assert np.abs(pixels - frame * np.float64(255)).max() < 0.51


def test_animated_webp_shows_the_frames_at_the_right_speed(tmp_path):
    write_frames(colors(size=(30, 41)), tmp_path / "moving.webp", 5, fps=24.0)
    found, times = read(tmp_path / "moving.webp")
    assert sum(times) == round(5000 / 24)
    for pixels, frame in zip(found, colors(size=(30, 41)), strict=True):
        assert np.abs(pixels / 255 - frame).mean() < 0.02
    write_frames(grays(size=(31, 40)), tmp_path / "gray.webp", 5)
    found, _ = read(tmp_path / "gray.webp")
    for pixels, frame in zip(found, grays(size=(31, 40)), strict=True):
        assert np.abs(pixels[..., :3].mean(axis=2) / 255 - frame).mean() < 0.02


def test_mp4_plays_all_frames(tmp_path):
    ffmpeg = pytest.importorskip("imageio_ffmpeg").get_ffmpeg_exe()
    target = tmp_path / "moving.mp4"
    write_frames(colors(7, (31, 45)), target, 7, fps=10.0)
    command = [ffmpeg, "-i", target, "-f", "rawvideo", "-pix_fmt", "rgb24", "-"]
    run = subprocess.run(command, capture_output=True, timeout=60)
    assert b"46x32" in run.stderr and b"10 fps" in run.stderr
    found = np.frombuffer(run.stdout, np.uint8).reshape(7, 32, 46, 3)
    for pixels, frame in zip(found, colors(7, (31, 45)), strict=True):
        wanted = frame[..., :3] * frame[..., 3:]
        assert np.abs(pixels[:31, :45] / 255 - wanted).mean() < 0.05


def test_what_ffmpeg_says_is_passed_on(tmp_path, monkeypatch):
    ffmpeg = pytest.importorskip("imageio_ffmpeg")
    monkeypatch.setattr(ffmpeg, "get_ffmpeg_exe", lambda: "false")
    with pytest.raises(core.ShockError, match="could not be encoded"):
        write_frames(grays(50, (300, 300)), tmp_path / "moving.mp4", 50)
    assert not list(tmp_path.iterdir())


def test_a_missing_package_is_named_with_its_extra(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(core.ShockError, match=re.escape("pip install 'shock-filter[video]'")):
        write_frames(grays(), tmp_path / "moving.mp4", 5)
    assert not list(tmp_path.iterdir())


def cancelled(after):
    """Yield some frames and be cancelled then."""
    yield from grays(after)
    raise core.Cancelled("stop")


def test_a_folder_keeps_the_frames_that_are_done(tmp_path):
    with pytest.raises(Unfinished, match=r"3 of 9 frames are in .*frames") as stopped:
        write_frames(cancelled(3), tmp_path / "frames", 9)
    assert isinstance(stopped.value, core.Cancelled)
    names = sorted(path.name for path in (tmp_path / "frames").iterdir())
    assert names == ["frame_0001.png", "frame_0002.png", "frame_0003.png"]


@pytest.mark.parametrize("name", ["a.webp", "a.png", "a.mp4"])
def test_nothing_of_a_file_is_left_when_it_is_cancelled(tmp_path, name):
    if name == "a.mp4":
        pytest.importorskip("imageio_ffmpeg")
    target = tmp_path / name
    target.write_bytes(b"what was there")
    with pytest.raises(core.Cancelled):
        write_frames(cancelled(3), target, 9, overwrite=True)
    assert [path.name for path in tmp_path.iterdir()] == [name]
    assert target.read_bytes() == b"what was there"


def test_a_full_disk_keeps_whole_frames(tmp_path, monkeypatch):
    encoded, count = files.encoded_png, iter(range(9))

    def encode(pixels):
        if next(count) == 2:
            raise OSError(errno.ENOSPC, "No space left on device")
        return encoded(pixels)

    monkeypatch.setattr(files, "encoded_png", encode)
    with pytest.raises(core.ShockError, match="is full"):
        write_frames(grays(), tmp_path / "frames", 5)
    names = sorted(path.name for path in (tmp_path / "frames").iterdir())
    assert names == ["frame_0001.png", "frame_0002.png"]


def test_a_folder_that_is_not_empty_is_left_alone_unless_asked(tmp_path):
    other = tmp_path / "notes.txt"
    other.write_text("mine")
    with pytest.raises(core.ShockError, match="not empty; add --overwrite"):
        write_frames(grays(), tmp_path, 5)
    assert list(tmp_path.iterdir()) == [other]
    write_frames(grays(9), tmp_path, 9, overwrite=True)
    write_frames(grays(3), tmp_path, 3, overwrite=True)
    assert len(list(tmp_path.glob("frame_*.png"))) == 3  # those of the longer run are gone
    assert other.read_text() == "mine"


def test_wrong_targets_are_refused_before_anything_is_computed(tmp_path):
    def never():
        raise AssertionError
        yield

    (tmp_path / "file").write_text("")
    (tmp_path / "a.webp").write_text("")
    for name, words, options in (
        ("a.gif", "use one of .webp", {}),
        ("a.webp", "exists already", {}),
        ("file", "is a file; name a folder", {}),
        ("b.webp", "fps is 0", {"fps": 0.0}),
        ("frames", "bits is 12", {"bits": 12}),
        ("b.webp", "holds 8 bits", {"bits": 16}),
    ):
        with pytest.raises(core.ShockError, match=words):
            write_frames(never(), tmp_path / name, 5, **options)


def test_frames_that_are_not_numbers_are_dark(tmp_path):
    frame = np.array([[np.nan, 2.0], [-1.0, 0.5]], dtype=np.float32)
    np.testing.assert_array_equal(files.as_numbers(frame, 8), [[0, 255], [0, 128]])


def test_frames_are_put_away_whatever_happens(tmp_path):
    for target in ("frames", "a.webp"):
        made = cancelled(1)
        with pytest.raises(core.Cancelled):
            write_frames(made, tmp_path / target, 9)
        assert made.gi_frame is None


def test_memory_does_not_grow_with_the_number_of_frames(tmp_path):
    most = {}
    for name in ("frames", "a.png", "a.webp"):
        for count in (3, 40):
            tracemalloc.start()
            write_frames(grays(count, (100, 120)), tmp_path / name, count, overwrite=True)
            most[count] = tracemalloc.get_traced_memory()[1]
            tracemalloc.stop()
        assert most[40] < most[3] + 60_000


def test_another_program_reads_the_video(tmp_path):
    ffmpeg = pytest.importorskip("imageio_ffmpeg").get_ffmpeg_exe()
    write_frames(grays(4, (32, 32)), tmp_path / "a.png", 4)
    command = [ffmpeg, "-v", "error", "-i", tmp_path / "a.png", "-f", "null", "-"]
    run = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert (run.returncode, run.stderr) == (0, "")
