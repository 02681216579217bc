# SPDX-License-Identifier: GPL-3.0-or-later
"""``--resume``: what is made already is skipped, and what would be another result is made again."""

import os
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from shock_filter.core import cli
from shock_filter.core.cli import records

NAMES = ("a", "b", "c")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Images in a folder, and a mask."""
    monkeypatch.chdir(tmp_path)
    Path("in").mkdir()
    for number, name in enumerate((*NAMES, "../mask")):
        pixels = np.random.default_rng(number).integers(0, 256, (8, 8), np.uint8)
        Image.fromarray(pixels).save(f"in/{name}.png")
    return tmp_path


def sharpen(*words):
    given = ["--mask", "mask.png", "--time", "4", "--resume", *words]
    return cli.main(["sharpen-image", "in/*.png", "out/", *given])


@pytest.fixture
def made(folder, capsys):
    """All outputs, and a function that says which a run has made anew."""
    assert sharpen() == 0

    def made_by(*words):
        capsys.readouterr()
        times = {name: stamp(name) for name in NAMES}
        code = sharpen(*words)
        return code, [name for name in NAMES if stamp(name) != times[name]]

    return made_by


def stamp(name):
    path = Path(f"out/{name}.png")
    return path.stat().st_ino if path.exists() else None


def record(name):
    (found,) = [
        path for path in Path("out/.shock-filter").iterdir() if f'"{name}.png"' in path.read_text()
    ]
    return found


def test_what_is_done_is_skipped(made, capsys):
    assert made() == (0, [])
    assert capsys.readouterr() == ("Skipped, as they are done already: 3\n", "")
    assert made("--quiet") == (0, [])
    assert capsys.readouterr() == ("", "")


def test_only_what_is_missing_is_made(made):
    Path("out/b.png").unlink()
    assert made() == (0, ["b"])
    assert made() == (0, [])


def test_other_settings_make_all_again(made):
    assert made("--time", "5") == (0, list(NAMES))
    assert made("--time", "5") == (0, [])
    assert made("--invert-mask") == (0, list(NAMES))


def test_another_version_makes_all_again(made, monkeypatch):
    monkeypatch.setattr(records, "__version__", "9.8.7")
    assert made() == (0, list(NAMES))


def test_an_input_that_has_changed_is_made_again(made):
    Image.open("in/a.png").rotate(90).save("in/b.png")
    assert made() == (0, ["b"])
    os.utime("in/c.png", (1, 1))  # another one, though it is older than the output
    assert made() == (0, ["c"])


def test_another_mask_under_the_same_name_makes_all_again(made):
    Image.open("mask.png").rotate(90).save("mask.png")
    assert made() == (0, list(NAMES))


def test_the_folder_that_a_run_is_started_in_changes_nothing(made, folder, monkeypatch):
    (folder / "deeper").mkdir()
    monkeypatch.chdir(folder / "deeper")
    words = ["../in/*.png", "../out/", "--mask", "../mask.png", "--time", "4", "--resume"]
    before = os.stat("../out/a.png").st_ino
    assert cli.main(["sharpen-image", *words]) == 0
    assert os.stat("../out/a.png").st_ino == before


@pytest.mark.parametrize("damage", [b"", b"{", b"[]", b"\xff\xfe", b'{"made": 1}' * 2])
def test_a_damaged_record_costs_time_only(made, damage):
    record("b").write_bytes(damage)
    assert made() == (0, ["b"])
    assert made() == (0, [])


def test_a_lost_record_is_no_leave_to_overwrite(made, capsys):
    record("b").unlink()
    assert made() == (1, [])
    assert "b.png exists already; add --overwrite" in capsys.readouterr().err
    assert made("--overwrite") == (0, ["b"])
    assert made("--overwrite") == (0, [])


def test_an_output_that_somebody_has_changed_stays(made, capsys):
    Path("out/b.png").write_text("mine")
    assert made("--time", "5") == (1, ["a", "c"])
    assert "b.png exists already; add --overwrite" in capsys.readouterr().err
    assert Path("out/b.png").read_text() == "mine"


@pytest.mark.parametrize("words", [["--resume"], ["--cluster", "local"]])
def test_no_file_is_filtered_into_itself(folder, capsys, words):
    """Nobody could tell whether it is done."""
    with pytest.raises(SystemExit) as stop:
        cli.main(["sharpen-image", "in/*.png", "in/../in", "--overwrite", *words])
    assert stop.value.code == 2
    assert "in/a.png would replace itself" in capsys.readouterr().err.replace("\\", "/")


def test_runs_without_it_leave_no_records(folder):
    assert cli.main(["sharpen-image", "in/*.png", "out/", "--time", "4"]) == 0
    assert sorted(os.listdir("out")) == ["a.png", "b.png", "c.png"]


def test_what_fails_has_no_record_and_is_tried_again(folder, capsys):
    whole = Path("in/b.png").read_bytes()
    Path("in/b.png").write_bytes(whole[:50])
    assert sharpen() == 1
    left = sorted(path.suffix for path in Path("out/.shock-filter").iterdir())
    assert left == ["", ".json", ".json"]  # the lock, and nothing else
    Path("in/b.png").write_bytes(whole)
    assert sharpen() == 0
    assert sorted(os.listdir("out")) == [".shock-filter", "a.png", "b.png", "c.png"]


def test_frames_in_a_folder_are_one_output(folder, capsys):
    np.save("flow.npy", np.ones((4, 4, 2)))
    words = ["visualize-flow", "flow.npy", "frames", "--frames", "2", "--resume"]
    assert cli.main(words) == 0
    before = os.stat("frames/frame_0001.png").st_ino
    assert cli.main(words) == 0
    assert os.stat("frames/frame_0001.png").st_ino == before
    Path("frames/frame_0002.png").unlink()
    assert cli.main(words) == 1
    assert "frames is not empty; add --overwrite" in capsys.readouterr().err
    assert cli.main([*words, "--overwrite"]) == 0
    assert len(os.listdir("frames")) == 2


# ------------------------------------------------------------------------ several files of an input

SHEET = """
v 0 0 0
v 1 0 0
v 0 1 0
v 1 1 0.5
vt 0 0
vt 1 0
vt 0 1
vt 1 1
f 1/1 2/2 4/4 3/3
"""


def bake(*words):
    if not Path("part.obj").exists():
        Path("part.obj").write_text(SHEET)
    given = ["--rays", "2", "--size", "8x8", "--map", "occlusion", "thickness"]
    return cli.main(["bake-maps", "part.obj", "part.npy", *given, *words])


def test_each_of_several_maps_must_be_there(folder, capsys):
    assert bake("--resume") == 0
    for name in ("part_thickness.npy", "part_ao.npy"):
        Path(name).unlink()
        assert bake("--resume") == 0
        assert Path(name).exists()
        capsys.readouterr()
        assert bake("--resume") == 0
        assert "Skipped, as they are done already: 1" in capsys.readouterr().out
    assert bake("--resume", "--rays", "3") == 0  # all are ours


@pytest.mark.parametrize("name", ["part_ao.npy", "part_thickness.npy"])
def test_a_map_of_several_that_somebody_has_changed_stays(folder, capsys, name):
    assert bake("--resume") == 0
    Path(name).write_text("mine")
    assert bake("--resume") == 1
    assert f"{name} exists already; add --overwrite" in capsys.readouterr().err
    assert Path(name).read_text() == "mine"
    assert bake("--resume", "--overwrite") == 0
    assert bake("--resume") == 0
    assert "Skipped" in capsys.readouterr().out


def tile(*words):
    given = ["--picture", "seen/tiles.png", "--resume", *words]
    return cli.main(["make-tileable", "in/[ab].png", "out/", *given])


def test_pictures_are_outputs_as_well(folder, capsys):
    Path("seen").mkdir()
    assert tile() == 0
    assert capsys.readouterr().err == ""
    pictures = ["a.png tiles.png", "b.png tiles.png"]
    assert sorted(os.listdir("seen")) == [".shock-filter", *pictures]
    assert tile() == 0
    assert "Skipped, as they are done already: 2" in capsys.readouterr().out
    Path("seen", pictures[0]).unlink()
    Path("seen", pictures[1]).write_text("mine")
    assert tile() == 1
    assert "b.png tiles.png exists already; add --overwrite" in capsys.readouterr().err
    assert Path("seen", pictures[0]).exists()
    assert Path("seen", pictures[1]).read_text() == "mine"
    assert tile("--overwrite") == tile() == 0
    assert "Skipped, as they are done already: 2" in capsys.readouterr().out
