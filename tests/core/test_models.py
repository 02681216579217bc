# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests of repairing models with their textures: GLB, glTF and OBJ files."""

import io
import json
import struct

import numpy as np
import pytest
from atlases import Blocks
from PIL import Image
from shock_filter import core
from shock_filter.core import cli
from shock_filter.core.files import baking, models
from shock_filter.core.files.formats.mesh.contents import side_files
from shock_filter.core.files.formats.mesh.gltf import GltfFile
from shock_filter.core.files.formats.mesh.obj import ObjFile
from shock_filter.core.settings import ModelSettings


def model(n=32):
    y, x = (np.mgrid[:n, :n] + 0.5) / n * np.pi
    values = [np.cos(2 * x + c) * np.cos(3 * y - c) for c in range(3)]
    return Blocks((0.5 + 0.3 * np.stack(values, axis=-1)).astype(np.float32), None)


def unseen(blocks):
    """Faces around the middle."""
    middles = blocks.vertices[blocks.faces].mean(axis=1)
    far = np.linalg.norm(middles - middles.mean(axis=0), axis=1)
    return far < 0.25 * far.max()


def picture(blocks, hole=True):
    """The texture as it is stored, row 0 at the top; two faces are black."""
    mesh = core.TriangleMesh(blocks.vertices, blocks.faces)
    image = np.rint(255 * blocks.texture()).astype(np.uint8)
    atlas = core.TextureAtlas(mesh, blocks.uv, size=image.shape[:2])
    if hole:
        image[unseen(blocks)[atlas.masks().face] & (atlas.masks().face >= 0)] = 0
    return np.ascontiguousarray(image[::-1])


def png(pixels, kind="PNG"):
    file = io.BytesIO()
    Image.fromarray(pixels).save(file, kind)
    return file.getvalue()


