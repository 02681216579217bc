# SPDX-License-Identifier: GPL-3.0-or-later
"""Mesh files that were changed at random are read, or refused in a sentence."""

import random
import re
import struct
from pathlib import Path

import pytest
from shock_filter import core
from shock_filter.core.files.meshes import filter_colors_file, filter_mesh_file
from shock_filter.core.files.output import Options
from shock_filter.core.files.textures import read_textured_mesh
from test_written_files import lift

OVERWRITE = Options(overwrite=True)
POINTS = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]
FACES = [(0, 1, 2), (0, 2, 3), (0, 3, 1), (1, 3, 2)]
MTL = b"newmtl paint\nKd 1 0 0\nmap_Kd t.png\nbump -bm 1 t.png\n"
OBJ = b"""mtllib a.mtl
o one
v 0 0 0 1 0 0
v 1 0 0 0 1 0
v 0 1 0 0 0 1
v 0 0 1 1 1 1
vt 0 0
vt 1 0
vt 0 1
vn 0 0 1
vn 0 1 0
usemtl paint
f 1/1/1 2/2/1 3/3/2
f 1/1/1 -2/-2/-1 4
o two
f 1//1 4//2 2//1
f 2/1 3/2 4/3 1/1
l 1 2
"""
PROPERTIES = [f"float {name}" for name in ("x", "y", "z", "nx", "ny", "nz")]
PROPERTIES += ["uchar red", "uchar green", "uchar blue", "float s", "float t"]
HEADER = (
    "ply\nformat ascii 1.0\nelement vertex 4\n"
    + "".join(f"property {each}\n" for each in PROPERTIES)
    + "element face 4\nproperty list uchar int vertex_indices\nend_header\n"
).encode()
ROWS = "".join("{} {} {} 0 0 1 255 0 0 0 1\n".format(*point) for point in POINTS)
PLY = HEADER + (ROWS + "".join("3 {} {} {}\n".format(*face) for face in FACES)).encode()
BINARY = HEADER.replace(b"ascii", b"binary_little_endian")
BINARY += b"".join(struct.pack("<6f3B2f", *point, 0, 0, 1, 255, 0, 0, 0, 1) for point in POINTS)
BINARY += b"".join(struct.pack("<B3i", 3, *face) for face in FACES)
TRIANGLES = [[POINTS[corner] for corner in face] for face in FACES]
STL = "solid x\n"
for triangle in TRIANGLES:
    lines = "".join("vertex {} {} {}\n".format(*point) for point in triangle)
    STL += f"facet normal 0 0 1\nouter loop\n{lines}endloop\nendfacet\n"
STL = f"{STL}endsolid x\n".encode()
OFF = ("OFF\n4 4 0\n" + "".join("{} {} {}\n".format(*point) for point in POINTS)).encode()
OFF += "".join("3 {} {} {}\n".format(*face) for face in FACES).encode()

WORDS = [
    *(b"", b"-1", b"0", b"99", b"1e400", b"nan", b"inf", b"x", b"1/2/3/4", b"//", b"1//", b"-99"),
    *(b"1//-99", b"9" * 30, b"list", b"float", b"\xff\xfe", b"property", b"element", b"vertex"),
    *(b"face", b"end_header", b"f", b"v", b"vn", b"vt", b"mtllib", b"#", b"\\", b"double", b"\0"),
]  # fmt: skip


def changed(data, choose):
    kind = choose.random()
    if kind < 0.5:
        start, end = choose.choice([match.span() for match in re.finditer(rb"\S+", data)])
        return data[:start] + choose.choice(WORDS) + data[end:]
    if kind < 0.8:
        lines = data.split(b"\n")
        place = choose.randrange(len(lines))
        lines[place:place] = [choose.choice(lines)] if kind < 0.65 else []
        del lines[place + 1 : place + 2]
        return b"\n".join(lines)
    if kind < 0.9:
        return data[: choose.randrange(1, len(data))]
    place = choose.randrange(len(data))
    return data[:place] + bytes([choose.randrange(256)]) + data[place + 1 :]


FILES = {"a.obj": OBJ, "a.mtl": MTL, "a.ply": PLY, "b.ply": BINARY, "a.stl": STL, "a.off": OFF}


@pytest.mark.parametrize("name, data", FILES.items(), ids=FILES)
def test_changed_files_are_read_or_refused_in_a_sentence(tmp_path, monkeypatch, caplog, name, data):
    """A few of the many thousand that were tried."""
    monkeypatch.chdir(tmp_path)
    choose = random.Random(5)
    source = "a.obj" if name == "a.mtl" else name
    ending = Path(source).suffix
    Path("a.obj").write_bytes(OBJ)
    Path("a.mtl").write_bytes(MTL)
    refused = 0
    for _ in range(60):
        Path(name).write_bytes(changed(data, choose))
        other = choose.choice([".ply", ".obj", ".stl", ".off", ".glb", ".gltf"])
        try:
            filter_mesh_file(lift, source, f"out{ending}", OVERWRITE)
            filter_mesh_file(lift, source, f"other{other}", OVERWRITE)
            if ending in (".obj", ".ply"):
                read_textured_mesh(source)
                colors = Path(f"colors{ending}")
                filter_colors_file(lambda mesh, colors, mask: 1 - colors, source, colors, OVERWRITE)
        except core.ShockError as error:
            refused += 1
            ours = (each for each in caplog.records if each.name.startswith("shock_filter"))
            assert not any(ours), error
    assert refused < 60


@pytest.mark.parametrize("normal", [b"-9", b"9"])
def test_normals_that_are_not_there_are_named(tmp_path, normal):
    (tmp_path / "in.obj").write_bytes(OBJ.replace(b"2//1", b"2//" + normal))
    with pytest.raises(core.ShockError, match="a face names a normal that is not there"):
        filter_mesh_file(lift, tmp_path / "in.obj", tmp_path / "out.obj")
