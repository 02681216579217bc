# SPDX-License-Identifier: GPL-3.0-or-later
"""All writing goes through the stage, and no name in a file leads out of it."""

import json
import os
import socket
import sys
import threading
from pathlib import Path
from urllib.parse import quote

import numpy as np
import pytest
import trimesh
from PIL import Image
from shock_filter import core
from shock_filter.core import cli
from shock_filter.core.files import frames, images, meshes, output, staging
from shock_filter.core.files.formats.mesh.trimesh import ENDINGS
from shock_filter.core.files.images import filter_image_file, write_image_file
from shock_filter.core.files.meshes import filter_mesh_file
from shock_filter.core.files.output import Options, staged, staged_folder
from test_written_files import CORNERS, OBJ, TRIANGLE, gltf, lift, positions
from zarr import open_array

needs_links = pytest.mark.skipif(sys.platform == "win32", reason="links need rights on Windows")
OVERWRITE = Options(overwrite=True)


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("in", "out", "elsewhere"):
        (tmp_path / name).mkdir()
    return tmp_path


def snapshot(folder):
    """All files and links below a folder, with what they hold."""
    return {
        str(path.relative_to(folder)): (
            os.readlink(path) if path.is_symlink() else path.is_file() and path.read_bytes()
        )
        for path in folder.rglob("*")
    }


# ------------------------------------------------------------------------------------------ names

HOSTILE = [
    "{root}/victim",
    "{root}/in/../victim",
    "../victim",
    "..\\victim",
    "sub/../../victim",
    "%2e%2e/victim",
    "%2e%2e%2fvictim",
    "C:\\victim",
    "\\\\host\\share\\victim",
    "file://{root}/victim",
    "file:../victim",
    "link/victim",
    "victim\0.bin",
    "",
    ".",
    "/",
]


@pytest.mark.parametrize("name", [name for name in HOSTILE if not name.startswith(("%", "file:"))])
@needs_links
def test_no_name_leads_out_of_a_stage(folder, name):
    (folder / "out/link").symlink_to(folder / "elsewhere")
    with pytest.raises(core.ShockError, match="leads to another folder"):
        staging.within(folder / "out", name.format(root=folder))
    assert not list((folder / "elsewhere").iterdir())


def test_two_files_of_one_name_are_refused(folder):
    staging.within(folder, "sub/a.bin").write_bytes(b"a")
    for name in ("sub/a.bin", "sub\\a.bin", "sub/a.bin/b", "./sub//a.bin"):
        with pytest.raises(core.ShockError, match="Two files would be written to sub/a"):
            staging.within(folder, name)


def named_obj(folder, name):
    folder.joinpath("m.obj").write_text(OBJ.format(name) + "mtllib good.mtl\n")
    folder.joinpath("good.mtl").write_text(f"newmtl paint\nmap_Kd {name}\nbump -bm 1 {name}\n")


def named_ply(folder, name):
    rows = [
        *map(" ".join, TRIANGLE.astype(str)),
        *(f"3 {a} {b} {c}" for a, b, c in CORNERS.reshape(-1, 3)),
    ]
    head = f"ply\nformat ascii 1.0\ncomment TextureFile {name}\nelement vertex 4\n"
    head += "".join(f"property float {axis}\n" for axis in "xyz")
    head += "element face 4\nproperty list uchar int vertex_indices\nend_header\n"
    folder.joinpath("m.ply").write_text(head + "\n".join(rows) + "\n")


def named_gltf(folder, name):
    gltf(folder / "m.gltf", ["a.bin"], images=[{"uri": name, "name": name}])


def named_buffer(folder, name):
    gltf(folder / "m.gltf", ["a.bin"])
    tree = json.loads((folder / "m.gltf").read_text())
    tree["buffers"][0]["uri"] = name
    (folder / "m.gltf").write_text(json.dumps(tree))


def named_glb(folder, name):
    """A name that becomes one of a file in a conversion."""
    box = trimesh.creation.box()
    image = Image.fromarray(np.zeros((2, 2, 3), np.uint8))
    material = trimesh.visual.material.PBRMaterial(name=name, baseColorTexture=image)
    uv = box.vertices[:, :2] + 0.5
    box.visual = trimesh.visual.TextureVisuals(uv=uv, material=material)
    box.export(folder / "m.glb")