def write_glb(path, blocks, images, **material):
    """Write a GLB file whose vertices are all split."""
    positions = blocks.vertices[blocks.faces].reshape(-1, 3).astype("<f4")
    uv = (blocks.uv.reshape(-1, 2) * (1, -1) + (0, 1)).astype("<f4")
    parts = [positions.tobytes(), uv.tobytes(), *images]
    data, views = bytearray(), []
    for part in parts:
        data += bytes(-len(data) % 4)
        views.append({"buffer": 0, "byteOffset": len(data), "byteLength": len(part)})
        data += part
    count = len(positions)
    tree = {
        "asset": {"version": "2.0"},
        "buffers": [{"byteLength": len(data)}],
        "bufferViews": views,
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": count, "type": "VEC3",
             "min": positions.min(0).tolist(), "max": positions.max(0).tolist()},
            {"bufferView": 1, "componentType": 5126, "count": count, "type": "VEC2"},
        ],
        "images": [{"bufferView": 2 + k, "mimeType": "image/png"} for k in range(len(images))],
        "textures": [{"source": k} for k in range(len(images))],
        "materials": [material],
        "meshes": [{"primitives": [
            {"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "material": 0}]}],
        "nodes": [{"mesh": 0}], "scenes": [{"nodes": [0]}],
    }  # fmt: skip
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    data += bytes(-len(data) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text
    chunks += struct.pack("<II", len(data), 0x004E4942) + bytes(data)
    path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)


def write_obj(folder, blocks, pixels, name="tex.png"):
    lines = ["mtllib m.mtl", "usemtl m"]
    lines += ["v {} {} {}".format(*point) for point in blocks.vertices]
    lines += ["vt {} {}".format(*place) for place in blocks.uv.reshape(-1, 2)]
    for n, face in enumerate(blocks.faces):
        corners = " ".join(f"{v + 1}/{3 * n + k + 1}" for k, v in enumerate(face))
        lines.append(f"f {corners}")
    (folder / "in.obj").write_text("\n".join(lines) + "\n")
    (folder / "m.mtl").write_text(f"newmtl m\nKd 1 1 1\nmap_Kd {name}\n")
    (folder / "tex.png").write_bytes(png(pixels))
    return folder / "in.obj"


def repair(*words):
    return cli.main(["repair-model", *map(str, words), "--sharpen", "0", "--quiet"])


def images_of(path, reader=GltfFile):
    groups, notes = reader(path).read_maps()
    found = {
        image.part: np.asarray(Image.open(io.BytesIO(image.data)))
        for group in groups
        for image in group.images
    }
    return found, notes


def test_glb_files_get_new_images_and_keep_all_else(tmp_path):
    blocks = model()
    pixels, rough = picture(blocks), np.full((32, 32), 90, dtype=np.uint8)
    write_glb(
        tmp_path / "in.glb",
        blocks,
        [png(pixels), png(rough)],
        pbrMetallicRoughness={
            "baseColorTexture": {"index": 0},
            "metallicRoughnessTexture": {"index": 1},
        },
    )
    assert repair(tmp_path / "in.glb", tmp_path / "out.glb", "--enlarge", "2") == 0
    found, _ = images_of(tmp_path / "out.glb")
    assert found["color"].shape == (2 * len(pixels), 2 * len(pixels), 3)
    assert (found["metal and roughness"] == 90).all()
    old, new = GltfFile(tmp_path / "in.glb"), GltfFile(tmp_path / "out.glb")
    assert (old.vertices == new.vertices).all()
    assert (old.faces == new.faces).all()
    assert (old.read_uvs()[0] == new.read_uvs()[0]).all()
    truth = picture(blocks, hole=False)
    black = (pixels == 0).all(axis=2) & (truth > 0).any(axis=2)
    small = found["color"][::2, ::2]
    assert black.any()
    assert np.abs(small[black].astype(float) - truth[black]).mean() < 25


def test_obj_files_get_a_material_file_of_their_own(tmp_path):
    blocks = model()
    pixels = picture(blocks)
    source = write_obj(tmp_path, blocks, pixels)
    assert repair(source, tmp_path / "out.obj", "--picture", tmp_path / "seen.png") == 0
    found, notes = images_of(tmp_path / "out.obj", ObjFile)
    assert not notes
    assert (found["color"] != pixels).any()
    assert "out.obj.0.png" in (tmp_path / "out.obj.mtl").read_text()
    assert (np.asarray(Image.open(tmp_path / "tex.png")) == pixels).all()
    seen = np.asarray(Image.open(tmp_path / "seen.png"))
    assert seen.shape == (512, 1024, 3)
    assert (seen[:, :512] != seen[:, 512:]).any()
    assert len(np.unique(seen[:, :512].reshape(-1, 3), axis=0)) > 100


def test_material_files_of_one_line_become_one_and_missing_ones_stay(tmp_path):
    blocks = model()
    pixels = picture(blocks)
    source = write_obj(tmp_path, blocks, pixels)
    source.write_text(source.read_text().replace("m.mtl", "m.mtl gone.mtl more.mtl", 1))
    (tmp_path / "more.mtl").write_text("newmtl more\nKd 0 1 0\n")
    file = ObjFile(source)
    unmoved = np.zeros(len(file.vertices), dtype=bool)
    target = tmp_path / "out.obj"
    notes = file.save_maps(target, file.vertices, unmoved, {"tex.png": png(pixels)})
    assert notes == ["left behind, as no plain files beside the input: gone.mtl"]
    assert (tmp_path / "out.obj").read_text().startswith("mtllib out.obj.mtl\nmtllib gone.mtl\n")
    text = (tmp_path / "out.obj.mtl").read_text()
    assert "newmtl m\n" in text and "newmtl more\n" in text


def test_new_images_take_no_names_of_the_others(tmp_path):
    blocks = model()
    pixels = picture(blocks)
    source = write_obj(tmp_path, blocks, pixels, "tex.png\nmap_Pr in.obj.0.png")
    flat = png(np.full((32, 32), 90, dtype=np.uint8))
    (tmp_path / "in.obj.0.png").write_bytes(flat)
    positions = ObjFile(source).vertices
    (tmp_path / "new").mkdir()
    unmoved = np.zeros(len(positions), dtype=bool)
    target = tmp_path / "new/in.obj"
    ObjFile(source).save_maps(target, positions, unmoved, {"tex.png": png(pixels)})
    assert (tmp_path / "new/in.obj.0.png").read_bytes() == flat
    assert (tmp_path / "new/in.obj.1.png").read_bytes() == png(pixels)
    assert (
        "map_Kd in.obj.1.png\nmap_Pr in.obj.0.png\n" in (target.parent / "in.obj.mtl").read_text()
    )


def test_the_shape_is_repaired_on_request(tmp_path):
    blocks = model()
    source = write_obj(tmp_path, blocks, picture(blocks))
    assert repair(source, tmp_path / "a.obj", "--geometry", "both") == 0
    assert repair(source, tmp_path / "b.obj") == 0
    given = ObjFile(source).vertices
    assert (ObjFile(tmp_path / "b.obj").vertices == given).all()
    assert ObjFile(tmp_path / "a.obj").vertices.shape == given.shape


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"extensions": {"KHR_texture_transform": {"scale": [2, 2]}}}, "are transformed"),
        ({"texCoord": 1}, "other texture coordinates"),
        ({"index": -1}, "color of materials[0] names a texture that is not there, or in"),
        ({"index": "0"}, "color of materials[0] names a texture that is not there, or in"),
    ],
)
def test_what_cannot_be_read_is_said_and_leaves_no_output(tmp_path, capsys, change, words):
    blocks = model()
    write_glb(
        tmp_path / "in.glb",
        blocks,
        [png(picture(blocks))],
        pbrMetallicRoughness={"baseColorTexture": {"index": 0, **change}},
    )
    assert repair(tmp_path / "in.glb", tmp_path / "out.glb") == 1
    assert words in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["in.glb"]


def test_broken_images_get_a_sentence_and_leave_no_output(tmp_path, capsys):
    blocks = model()
    for data in (b"nonsense", png(picture(blocks))[:200]):
        write_glb(
            tmp_path / "in.glb",
            blocks,
            [data],
            pbrMetallicRoughness={"baseColorTexture": {"index": 0}},
        )
        assert repair(tmp_path / "in.glb", tmp_path / "out.glb") == 1
        assert "in.glb has no textures that can be repaired" in capsys.readouterr().err
        assert [path.name for path in tmp_path.iterdir()] == ["in.glb"]


def test_image_names_with_spaces_are_read_behind_options_and_told_whole(tmp_path, capsys):
    blocks = model()
    pixels = picture(blocks)
    source = write_obj(tmp_path, blocks, pixels, "-s 1 1 1 my tex.png")
    (tmp_path / "tex.png").rename(tmp_path / "my tex.png")
    assert (images_of(source, ObjFile)[0]["color"] == pixels).all()
    write_obj(tmp_path, blocks, pixels, "C:/My Pictures/old wood.png")
    assert repair(source, tmp_path / "out.obj") == 1
    told = capsys.readouterr().err
    assert "the file C:/My Pictures/old wood.png is not beside the model" in told


def test_reasons_end_in_one_point(tmp_path, capsys):
    blocks = model()
    pixels = picture(blocks)
    blocks.uv = blocks.uv * 40.0
    assert repair(write_obj(tmp_path, blocks, pixels), tmp_path / "out.obj") == 1
    assert "unwrap the mesh into a texture that is not tiled.\n" in capsys.readouterr().err


def test_missing_images_and_other_formats_are_refused(tmp_path, capsys):
    blocks = model()
    source = write_obj(tmp_path, blocks, picture(blocks), "gone.png")
    assert repair(source, tmp_path / "out.obj") == 1
    assert "gone.png is not beside the model" in capsys.readouterr().err
    (tmp_path / "m.mtl").unlink()
    assert repair(source, tmp_path / "out.obj") == 1
    assert "the material file m.mtl is not beside the model.\n" in capsys.readouterr().err
    assert repair(source, tmp_path / "out.glb") == 1
    assert "models keep their format" in capsys.readouterr().err
    assert not list(tmp_path.glob("out*"))


def test_jpeg_textures_are_stored_as_png(tmp_path):
    blocks = model()
    pixels = picture(blocks)
    write_glb(
        tmp_path / "in.glb",
        blocks,
        [png(pixels, "JPEG")],
        pbrMetallicRoughness={"baseColorTexture": {"index": 0}},
    )
    assert repair(tmp_path / "in.glb", tmp_path / "out.glb") == 0
    groups, _ = GltfFile(tmp_path / "out.glb").read_maps()
    assert groups[0].images[0].data.startswith(b"\x89PNG")


def write_two(path, blocks, images, first, second, change=None, part=None):
    """Write a GLB file of two materials, of the same faces if no other part is given."""
    write_glb(path, blocks, images, **first)
    data = path.read_bytes()
    length = struct.unpack("<I", data[12:16])[0]
    tree, rest = json.loads(data[20 : 20 + length]), data[20 + length :]
    tree["materials"].append(second)
    if change is not None:
        change(tree)
    parts = tree["meshes"][0]["primitives"]
    parts.append({**(part or parts[0]), "material": 1})
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text + rest
    path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)