@pytest.mark.parametrize("name", HOSTILE)
@pytest.mark.parametrize("make", [named_obj, named_ply, named_gltf, named_buffer, named_glb])
@needs_links
def test_hostile_names_in_models_touch_nothing_elsewhere(folder, make, name):
    for place in ("in", "out"):
        (folder / place / "link").symlink_to(folder / "elsewhere")
    data = TRIANGLE.tobytes() + CORNERS.tobytes()
    for place in ("victim", "elsewhere/victim"):
        (folder / place).write_bytes(data)
    make(folder / "in", name.format(root=folder))
    before = snapshot(folder)
    (source,) = (folder / "in").glob("m.*")
    for ending in ENDINGS:
        for overwrite in (Options(), OVERWRITE):
            try:
                filter_mesh_file(lift, source, folder / f"out/m{ending}", overwrite)
            except core.ShockError:
                continue
    try:
        filter_mesh_file(lift, source, source, OVERWRITE)
    except core.ShockError:
        assert before.items() <= snapshot(folder).items()
    own = {f"in/{source.name}", "in/a.bin"}  # what is written in place
    after = snapshot(folder)
    assert {path for path in before if after.get(path) != before[path]} <= own
    new = after.keys() - before.keys()
    assert all(path.startswith("out/m") for path in new if path != "out/good.mtl"), new


IMAGES = {
    ending: np.full((4, 4, 3), 0.5, np.float32)
    if ending == ".exr"
    else np.full((4, 4, 3), 128, np.uint8)
    for ending in images.FORMATS
}


def write_mesh(target):
    gltf(Path("in/m.gltf"), ["a.bin"], images=[{"uri": "t.png"}])
    Path("in/t.png").write_bytes(b"picture")
    filter_mesh_file(lift, "in/m.gltf", target, OVERWRITE)


def write_same(target):
    """In its own format, so that side files come along."""
    {".obj": named_obj, ".ply": named_ply, ".glb": named_glb, ".gltf": named_gltf}[target.suffix](
        Path("in"), "t.png"
    )
    Path("in/t.png").write_bytes(b"picture")
    filter_mesh_file(lift, f"in/m{target.suffix}", target, OVERWRITE)


def write_frames(target):
    frames.write_frames(iter([np.zeros((4, 4, 3))] * 2), target, 2, overwrite=True)


def write_zarr(target):
    array = open_array("in.zarr", mode="w", shape=(8, 8), chunks=(8, 8), dtype="u1")
    array[...] = np.arange(64, dtype=np.uint8).reshape(8, 8)
    filter_image_file(lambda pixels: pixels, "in.zarr", target, OVERWRITE)


WRITERS = [
    *(
        (ending, lambda target: write_image_file(target, IMAGES[target.suffix], True))
        for ending in IMAGES
    ),
    *((ending, write_mesh) for ending in ENDINGS),
    *((ending, write_same) for ending in meshes.IN_PLACE),
    *((ending, write_frames) for ending in frames.FILES),
    (".zarr", write_zarr),
]


@pytest.mark.parametrize("ending, write", WRITERS)
def test_nothing_is_written_before_the_stage_is_complete(folder, ending, write, monkeypatch):
    target = folder / f"out/old{ending}"
    write(target)  # what is there before
    before = snapshot(folder / "out")

    def refuse(moves):
        raise OSError("refused")

    monkeypatch.setattr(output, "move_all", refuse)
    with pytest.raises(OSError, match="refused"):
        write(target)
    assert snapshot(folder / "out") == before


# --------------------------------------------------------------------------------- absolute names