def colors(index, **more):
    return {"pbrMetallicRoughness": {"baseColorTexture": {"index": index, **more}}}


@pytest.mark.parametrize("mode", ["MASK", "BLEND"])
def test_what_is_cut_out_stays_so(tmp_path, mode):
    blocks = model()
    pixels = picture(blocks, hole=False)
    mask = (picture(blocks) == 0).all(axis=2) & (pixels > 0).any(axis=2)
    pixels = np.dstack([pixels, np.where(mask, 0, 255).astype(np.uint8)])
    write_glb(tmp_path / "in.glb", blocks, [png(pixels)], **colors(0), alphaMode=mode)
    assert repair(tmp_path / "in.glb", tmp_path / "out.glb") == 0
    found, _ = images_of(tmp_path / "out.glb")
    assert mask.any()
    assert (found["color"][mask][:, 3] == 0).all()
    write_glb(tmp_path / "in.glb", blocks, [png(pixels)], **colors(0))
    assert repair(tmp_path / "in.glb", tmp_path / "opaque.glb") == 0
    found, _ = images_of(tmp_path / "opaque.glb")
    assert (found["color"][mask][:, 3] > 0).any()


def test_opacity_in_a_map_of_its_own_stays(tmp_path):
    blocks = model()
    pixels = picture(blocks)
    source = write_obj(tmp_path, blocks, pixels)
    opacity = np.where((pixels == 0).all(axis=2), 0, 255).astype(np.uint8)
    (tmp_path / "clear.png").write_bytes(png(opacity))
    with (tmp_path / "m.mtl").open("a") as file:
        file.write("map_d clear.png\n")
    assert repair(source, tmp_path / "out.obj", "--stitch", "nothing") == 0
    found, _ = images_of(tmp_path / "out.obj", ObjFile)
    black = unseen_texels_of(blocks, pixels)
    assert (found["opacity"][black] == 0).all()
    assert (found["color"][black] > 0).any()


def unseen_texels_of(blocks, pixels):
    return (pixels == 0).all(axis=2) & (picture(blocks, hole=False) > 0).any(axis=2)


def test_nothing_is_filled_without_a_map_of_colors(tmp_path, capsys):
    blocks = model()
    pixels = picture(blocks)
    write_glb(tmp_path / "in.glb", blocks, [png(pixels)], emissiveTexture={"index": 0})
    words = ["repair-model", tmp_path / "in.glb", tmp_path / "out.glb", "--sharpen", "0"]
    assert cli.main([*map(str, words), "--stitch", "nothing"]) == 0
    assert "no map of colors" in "".join(capsys.readouterr())
    found, _ = images_of(tmp_path / "out.glb")
    assert (found["emission"][unseen_texels_of(blocks, pixels)] == 0).all()


def test_resuming_sees_that_an_image_beside_the_model_was_edited(tmp_path):
    blocks = model()
    source = write_obj(tmp_path, blocks, picture(blocks))

    def made():
        assert repair(source, tmp_path / "out.obj", "--stitch", "nothing", "--resume") == 0
        return {path.name: path.read_bytes() for path in tmp_path.glob("out.obj*.png")}

    first = made()
    assert first and made() == first
    (tmp_path / "tex.png").write_bytes(png(255 - picture(blocks)))
    assert made() != first


def test_files_beside_a_model_are_those_that_it_names(tmp_path):
    write_obj(tmp_path, model(), picture(model()))
    (tmp_path / "in.bin").write_bytes(b"1234")
    tree = {"buffers": [{"uri": "in.bin"}, {}], "images": [{"uri": "te%78.png"}, {"uri": "no.png"}]}
    (tmp_path / "in.gltf").write_text(json.dumps(tree))
    for name, found in (("in.obj", ["m.mtl", "tex.png"]), ("in.gltf", ["in.bin", "tex.png"])):
        assert [path.name for path in side_files(tmp_path / name)] == found
    for broken in (b"", b"\xff{", b"[]", b'{"images": [1]}', b'{"images": [{"uri": 2}]}'):
        (tmp_path / "in.gltf").write_bytes(broken)
        assert side_files(tmp_path / "in.gltf") == []
    assert side_files(tmp_path / "tex.png") == side_files(tmp_path / "missing.obj") == []


@pytest.mark.parametrize(
    "change", [{"texCoord": 1}, {"extensions": {"KHR_texture_transform": {"scale": [2, 2]}}}]
)
def test_images_that_another_material_shows_elsewhere_stay(tmp_path, change):
    blocks = model()
    write_two(tmp_path / "in.glb", blocks, [png(picture(blocks))], colors(0), colors(0, **change))
    groups, notes = GltfFile(tmp_path / "in.glb").read_maps()
    assert not any(group.images for group in groups)
    assert len(notes) == 2
    assert repair(tmp_path / "in.glb", tmp_path / "out.glb") == 1
    assert not (tmp_path / "out.glb").exists()


def test_images_that_share_their_data_stay(tmp_path):
    blocks = model()
    image = png(picture(blocks))

    def share(tree):
        tree["images"][1]["bufferView"] = tree["images"][0]["bufferView"]

    path = tmp_path / "in.glb"
    write_two(path, blocks, [image, image], colors(0), colors(1), share)
    groups, notes = GltfFile(path).read_maps()
    assert not any(group.images for group in groups)
    assert "another image shares its data" in notes[0]


@pytest.mark.parametrize(
    ("options", "moves"),
    [("-s 2 2 1", True), ("-clamp on -o 0.5", True), ("-s 1 1 1 -o 0 0 0 -bm 2", False)],
)
def test_moved_maps_of_obj_files_stay(tmp_path, options, moves):
    blocks = model()
    source = write_obj(tmp_path, blocks, picture(blocks), f"{options} tex.png")
    groups, notes = ObjFile(source).read_maps()
    assert any(group.images for group in groups) != moves
    assert any("apply that first" in note for note in notes) == moves


def test_what_is_refused_does_not_count_as_repaired(tmp_path, capsys, monkeypatch):
    blocks = model()
    write_glb(tmp_path / "in.glb", blocks, [png(picture(blocks))], **colors(0))

    def refuse(*_, **__):
        raise core.InvalidUV("Faces overlap.")

    monkeypatch.setattr(models, "repair_textures", refuse)
    assert repair(tmp_path / "in.glb", tmp_path / "out.glb") == 1
    assert "Faces overlap" in capsys.readouterr().err
    assert not (tmp_path / "out.glb").exists()


def test_existing_targets_are_refused_before_anything_is_computed(tmp_path, monkeypatch):
    blocks = model()
    write_glb(tmp_path / "in.glb", blocks, [png(picture(blocks))], **colors(0))
    (tmp_path / "out.glb").write_bytes(b"old")
    monkeypatch.setattr(models, "repair_textures", None)
    settings = ModelSettings()
    with pytest.raises(core.ShockError, match="exists already"):
        models.repair_model_file(tmp_path / "in.glb", tmp_path / "out.glb", settings)
    monkeypatch.setattr(baking, "read_textured_mesh", None)
    (tmp_path / "out.png").write_bytes(b"old")
    for name, words in (("out.png", "exists already"), ("out.txt", "use one of")):
        with pytest.raises(core.ShockError, match=words):
            baking.bake_file(
                tmp_path / "in.glb", tmp_path / name, ["curvature"], None, (8, 8),
                core.BakeSettings(),
            )  # fmt: skip


def test_a_picture_that_cannot_be_written_is_a_note(tmp_path, monkeypatch):
    blocks = model()
    write_glb(tmp_path / "in.glb", blocks, [png(picture(blocks))], **colors(0))

    def fail(*_):
        raise OSError("disk full")

    monkeypatch.setattr(models, "write_image_file", fail)
    outcome = models.repair_model_file(
        tmp_path / "in.glb", tmp_path / "out.glb", ModelSettings(sharpen=0.0),
        picture=tmp_path / "seen.png",
    )  # fmt: skip
    assert any("disk full" in note for note in outcome.notes)
    assert (tmp_path / "out.glb").exists()


def test_materials_without_faces_have_no_part_in_the_picture(tmp_path):
    blocks = model()

    def add_empty(tree):
        tree["accessors"] += [
            {"componentType": 5126, "count": 1, "type": "VEC3", "min": [0] * 3, "max": [0] * 3},
            {"componentType": 5126, "count": 1, "type": "VEC2"},
        ]

    image = png(picture(blocks))
    path, empty = tmp_path / "in.glb", {"attributes": {"POSITION": 2, "TEXCOORD_0": 3}}
    write_two(path, blocks, [image, image], colors(0), colors(1), add_empty, empty)
    assert repair(path, tmp_path / "out.glb", "--picture", tmp_path / "seen.png") == 0
    assert (tmp_path / "seen.png").exists()