@pytest.mark.parametrize("scheme", ["", "file://", "file:"])
def test_absolute_names_in_place_go_through_the_stage(folder, scheme, monkeypatch):
    uri = scheme + quote(str(folder / "in/a.bin"))
    gltf(folder / "in/m.gltf", ["a.bin"])
    tree = json.loads(Path("in/m.gltf").read_text())
    tree["buffers"][0]["uri"] = uri
    Path("in/m.gltf").write_text(json.dumps(tree))
    before = snapshot(folder)
    with monkeypatch.context() as patch, pytest.raises(core.ShockError, match="report this"):
        patch.setattr(meshes.GltfFile, "read_back", lambda self, path: np.zeros((4, 3)) - 9)
        filter_mesh_file(lift, "in/m.gltf", "in/m.gltf", OVERWRITE)
    assert snapshot(folder) == before
    filter_mesh_file(lift, "in/m.gltf", "in/m.gltf", OVERWRITE)
    points = np.frombuffer(Path("in/a.bin").read_bytes(), "<f4", 12).reshape(4, 3)
    np.testing.assert_array_equal(points, TRIANGLE + 1)
    assert json.loads(Path("in/m.gltf").read_text())["buffers"][0]["uri"] == "a.bin"
    assert snapshot(folder).keys() == before.keys()


def test_absolute_names_of_an_obj_become_relative_in_another_folder(folder):
    Path("in/sub").mkdir()
    Path("in/sub/my t.png").write_bytes(b"picture")
    named_obj(folder / "in", "good.mtl")
    Path("in/m.obj").write_text(OBJ.format(folder / "in/good.mtl"))
    text = f"newmtl paint\nmap_Kd {folder}/in/sub/my t.png\nbump -bm 1 {folder}/in/b.png\n"
    Path("in/good.mtl").write_text(text)
    Path("in/b.png").write_bytes(b"bumps")
    before = snapshot(folder / "in")
    assert filter_mesh_file(lift, "in/m.obj", "out/m.obj").notes == ()
    assert Path("out/m.obj").read_text().startswith("mtllib good.mtl\n")
    written = "newmtl paint\nmap_Kd sub/my t.png\nbump -bm 1 b.png\n"
    assert Path("out/good.mtl").read_text() == written
    assert Path("out/sub/my t.png").read_bytes() == b"picture"
    filter_mesh_file(lift, "in/m.obj", "in/n.obj")  # beside it, names stay
    assert snapshot(folder / "in").items() - before.items() == {
        ("n.obj", Path("in/n.obj").read_bytes())
    }
    assert str(folder / "in/good.mtl") in Path("in/n.obj").read_text()
    filter_mesh_file(lift, "in/m.obj", "in/m.obj", OVERWRITE)
    assert Path("in/good.mtl").read_text() == text


@pytest.mark.parametrize("scheme", ["", "file://"])
def test_absolute_names_of_images_become_relative_in_another_folder(folder, scheme):
    gltf(folder / "in/m.gltf", ["a.bin"], images=[{"uri": f"{scheme}{folder}/in/my%20t.png"}])
    Path("in/my t.png").write_bytes(b"picture")
    assert filter_mesh_file(lift, "in/m.gltf", "out/m.gltf").notes == ()
    assert json.loads(Path("out/m.gltf").read_text())["images"] == [{"uri": "my%20t.png"}]
    assert Path("out/my t.png").read_bytes() == b"picture"


def test_an_image_named_as_a_new_buffer_is_refused(folder):
    gltf(folder / "in/m.gltf", ["a.bin"], images=[{"uri": "n.gltf.0.bin"}])
    Path("in/n.gltf.0.bin").write_bytes(b"picture" * 50)
    with pytest.raises(core.ShockError, match=r"Two files would be written to n\.gltf\.0\.bin"):
        filter_mesh_file(lift, "in/m.gltf", "out/n.gltf")
    assert not list((folder / "out").iterdir())


def test_two_spellings_of_one_buffer_are_one(folder):
    gltf(folder / "in/m.gltf", ["a.bin"])
    tree = json.loads(Path("in/m.gltf").read_text())
    tree["buffers"] = [tree["buffers"][0], tree["buffers"][0] | {"uri": "./a%2ebin"}]
    tree["bufferViews"][1]["buffer"] = 1
    Path("in/m.gltf").write_text(json.dumps(tree))
    filter_mesh_file(lift, "in/m.gltf", "in/m.gltf", OVERWRITE)
    np.testing.assert_allclose(meshes.GltfFile(Path("in/m.gltf")).vertices, TRIANGLE + 1)


# ------------------------------------------------------------------------------------------ links


@pytest.fixture
def linked(folder):
    """A model, to which another folder has a link."""
    gltf(folder / "in/m.gltf", ["a.bin"], images=[{"uri": "t.png"}])
    Path("in/t.png").write_bytes(b"picture")
    return folder


@needs_links
@pytest.mark.parametrize("parent", [False, True])
def test_a_link_to_the_input_replaces_the_whole_model(linked, parent):
    if parent:
        Path("out").rmdir()
        Path("out").symlink_to("in")
    else:
        Path("out/m.gltf").symlink_to("../in/m.gltf")
    before = snapshot(linked)
    filter_mesh_file(lift, "in/m.gltf", "out/m.gltf", OVERWRITE)
    after = snapshot(linked)
    assert after.keys() == before.keys()
    assert {name for name in after if after[name] != before[name]} == {"in/m.gltf", "in/a.bin"}
    np.testing.assert_allclose(positions("in/m.gltf"), TRIANGLE + 1)


@needs_links
@pytest.mark.parametrize("exists", [False, True])
@pytest.mark.parametrize("name", ["o.gltf", "other.gltf"])
def test_a_link_to_another_folder_has_all_written_there(linked, name, exists):
    Path(f"out/{name}").symlink_to(linked / "elsewhere/o.gltf")
    if exists:
        Path("elsewhere/o.gltf").write_text("old")
    filter_mesh_file(lift, "in/m.gltf", f"out/{name}", OVERWRITE)
    assert os.listdir("out") == [name]
    assert Path(f"out/{name}").is_symlink()
    assert sorted(os.listdir("elsewhere")) == ["o.gltf", "o.gltf.0.bin", "t.png"]
    np.testing.assert_allclose(positions("elsewhere/o.gltf"), TRIANGLE + 1)


@needs_links
def test_a_link_has_the_materials_of_an_obj_written_there(folder):
    Path("in/m.obj").write_text(OBJ.format("good.mtl"))
    Path("in/good.mtl").write_text("newmtl paint\nmap_Kd t.png\n")
    Path("in/t.png").write_bytes(b"picture")
    Path("out/m.obj").symlink_to("../elsewhere/o.obj")
    filter_mesh_file(lift, "in/m.obj", "out/m.obj")
    assert os.listdir("out") == ["m.obj"]
    assert sorted(os.listdir("elsewhere")) == ["good.mtl", "o.obj", "t.png"]


@needs_links
def test_side_files_do_not_follow_links_to_other_folders(linked):
    for link in ("out/o.gltf.0.bin", "out/t.png"):
        Path(link).symlink_to(linked / "elsewhere/victim")
    Path("elsewhere/victim").write_text("mine")
    before = snapshot(linked)
    with pytest.raises(core.ShockError, match="is a link, or behind one, to another folder"):
        filter_mesh_file(lift, "in/m.gltf", "out/o.gltf", OVERWRITE)
    assert snapshot(linked) == before


@needs_links
def test_an_input_that_is_a_link_is_not_taken_for_in_place(linked):
    """Its buffers are beside the link, and those beside the file may be of another model."""
    Path("in/n.gltf").symlink_to("../elsewhere/n.gltf")
    Path("in/m.gltf").rename("elsewhere/n.gltf")
    Path("elsewhere/a.bin").write_bytes(b"of another")
    filter_mesh_file(lift, "in/n.gltf", "elsewhere/n.gltf", OVERWRITE)
    assert Path("elsewhere/a.bin").read_bytes() == b"of another"
    np.testing.assert_allclose(positions("elsewhere/n.gltf"), TRIANGLE + 1)


@needs_links
@pytest.mark.parametrize("make", ["mkfifo", "socket"])
def test_outputs_that_are_no_plain_files_are_refused(folder, make):
    if make == "mkfifo":
        os.mkfifo("out/o.png")
    else:
        with socket.socket(socket.AF_UNIX) as made:
            made.bind("out/o.png")
    Image.fromarray(np.zeros((4, 4), np.uint8)).save("in/a.png")
    mode = os.lstat("out/o.png").st_mode
    with pytest.raises(core.ShockError, match="a pipe or a device, and no plain file"):
        write_image_file(folder / "out/o.png", np.zeros((4, 4), np.uint8), True)
    words = ["sharpen-image", "in/a.png", "out/o.png", "--overwrite", "--resume"]
    assert cli.main(words) == 1
    assert os.lstat("out/o.png").st_mode == mode
    assert os.listdir("out") == ["o.png"]


# -------------------------------------------------------------------------------------- left-overs


def old(path):
    os.utime(path, (0, 0))


@pytest.mark.parametrize("name", [".shock-filter-presets", ".shock-filter-0123456789abcdef"])
@pytest.mark.parametrize("inside", [[], ["keep.txt"], ["made-by-shock-filter", "keep.txt"]])
def test_folders_of_others_stay_whatever_their_name(folder, name, inside):
    mine = folder / "out" / name
    mine.mkdir()
    for each in inside:
        (mine / each).write_text("mine")
    old(mine)
    (folder / f"out/{name}.blend").write_text("mine")
    before = snapshot(folder)
    staging._tidy.cache_clear()
    with staged(folder / "out/o.obj", False) as path:
        path.write_text("new")
    assert before.items() <= snapshot(folder).items()


@pytest.mark.parametrize("count", [0, 5, 1000])
def test_a_stage_that_was_just_begun_is_removed_later(folder, count, monkeypatch):
    """The process was killed before the marker was whole."""
    monkeypatch.setattr(staging.shutil, "rmtree", lambda *_, **__: None)
    name = staging._PREFIX + "01234567" + staging._check("01234567")
    left = folder / "out" / name
    left.mkdir()
    if count:
        (left / staging._MARKER).write_bytes(staging._MARK[:count])
    staging._tidy.cache_clear()
    staging.tidy(folder / "out")
    assert left.exists() == (count < 1000)  # it may be about to be marked
    if left.exists():
        old(left)
        staging._tidy.cache_clear()
        staging.tidy(folder / "out")
    assert not left.exists()


def unfinished(folder, moves, files):
    """What a killed run has left that had written down its moves."""
    left = folder / "out" / (staging._PREFIX + "01234567" + staging._check("01234567"))
    (left / "files").mkdir(parents=True)
    (left / staging._MARKER).write_bytes(staging._MARK)
    for name, text in files.items():
        (left / "files" / name).write_text(text)
    (left / staging._MOVES).write_text(json.dumps(moves))
    staging._tidy.cache_clear()
    return left


@needs_links
@pytest.mark.parametrize("place", ["../victim", "/victim", "link/victim", "mine.txt", 7, None])
def test_moves_that_lead_elsewhere_or_over_other_files_are_not_made(folder, place):
    (folder / "out/link").symlink_to(folder / "elsewhere")
    (folder / "out/mine.txt").write_text("mine")
    left = unfinished(folder, [["a", place, None]], {"a": "new"})
    before = snapshot(folder)
    staging.tidy(folder / "out")
    assert snapshot(folder) == before
    assert left.exists()


def test_moves_of_a_killed_run_are_made(folder):
    (folder / "out/b").write_text("old")
    state = staging._state(folder / "out/b")
    left = unfinished(folder, [["a", "sub/a", None], ["b", "b", state]], {"a": "1", "b": "2"})
    staging.tidy(folder / "out")
    assert snapshot(folder / "out") == {"sub": False, "sub/a": b"1", "b": b"2"}
    assert not left.exists()


# ------------------------------------------------------------------------------------- all or none


@pytest.mark.parametrize("refused", [1, 2, 3])
def test_if_a_move_is_refused_all_are_taken_back(folder, refused, monkeypatch):
    for name in ("a.mtl", "o.obj"):
        (folder / "out" / name).write_text("old")
    before = snapshot(folder)
    replace, seen = os.replace, []

    def move(new, place):
        if Path(place).parent.name in ("out", "sub") and ".shock" not in str(place):
            seen.append(place)
            if len(seen) == refused:
                raise PermissionError("open elsewhere")
        replace(new, place)

    monkeypatch.setattr(os, "replace", move)
    with (
        pytest.raises(PermissionError),
        staged(folder / "out/o.obj", True, ["a.mtl", "sub/b.png"]) as path,
    ):
        for name in ("a.mtl", "o.obj", "sub/b.png"):
            staging.within(path.parent, name).write_text("new")
    assert snapshot(folder) == before


def test_if_a_new_folder_is_refused_the_old_one_is_there(folder, monkeypatch):
    (folder / "out/big.zarr").mkdir()
    (folder / "out/big.zarr/0.0").write_text("old")
    replace = os.replace

    def move(new, place):
        if Path(place).name == "big.zarr" and Path(new).parent.name == "files":
            raise PermissionError("open elsewhere")
        replace(new, place)

    monkeypatch.setattr(os, "replace", move)
    with pytest.raises(PermissionError), staged_folder(folder / "out/big.zarr", True) as stage:
        stage.mkdir()
        (stage / "0.0").write_text("new")
    assert snapshot(folder / "out") == {"big.zarr": False, "big.zarr/0.0": b"old"}


def test_folders_are_replaced_as_a_whole(folder):
    for text in ("old", "new"):
        with staged_folder(folder / "out/big.zarr", True) as stage:
            stage.mkdir()
            (stage / text).write_text(text)
    assert snapshot(folder / "out") == {"big.zarr": False, "big.zarr/new": b"new"}


# ----------------------------------------------------------------------------------------- records

PICTURES = ["sharpen-image", "in/*.png", "out/", "--time", "4", "--resume"]


def pictures(count=3):
    for number in range(count):
        pixels = np.random.default_rng(number).integers(0, 256, (8, 8), np.uint8)
        Image.fromarray(pixels).save(f"in/{number}.png")


@needs_links
@pytest.mark.parametrize("kind", ["file", "link", "dangling"])
def test_where_records_cannot_be_kept_nothing_is_written(folder, kind, capsys):
    pictures()
    place = Path("out/.shock-filter")
    if kind == "file":
        place.write_text("mine")
    else:
        place.symlink_to("../elsewhere" if kind == "link" else "nowhere")
    before = snapshot(folder)
    assert cli.main(PICTURES) == 1
    assert capsys.readouterr().err.count("records of outputs are kept there; rename it") == 3
    assert snapshot(folder) == before


def test_what_another_run_makes_meanwhile_is_no_failure(folder, capsys, monkeypatch):
    pictures(1)
    row, is_first = images.FORMATS[".png"], [True]

    def meanwhile(*words):
        if is_first:
            is_first.clear()
            assert cli.main(PICTURES) == 0
        return row.write(*words)

    monkeypatch.setitem(images.FORMATS, ".png", row._replace(write=meanwhile))
    assert cli.main(PICTURES) == 0
    shown = capsys.readouterr()
    assert "made by another run meanwhile" in shown.out
    assert shown.err == ""
    assert cli.main(PICTURES) == 0
    assert "done already: 1" in capsys.readouterr().out


def test_systems_without_locks_write_and_resume_all_the_same(folder, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "fcntl", None)  # as on Windows
    pictures()
    left = unfinished(folder, [["a", "a", None]], {"a": "new"})
    assert cli.main(PICTURES) == 0
    assert left.exists()  # whoever made it may be at work
    assert cli.main(PICTURES) == 0
    assert "done already: 3" in capsys.readouterr().out
    frames.write_frames(iter([np.zeros((4, 4))]), folder / "out/frames", 1)
    assert len(list((folder / "out/frames").iterdir())) == 1
    frames.write_frames(iter([np.zeros((4, 4))]), folder / "out/frames", 1, overwrite=True)


def test_frames_that_another_run_writes_are_said_to_be(folder):
    target = folder / "out/frames"
    target.mkdir()
    started, go_on = threading.Event(), threading.Event()

    def slow():
        yield np.zeros((4, 4))
        started.set()
        go_on.wait(20)
        yield np.zeros((4, 4))

    words = (slow(), target, 2)
    thread = threading.Thread(target=frames.write_frames, args=words, kwargs={"overwrite": True})
    thread.start()
    started.wait(20)
    with pytest.raises(core.ShockError, match="Another run writes to"):
        frames.write_frames(iter([]), target, 0, overwrite=True)
    go_on.set()
    thread.join()
    assert len(list(target.iterdir())) == 2
