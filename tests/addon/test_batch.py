# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender's command line: batch.py, run in a Blender process that the tests share."""

import copy
import json
import os
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import trimesh
from on_files import denoise_file, sharpen_colors_file, sharpen_file
from PIL import Image
from scipy.spatial import cKDTree
from shock_filter import core
from shock_filter.core import cli
from shock_filter.core.files.formats.image.exr import read_exr, write_exr
from shock_filter.core.files.formats.image.image_file import ImageFile
from shock_filter.core.files.textures import texture_mask_file
from shock_filter.core.settings import OF_PAPER

BATCH = Path(__file__).resolve().parents[2] / "shock_addon" / "batch.py"

AS_IN_THE_PAPER = [
    word for name, value in OF_PAPER.items() for word in ("--" + name.replace("_", "-"), str(value))
]
"""Flags of what the default has beyond the paper."""

# The bpy module stands in for `blender -b [FILE] -P batch.py -- WORDS`. It is started once, which
# takes seconds, and runs one task for each line that it reads.
PROCESS = """
import json, os, runpy, sys, traceback
import bpy

def run(batch, words, before, after):
    bpy.ops.wm.read_homefile(use_empty=True)
    names = {"bpy": bpy, "json": json, "os": os, "sys": sys}
    exec(before, names)
    sys.argv = ["blender", "-b", "-P", batch, "--", *words]
    code = 0
    try:
        runpy.run_path(batch, run_name="__main__")
    except SystemExit as stop:
        code = stop.code
    exec(after, names)
    return code

answers = os.fdopen(os.dup(1), "w")
for line in sys.stdin:
    folder, out, err, *task = json.loads(line)
    for stream, name in ((sys.stdout, out), (sys.stderr, err)):
        os.dup2(os.open(name, os.O_WRONLY | os.O_CREAT), stream.fileno())
    os.chdir(folder)
    try:
        code = run(*task)
    except Exception:
        traceback.print_exc()
        code = 1
    sys.stdout.flush()
    sys.stderr.flush()
    print(code, file=answers, flush=True)
os._exit(0)  # the bpy module, unlike Blender, may hang when Python takes it down
"""

# A scene as people have them: two rounded boxes (one hidden), a light, a material, a picture.
SCENE = """
def box(name, size):
    import bmesh
    shape = bmesh.new()
    bmesh.ops.create_cube(shape, size=size)
    bmesh.ops.subdivide_edges(shape, edges=shape.edges[:], cuts=11, use_grid_fill=True)
    for _ in range(6):
        bmesh.ops.smooth_vert(shape, verts=shape.verts[:], factor=0.5, use_axis_x=True,
                              use_axis_y=True, use_axis_z=True)
    for vertex in shape.verts:
        vertex.co = [round(c, 4) for c in vertex.co]  # symmetric in each bit
    bmesh.ops.triangulate(shape, faces=shape.faces)
    mesh = bpy.data.meshes.new(name)
    shape.to_mesh(mesh)
    box = bpy.data.objects.new(name, mesh)
    bpy.context.collection.objects.link(box)
    return box

seen, hidden = box("Seen", 2.0), box("Hidden", 1.0)
hidden.hide_set(True)
lamp = bpy.data.objects.new("Lamp", bpy.data.lights.new("Lamp", "SUN"))
bpy.context.collection.objects.link(lamp)
seen.data.materials.append(bpy.data.materials.new("Paint"))
seen.data.uv_layers.new(name="Layout")
left = seen.vertex_groups.new(name="Left")
left.add([v.index for v in seen.data.vertices if v.co.x < 0], 1.0, "REPLACE")
bpy.context.view_layer.objects.active = hidden
"""

# What a file holds now, as the last line of the output.
LOOK = """
bpy.ops.wm.open_mainfile(filepath={path!r})
def look(obj):
    return dict(
        points=[list(v.co) for v in obj.data.vertices],
        group=[bool(v.groups) for v in obj.data.vertices],
        materials=[m.name for m in obj.data.materials],
        uvs=[u.name for u in obj.data.uv_layers],
        selected=obj.select_get(), hidden=obj.hide_get(), mode=obj.mode)
print(json.dumps(dict(
    active=getattr(bpy.context.view_layer.objects.active, "name", None),
    objects=sorted(o.name for o in bpy.data.objects),
    meshes={{o.name: look(o) for o in bpy.data.objects if o.type == "MESH"}})))
"""


@dataclass
class Run:
    """How a Blender process ended, and what it printed."""

    code: int
    out: str
    err: str
    state: dict | None = None


def start_process():
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    return subprocess.Popen(
        [sys.executable, "-X", "faulthandler", "-c", PROCESS], text=True, **pipes
    )


def end_process(process):
    process.communicate(timeout=60)


_shared = []


def shared_process():
    """Return the process that tests share; one that has ended is started again."""
    if not _shared or _shared[0].poll() is not None:
        _shared[:] = [start_process()]
    return _shared[0]


@pytest.fixture(scope="module", autouse=True)
def _shared_process_ends():
    yield
    for process in _shared:
        end_process(process)
    _shared.clear()


def blender(*words, before="", after="", look_at=None, alone=False):
    """Run batch.py; with `look_at`, `Run.state` says what that file holds afterwards.

    `alone` is for what would not leave Blender as it was.
    """
    if look_at is not None:
        after += LOOK.format(path=str(Path(look_at).absolute()))
    with tempfile.TemporaryDirectory() as said:
        outputs = [Path(said, name) for name in ("out", "err")]
        task = [os.getcwd(), *map(str, outputs), str(BATCH), [str(word) for word in words]]
        process = start_process() if alone else shared_process()
        print(json.dumps([*task, before, after]), file=process.stdin, flush=True)
        code = process.stdout.readline()
        if alone:
            end_process(process)
        out, err = (path.read_text(encoding="utf-8") for path in outputs)
    assert code, f"Blender has ended with {process.wait(60)}:\n{err}"
    run = Run(int(code), out, err)
    if look_at is not None and run.code == 0:
        run.state = json.loads(run.out.splitlines()[-1])
    return run


def changed(old, new, name="Seen"):
    points = [np.array(state["meshes"][name]["points"]) for state in (old, new)]
    assert len(points[0]) == len(points[1])
    return (points[0] != points[1]).any(axis=1)


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    return tmp_path_factory.mktemp("scene") / "scene.blend"


@pytest.fixture(scope="module")
def old(scene):
    """Write the scene's file; returns what it holds."""
    save = f"bpy.ops.wm.save_as_mainfile(filepath={str(scene)!r}, compress=True)"
    run = blender("--version", before=SCENE + save, look_at=scene)
    assert run.code == 0, run.err
    return run.state


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def rounded_box():
    box = trimesh.creation.box().subdivide().subdivide().subdivide()
    trimesh.smoothing.filter_laplacian(box, iterations=4)
    return box


@pytest.mark.parametrize("ending", ["obj", "ply", "stl"])
def test_files_get_the_same_as_outside_blender(folder, ending):
    rounded_box().export(f"in.{ending}")
    # As in the paper: where two sides are as good, rounding decides which a face takes by default.
    words = "--time", "64", *AS_IN_THE_PAPER
    run = blender("sharpen-geometry", f"in.{ending}", f"out.{ending}", *words)
    assert run.code == 0, run.err
    assert f"in.{ending} -> out.{ending}: moved " in run.out
    sharpen_file(f"in.{ending}", f"wanted.{ending}", core.GeometrySettings.of_paper(time=64))
    old, new, wanted = (
        trimesh.load_mesh(f"{name}.{ending}").vertices for name in ("in", "out", "wanted")
    )
    assert np.median(nearest(new, wanted)) < 1e-4
    assert nearest(old, wanted).max() > 0.01
    assert sorted(path.name for path in folder.iterdir() if path.name.startswith(".")) == []


@pytest.mark.parametrize("ending", ["blend", "obj"])
def test_names_may_hold_spaces_and_letters_beyond_ascii(scene, old, folder, ending):
    inside = folder / "Für Änne & 三角"
    inside.mkdir()
    source, target = inside / f"größe 1 (копия).{ending}", inside / f"größe 2.{ending}"
    if ending == "blend":
        shutil.copy(scene, source)
    else:
        rounded_box().export(source)
    run = blender("sharpen-geometry", source, target, "--time", "64")
    assert run.code == 0, run.err
    assert target.stat().st_size > 0


def nearest(points, others):
    return cKDTree(others).query(points)[0]


def test_blend_file_keeps_everything_else(scene, old, folder):
    run = blender("sharpen-geometry", scene, "out.blend", "--time", "inf", look_at="out.blend")
    assert run.code == 0, run.err
    new = run.state
    assert changed(old, new).any()
    assert not changed(old, new, "Hidden").any()
    assert "hidden, so left as they are: Hidden" in run.out
    old = copy.deepcopy(old)
    for state in (old, new):
        for mesh in state["meshes"].values():
            del mesh["points"]
    assert new == old
    assert old["meshes"]["Seen"]["materials"] == ["Paint"]
    assert old["meshes"]["Seen"]["uvs"] == ["Layout"]


def test_the_open_file_is_a_dash(scene, old, folder):
    run = blender(
        "sharpen-geometry",
        "-",
        "out.blend",
        before=f"bpy.ops.wm.open_mainfile(filepath={str(scene)!r})",
        look_at="out.blend",
    )
    assert run.code == 0, run.err
    assert changed(old, run.state).any()
    both = blender("sharpen-geometry", "-", scene, "out")
    assert both.code == 2
    assert "must be the only input" in both.err


def test_an_object_is_chosen_by_name(scene, old, folder):
    run = blender("sharpen-geometry", scene, "out.blend", "--object", "Hidden", look_at="out.blend")
    assert run.code == 0, run.err
    assert changed(old, run.state, "Hidden").any()
    assert not changed(old, run.state).any()
    wrong = blender("sharpen-geometry", scene, "other.blend", "--object", "Nobody")
    assert wrong.code == 1
    assert "no mesh object Nobody; the scene has: Seen, Hidden" in wrong.err
    assert not Path("other.blend").exists()


@pytest.mark.parametrize("invert", [False, True])
def test_mask_is_a_vertex_group(scene, old, folder, invert):
    words = ["--invert-mask"] if invert else []
    run = blender(
        "sharpen-geometry", scene, "out.blend", "--mask", "Left", *words, look_at="out.blend"
    )
    assert run.code == 0, run.err
    moved = changed(old, run.state)
    free = np.array(old["meshes"]["Seen"]["group"]) != invert
    assert not moved[~free].any()
    assert moved[free].any()


def test_unknown_vertex_group_fails(scene, old, folder):
    run = blender("sharpen-geometry", scene, "out.blend", "--mask", "Nobody")
    assert run.code == 1
    assert "no vertex group named 'Nobody'" in run.err
    assert not Path("out.blend").exists()


def test_time_zero_moves_nothing(scene, old, folder):
    run = blender("sharpen-geometry", scene, "out.blend", "--time", "0", look_at="out.blend")
    assert run.code == 0, run.err
    assert "moved 0 of" in run.out
    assert not changed(old, run.state).any()


@pytest.mark.parametrize("ending", ["glb", "fbx", "usdc", "obj"])
def test_blend_becomes_other_formats_and_back(scene, old, folder, ending):
    assert blender("sharpen-geometry", scene, f"out.{ending}").code == 0
    run = blender(
        "sharpen-geometry", f"out.{ending}", "back.blend", "--time", "0", look_at="back.blend"
    )
    assert run.code == 0, run.err
    assert any(mesh["materials"] == ["Paint"] for mesh in run.state["meshes"].values())
    assert any("Seen" in name for name in run.state["objects"])


PAINT = """
import numpy as np
def paint(obj, name, kind, domain):
    layer = obj.data.color_attributes.new(name, kind, domain)
    points = np.array([v.co for v in obj.data.vertices])
    share = 1 / (1 + np.exp(-points[:, 2:] / 0.2))
    colors = np.column_stack([share * [0.9, 0.2, 0.1] + (1 - share) * [0.1, 0.3, 0.8], 1 - share])
    if domain == "CORNER":
        colors = colors[[loop.vertex_index for loop in obj.data.loops]]
    layer.data.foreach_set("color", colors.astype(np.float32).reshape(-1))
    return layer

for obj in seen, hidden:
    paint(obj, "Coat", "BYTE_COLOR", "CORNER")
    paint(obj, "Under", "FLOAT_COLOR", "POINT")
    obj.data.color_attributes.active_color = obj.data.color_attributes["Coat"]
"""

LOOK_AT_COLORS = """
import numpy as np
bpy.ops.wm.open_mainfile(filepath={path!r})
def stored(obj):
    return {{a.name: [list(e.color) for e in a.data] for a in obj.data.color_attributes}}
print(json.dumps({{o.name: stored(o) for o in bpy.data.objects if o.type == "MESH"}}))
"""


def colors_in(path, *words, before=""):
    look = LOOK_AT_COLORS.format(path=str(Path(path).absolute()))
    run = blender(*words, before=before, after=look)
    assert run.code == 0, run.err
    stored = json.loads(run.out.splitlines()[-1])
    return {
        name: {layer: np.array(v) for layer, v in layers.items()} for name, layers in stored.items()
    }, run


def save(name):
    path = str(Path(name).absolute())
    return f"bpy.ops.wm.save_as_mainfile(filepath={path!r})"


def changes(old, new):
    return {
        (name, layer)
        for name, layers in old.items()
        for layer, values in layers.items()
        if (values != new[name][layer]).any()
    }


def test_colors_of_blend_files(folder):
    old, _ = colors_in("in.blend", "--version", before=SCENE + PAINT + save("in.blend"))
    new, run = colors_in("a.blend", "sharpen-colors", "in.blend", "a.blend", "--time", "inf")
    assert changes(old, new) == {("Seen", "Coat")}
    coat = old["Seen"]["Coat"], new["Seen"]["Coat"]
    np.testing.assert_array_equal(coat[0][:, 3], coat[1][:, 3])
    changed = (coat[0] != coat[1]).any(axis=1)
    assert f"in.blend -> a.blend: changed {changed.sum()} of {len(changed)} colors in " in run.out
    assert "hidden, so left as they are: Hidden" in run.out

    words = ["--attribute", "Under", "--mask", "Left"]
    new, _ = colors_in("b.blend", "sharpen-colors", "in.blend", "b.blend", *words)
    assert changes(old, new) == {("Seen", "Under")}
    still, run = colors_in("c.blend", "sharpen-colors", "in.blend", "c.blend", "--time", "0")
    assert changes(old, still) == set()
    assert "changed 0 of" in run.out


def test_colors_may_become_live(folder):
    old, _ = colors_in("in.blend", "--version", before=SCENE + PAINT + save("in.blend"))
    words = "sharpen-colors", "in.blend", "a.blend", "--time", "inf", "--live"
    new, run = colors_in("a.blend", *words)
    assert changes(old, new) == set()
    assert "changed 0 of" not in run.out
    count = 'print("LIVE", [m.name for m in bpy.data.objects["Seen"].modifiers])\n'
    opened = f"bpy.ops.wm.open_mainfile(filepath={str(folder / 'a.blend')!r})\n"
    seen = blender("--version", before="import bpy\n" + opened + count)
    assert "LIVE ['Shock Filter Colors']" in seen.out


def test_missing_colors_fail(scene, old, folder):
    run = blender("sharpen-colors", scene, "out.blend")
    assert run.code == 1
    assert "Seen: it has no color attribute; add one" in run.err
    assert not Path("out.blend").exists()


def painted_ball(name):
    ball = trimesh.creation.icosphere(subdivisions=4)
    share = 1 / (1 + np.exp(-ball.vertices[:, 2:] / 0.08))
    colors = share * [0.9, 0.2, 0.1] + (1 - share) * [0.1, 0.3, 0.8]
    rgba = np.column_stack([255 * colors, np.full(len(colors), 255)]).astype(np.uint8)
    ball.visual.vertex_colors = rgba
    ball.export(name)


def colored_points(name):
    """Positions, and colors from 0 to 255."""
    if name.endswith(".obj"):
        lines = [line.split() for line in Path(name).read_text().splitlines()]
        rows = np.array([words[1:] for words in lines if words[:1] == ["v"]], dtype=float)
        return rows[:, :3], 255 * rows[:, 3:]
    mesh = trimesh.load_mesh(name, process=False)
    return mesh.vertices, mesh.visual.vertex_colors[:, :3].astype(float)


@pytest.mark.parametrize("ending", ["ply", "obj"])
def test_colored_files_get_nearly_the_same_as_outside_blender(folder, ending):
    names = [f"{name}.{ending}" for name in ("in", "out", "wanted")]
    painted_ball(names[0])
    run = blender("sharpen-colors", *names[:2], "--time", "64")
    assert run.code == 0, run.err
    sharpen_colors_file(names[0], names[2], core.ShockSettings(time=64))
    (points, old), (new_points, new), (_, wanted) = map(colored_points, names)
    assert len(new_points) == len(points)
    new = new[cKDTree(new_points).query(points)[1]]
    assert abs(wanted - old).max() > 10
    # Blender sharpens float colors in linear space, and rounds down when it writes PLY files.
    assert abs(new - wanted).max() < abs(old - wanted).max()
    assert np.corrcoef((new - old).ravel(), (wanted - old).ravel())[0, 1] > 0.8


def soft_edge(dtype="uint8"):
    rows, columns = np.mgrid[:24, :30]
    slope = np.tanh((columns - 15 + 3 * np.sin(rows / 5)) / 4) * 0.4 + 0.5
    values = np.dstack([slope, slope * 0.8, slope * 0.6])
    return np.rint(values * np.iinfo(dtype).max).astype(dtype)


@pytest.mark.parametrize("ending", ["png", "bmp", "tif"])
def test_images_get_the_same_as_outside_blender(folder, ending):
    pixels = soft_edge()
    Path("in").mkdir()
    for name in ("a", "b"):
        Image.fromarray(pixels).save(f"in/{name}.{ending}")
    run = blender("sharpen-image", f"in/*.{ending}", "out", "--time", "64")
    assert run.code == 0, run.err
    wanted = core.sharpen_image(pixels, core.ImageSettings(time=64))
    for name in ("a", "b"):
        with Image.open(f"out/{name}.{ending}") as image:
            np.testing.assert_array_equal(np.array(image), wanted)
    changed = (wanted != pixels).any(axis=2).sum()
    assert changed > 100
    assert run.out.count(f": changed {changed} of 720 pixels in ") == 2
    still = blender("sharpen-image", f"in/a.{ending}", f"same.{ending}", "--time", "0")
    assert still.code == 0, still.err
    assert Path(f"same.{ending}").read_bytes() == Path(f"in/a.{ending}").read_bytes()


def test_gray_images_of_16_bits_stay_so(folder):
    pixels = soft_edge("uint16")[..., 0]
    Image.fromarray(pixels).save("in.png")
    run = blender("sharpen-image", "in.png", "out.png", "--time", "64")
    assert run.code == 0, run.err
    with Image.open("out.png") as image:
        result = np.array(image)
        assert image.mode == "I;16"
    assert (result != pixels).any()
    assert len(np.unique(result)) > 256


@pytest.mark.parametrize("kind", ["uint8", "uint16"])
def test_images_are_enlarged(folder, kind):
    pixels = soft_edge(kind)
    pixels = pixels if kind == "uint8" else pixels[..., 0]
    Image.fromarray(pixels).save("in.png")
    run = blender("sharpen-image", "in.png", "out.png", "--enlarge", "2")
    assert run.code == 0, run.err
    assert ": changed 2880 of 2880 pixels in " in run.out
    wanted = core.sharpen_image(pixels, core.ImageSettings(enlarge=2))
    with Image.open("out.png") as image:
        result = np.array(image)
        assert image.mode == ("RGB" if kind == "uint8" else "I;16")
    assert result.shape == wanted.shape
    # Blender filters 16 bits as linear light.
    assert abs(result.astype(float) - wanted).mean() < 0.1 * np.iinfo(kind).max


def test_images_that_are_refused(folder):
    Image.fromarray(soft_edge()).save("in.png")
    Path("bad.png").write_text("no image")
    for words, sentence in {
        ("in.png", "out.jpg"): "in.png is a PNG file, and Blender keeps its depth only in this",
        ("bad.png", "out.png"): "bad.png cannot be read; is it an image, and not damaged?",
        ("gone.png", "out.png"): "no file gone.png",
        ("in.png", "out.mp3"): "out.mp3: this ending cannot be handled here; use one of .bmp, ",
        ("in.png", "in.png"): "in.png exists already; add --overwrite",
    }.items():
        run = blender("sharpen-image", *words)
        assert run.code == 1
        assert sentence in run.err
    assert sorted(path.name for path in folder.iterdir()) == ["bad.png", "in.png"]


TEXTURED = """
def sheet(name, left, image):
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata([(left, 0, 0), (left + 1, 0, 0), (left + 1, 2, 0), (left, 2, 0)], [],
                     [(0, 1, 2, 3)])
    layer = mesh.uv_layers.new(name="Layout")
    for loop in mesh.loops:
        x, y, _ = mesh.vertices[loop.vertex_index].co
        layer.uv[loop.index].vector = x / 2, y / 2
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    material.node_tree.nodes.new("ShaderNodeTexImage").image = image
    mesh.materials.append(material)
    obj = bpy.data.objects.new(name, mesh)
    bpy.context.collection.objects.link(obj)

image = bpy.data.images.load({image!r})
sheet("Left", 0, image)
sheet("Right", 1, image)
sheet("Stone", 0, bpy.data.images.new("Stone", 4, 4))
bpy.ops.wm.save_as_mainfile(filepath={path!r})
"""


@pytest.fixture
def textured(folder):
    """Two sheets that show one image, and one that shows another: sheets.blend and wood.png."""
    Image.fromarray(soft_edge()).save("wood.png")
    image, path = (str(folder / name) for name in ("wood.png", "sheets.blend"))
    run = blender("--version", before=TEXTURED.format(image=image, path=path))
    assert run.code == 0, run.err


def flat_sheet():
    """The surface that both sheets of `textured` make together, at the same density."""
    points = [(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0)]
    mesh = core.TriangleMesh(points, [(0, 1, 2), (0, 2, 3)])
    uv = np.array(points, dtype=float)[[(0, 1, 2), (0, 2, 3)], :2] / 2
    return mesh, uv


def pixels_of(name):
    with Image.open(name) as image:
        return np.array(image)


def test_textures_are_sharpened_on_the_objects_that_show_them(textured):
    run = blender("sharpen-texture", "sheets.blend", "wood.png", "out.png", "--time", "1024")
    assert run.code == 0, run.err
    settings = core.TextureSettings(time=1024)
    wanted = core.sharpen_texture(*flat_sheet(), soft_edge()[::-1], settings)[::-1]
    assert abs(wanted.astype(int) - soft_edge()).max() > 10
    np.testing.assert_allclose(pixels_of("out.png").astype(int), wanted, atol=3)
    changed = (pixels_of("out.png") != soft_edge()).any(axis=2).sum()
    assert f"wood.png -> out.png: changed {changed} of 720 pixels in " in run.out
    np.testing.assert_array_equal(pixels_of("wood.png"), soft_edge())

    words = ["--object", "Left", "--gutter", "0"]
    run = blender(
        "sharpen-texture", "sheets.blend", "wood.png", "left.png", "--time", "1024", *words
    )
    assert run.code == 0, run.err
    left = pixels_of("left.png")
    assert (left[:, 4:14] != soft_edge()[:, 4:14]).any()
    np.testing.assert_array_equal(left[:, 17:-1], soft_edge()[:, 17:-1])


def test_masks_of_textures_are_images(textured):
    weights = np.zeros((24, 30), dtype=np.uint8)
    weights[:12] = 255
    Image.fromarray(weights).save("mask.png")
    for words, kept in (([], slice(13, -1)), (["--invert-mask"], slice(1, 11))):
        run = blender(
            "sharpen-texture", "sheets.blend", "wood.png", "out.png", "--overwrite", "--time",
            "256", "--gutter", "0", "--mask", "mask.png", *words,
        )  # fmt: skip
        assert run.code == 0, run.err
        new, old = pixels_of("out.png")[:, 1:-1], soft_edge()[:, 1:-1]
        np.testing.assert_array_equal(new[kept], old[kept])
        assert (new != old).any()


def test_gains_of_textures_are_painted_in_images(textured):
    grays = np.full((24, 30), 128, dtype=np.uint8)
    for middle, is_kept in ((128, True), (255, False)):
        grays[:, :15] = middle
        Image.fromarray(grays).save("map.png")
        run = blender(
            "filter-texture", "sheets.blend", "wood.png", "out.png", "--overwrite", "--gutter", "0",
            "--radius", "4", "--gain-map", "map.png",
        )  # fmt: skip
        assert run.code == 0, run.err
        changed = (pixels_of("out.png") != soft_edge()).any(axis=2)
        assert changed.any() != is_kept


def test_pictures_of_one_surface_become_one(textured):
    x = np.broadcast_to(np.arange(30), (24, 30))
    for name, known, gray in (("wood.png", x < 18, 90), ("right.png", x >= 12, 150)):
        image = np.stack([np.where(known, gray, 0)] * 3 + [255 * known], axis=-1)
        Image.fromarray(image.astype(np.uint8)).save(name)
    words = ["stitch-textures", "sheets.blend", "wood.png", "out.png", "--radius", "1000"]
    run = blender(*words, "--with", "right.png")
    assert run.code == 0, run.err
    inner = pixels_of("out.png")[2:-2, 2:-2].astype(int)
    assert (inner[..., 3] == 255).all()
    assert abs(inner[..., :3] - inner[0, 0, :3]).max() <= 6
    run = blender(*words, "--overwrite", *["--with", "right.png"] * 4)
    assert run.code == 1
    assert "--with is given 4 times, and Blender joins 4 pictures at most" in run.err


def test_a_mesh_and_a_texture_from_other_programs(folder):
    points = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"
    uv = "vt 0.1 0.1\nvt 0.6 0.1\nvt 0.6 0.9\nvt 0.1 0.9\n"
    Path("mesh.obj").write_text(points + uv + "f 1/1 2/2 3/3 4/4\n")
    Image.fromarray(soft_edge()).save("a.png")
    Image.fromarray(soft_edge()).save("b.png")
    run = blender("dilate-texture", "mesh.obj", "a.png", "b.png", "out/", "--gutter", "3")
    assert run.code == 0, run.err
    np.testing.assert_array_equal(pixels_of("out/a.png"), pixels_of("out/b.png"))
    changed = (pixels_of("out/a.png") != soft_edge()).any(axis=2)
    assert changed[:, 18:22].any()
    assert not changed[4:-4, 4:17].any()
    assert not changed[:, 23:].any()


@pytest.mark.parametrize("kind", ["active", "face", "chart"])
def test_texture_masks_are_as_outside_blender(folder, kind):
    points = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"
    uv = "vt 0.1 0.1\nvt 0.6 0.1\nvt 0.6 0.9\nvt 0.1 0.9\n"
    Path("mesh.obj").write_text(points + uv + "f 1/1 2/2 3/3\nf 1/1 3/3 4/4\n")
    Image.fromarray(soft_edge()).save("like.png")
    for out in ("out.npy", "out.exr", "out.png"):
        run = blender("texture-mask", "mesh.obj", out, "--kind", kind, "--like", "like.png")
        assert run.code == 0, run.err
        texture_mask_file("mesh.obj", f"wanted-{out}", kind, (24, 30))
        assert f"mesh.obj -> {out}: 1 charts, " in run.out
    np.testing.assert_array_equal(np.load("out.npy"), np.load("wanted-out.npy"))
    shown, wanted = pixels_of("out.png"), pixels_of("wanted-out.png")
    np.testing.assert_array_equal(
        shown.reshape(24, 30, -1)[..., :1], wanted.reshape(24, 30, -1)[..., :1]
    )
    wanted = read_exr(Path("wanted-out.exr")).pixels
    shown = read_exr(Path("out.exr")).pixels
    np.testing.assert_array_equal(shown[..., 0], wanted)


@pytest.mark.parametrize(
    "words",
    [
        ("geodesic-distance", "--vertices", "0", "--look", "gradient"),
        ("surface-streaks", "--along", "x"),
        ("surface-pattern", "--steps", "20"),
    ],
)
def test_images_from_the_shape_are_as_outside_blender(folder, words):
    points = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"
    uv = "vt 0.1 0.1\nvt 0.6 0.1\nvt 0.6 0.9\nvt 0.1 0.9\n"
    Path("mesh.obj").write_text(points + uv + "f 1/1 2/2 3/3\nf 1/1 3/3 4/4\n")
    command, *flags = words
    flags += ["--size", "40x32"]
    for name in ("out.npy", "out.png"):
        run = blender(command, "mesh.obj", name, *flags)
        assert run.code == 0, run.err
        assert cli.main([command, "mesh.obj", f"wanted-{name}", *flags]) == 0
    found, wanted = np.load("out.npy"), np.load("wanted-out.npy")
    assert found.shape == (32, 40)
    if command == "geodesic-distance":  # importers turn axes, and so the noise of the others
        np.testing.assert_allclose(found, wanted, atol=1e-5)
    assert np.ptp(pixels_of("out.png")[..., :3]) > 50


def test_what_is_wrong_with_textures_is_named(folder):
    Path("bare.obj").write_text("v 0 0 0\nv 1 0 0\nv 1 1 0\nf 1 2 3\n")
    Image.fromarray(soft_edge()).save("in.png")
    for words, sentence in {
        ("sharpen-texture", "bare.obj", "in.png", "out.png"): "no UV map",
        ("sharpen-texture", "gone.obj", "in.png", "out.png"): "no file gone.obj",
        ("sharpen-texture", "bare.obj", "gone.png", "out.png"): "no file gone.png",
        ("sharpen-texture", "bare.obj", "in.png", "out.mp3"): "out.mp3: this ending cannot be",
        ("texture-mask", "bare.obj", "out.png", "--size", "8x8"): "it has no UV map; unwrap it",
        ("texture-mask", "bare.obj", "out.ply", "--size", "8x8"): "out.ply: this ending cannot be",
    }.items():
        run = blender(*words)
        assert run.code == 1
        assert sentence in run.err
    assert sorted(path.name for path in folder.iterdir()) == ["bare.obj", "in.png"]


def noisy_box(name):
    box = trimesh.creation.box().subdivide().subdivide().subdivide().subdivide()
    box.vertices += 0.01 * np.random.default_rng(0).normal(size=box.vertices.shape)
    box.export(name)
    return trimesh.load_mesh(name)


@pytest.mark.parametrize("more", [[], ["--repeat", "2", "--then-sharpen", "64"]])
def test_meshes_are_denoised_as_outside_blender(folder, more):
    before = noisy_box("in.ply")
    run = blender("denoise-geometry", "in.ply", "out.ply", *more)
    assert run.code == 0, run.err
    assert f"in.ply -> out.ply: moved {len(before.vertices)} of {len(before.vertices)}" in run.out
    settings = core.BeltramiGeometrySettings(repeat=2 if more else 3)
    denoise_file("in.ply", "wanted.ply", settings, sharpen_time=64 if more else None)
    new, wanted = (trimesh.load_mesh(f"{name}.ply").vertices for name in ("out", "wanted"))
    assert np.median(nearest(new, wanted)) < 1e-4
    assert nearest(before.vertices, wanted).max() > 0.01


def test_colors_of_blend_files_are_denoised(folder):
    words = ["in.blend", "a.blend", "--beta", "0", "--time", "4", "--mask", "Left"]
    old, _ = colors_in("in.blend", "--version", before=SCENE + PAINT + save("in.blend"))
    new, run = colors_in("a.blend", "denoise-colors", *words, "--attribute", "Under")
    assert changes(old, new) == {("Seen", "Under")}
    assert "hidden, so left as they are: Hidden" in run.out
    words[1] = "b.blend"
    sharper, _ = colors_in("b.blend", "denoise-colors", *words, "--then-sharpen", "4096")
    coats = [state["Seen"]["Coat"] for state in (old, new, sharper)]
    assert (coats[2] != coats[0]).any()
    assert (coats[1] == coats[0]).all()


def test_images_are_denoised_as_outside_blender(folder):
    noise = np.random.default_rng(0).normal(size=(24, 30, 3)) * 12
    pixels = np.clip(soft_edge() + noise, 0, 255).astype(np.uint8)
    Image.fromarray(pixels).save("in.png")
    run = blender("denoise-image", "in.png", "out.png", "--beta", "9")
    assert run.code == 0, run.err
    wanted = core.beltrami_image(pixels, core.BeltramiSettings(beta=9))
    assert abs(wanted.astype(int) - pixels).mean() > 4
    assert abs(pixels_of("out.png").astype(int) - wanted).max() <= 1
    run = blender("denoise-image", "in.png", "sharp.png", "--then-sharpen", "4096")
    assert run.code == 0, run.err
    assert abs(pixels_of("sharp.png").astype(int) - wanted).max() > 10


SMOOTH = """
from mathutils import Vector
seen.data.shade_smooth()
seen.data.normals_split_custom_set([Vector((0, 0, 1))] * len(seen.data.loops))
"""

LOOK_AT_SHADING = """
bpy.ops.wm.open_mainfile(filepath={path!r})
mesh = bpy.data.objects["Seen"].data
keys = mesh.shape_keys.key_blocks if mesh.shape_keys else []
print(json.dumps(dict(
    own_normals=mesh.has_custom_normals,
    upwards=[c.vector.z for c in mesh.corner_normals],
    sharp=sum(edge.use_edge_sharp for edge in mesh.edges),
    points=[list(v.co) for v in mesh.vertices],
    keys={{key.name: [list(point.co) for point in key.data] for key in keys}},
    values=[key.value for key in keys],
    mirror=[mesh.use_mirror_x, mesh.use_mirror_y, mesh.use_mirror_z])))
"""


@pytest.fixture
def shading(folder):
    """Return a function that sharpens a scene with smooth faces, and says what the file holds."""
    run = blender("--version", before=SCENE + SMOOTH + save("smooth.blend"))
    assert run.code == 0, run.err

    def sharpened(*words, command="sharpen-geometry"):
        look = LOOK_AT_SHADING.format(path=str(Path("out.blend").absolute()))
        words = (command, "smooth.blend", "out.blend", "--overwrite", *words)
        run = blender(*words, after=look)
        assert run.code == 0, run.err
        return json.loads(run.out.splitlines()[-1]) | {"said": run.out}

    return sharpened


def test_custom_normals_are_kept_set_anew_or_removed(shading):
    kept = shading()
    assert kept["own_normals"]
    assert np.mean(np.array(kept["upwards"]) > 0.9) > 0.8  # they turn with their faces
    assert kept["sharp"] == 0
    anew = shading("--custom-normals", "recompute")
    assert anew["own_normals"]
    assert min(anew["upwards"]) < -0.9
    assert not shading("--custom-normals", "clear", command="denoise-geometry")["own_normals"]


def test_edges_are_marked_sharp_by_their_angle(shading):
    def marked(*words):
        words = *words, "--custom-normals", "recompute"
        return shading(*words, command="denoise-geometry")

    default, wide = marked("--mark-sharp"), marked("--sharp-angle", "4")
    assert default["sharp"] == marked("--mark-sharp", "--sharp-angle", "30")["sharp"]
    assert wide["sharp"] > 0
    assert default["sharp"] < wide["sharp"]
    wrong = blender("sharpen-geometry", "smooth.blend", "x.blend", "--sharp-angle", "200")
    assert wrong.code == 2
    assert "angle from 0 to 180" in wrong.err


def asymmetry(state, axis):
    points = np.array(state["points"])
    mirrored = points * np.where(np.arange(3) == axis, -1, 1)
    return nearest(mirrored, points).max()


def test_what_is_symmetric_stays_so_on_request(shading):
    plain, one = shading(), shading("--mirror", "x")
    assert asymmetry(plain, 0) > 1e-3
    assert asymmetry(one, 0) == 0.0
    both = shading("--mirror", "x", "--mirror", "z", command="denoise-geometry")
    assert asymmetry(both, 0) == asymmetry(both, 2) == 0.0
    assert one["mirror"] == both["mirror"] == [False] * 3


def test_the_result_may_be_a_new_shape_key(shading):
    moved, keyed = shading(), shading("--new-shape-key", "--mask", "Left")
    assert moved["keys"] == {}
    assert list(keyed["keys"]) == ["Basis", "Sharpened"]
    assert keyed["values"][1] == 1.0
    basis, new = map(np.array, keyed["keys"].values())
    np.testing.assert_array_equal(np.array(keyed["points"]), basis)
    changed = (basis != new).any(axis=1).sum()
    assert 0 < changed < len(basis)
    assert f"moved {changed} of {len(basis)} vertices in " in keyed["said"]


@pytest.mark.parametrize("flag", ["--live", "--new-shape-key"])
def test_other_formats_show_the_new_shape(folder, flag):
    rounded_box().export("in.ply")
    run = blender("sharpen-geometry", "in.ply", "key.ply", flag)
    assert run.code == 0, run.err
    assert blender("sharpen-geometry", "in.ply", "moved.ply").code == 0
    old, key, moved = (trimesh.load_mesh(f"{n}.ply").vertices for n in ("in", "key", "moved"))
    assert nearest(old, moved).max() > 0.01
    np.testing.assert_allclose(key, moved, atol=1e-6)


def test_the_result_may_be_a_new_object(folder):
    finer = 'seen.modifiers.new("Finer", "SUBSURF").subdivision_type = "SIMPLE"\n'
    save = f"bpy.ops.wm.save_as_mainfile(filepath={str(folder / 'in.blend')!r})"
    assert blender("--version", before=SCENE + finer + save).code == 0
    words = "in.blend", "out.blend", "--object", "Seen", "--new-object"
    run = blender("sharpen-geometry", *words, look_at="out.blend")
    assert run.code == 0, run.err
    meshes = run.state["meshes"]
    new, old = meshes["Seen sharpened"]["points"], meshes["Seen"]["points"]
    assert len(new) > len(old)
    assert f" of {len(new)} vertices in " in run.out
    wrong = blender("sharpen-geometry", *words, "--new-shape-key")
    assert wrong.code == 2
    assert "not allowed with" in wrong.err


def test_several_inputs_with_a_bad_one(scene, old, folder):
    rounded_box().export("a.obj")
    Path("broken.ply").write_text("ply\n")
    Path("song.mp3").write_text("la")
    words = ["a.obj", "broken.ply", "gone.obj", "song.mp3", scene]
    run = blender("sharpen-geometry", *words, "out/")
    assert run.code == 1
    assert sorted(path.name for path in Path("out").glob("*.*")) == [
        "a.mtl",
        "a.obj",
        "scene.blend",
    ]
    failures = [line for line in run.err.splitlines() if line.startswith("Failed: ")]
    assert len(failures) == 3
    assert "no file gone.obj" in failures[1]
    assert "song.mp3: this Blender cannot handle this ending; use one of .blend, " in failures[2]


# From the moment of writing on, no file may grow further than on a disk that is full by then.
FULL_DISK = """
import resource
from shock_filter.core.files import output
staged = output.staged
def on_a_full_disk(*words):
    resource.setrlimit(resource.RLIMIT_FSIZE, (3000, 3000))
    return staged(*words)
output.staged = on_a_full_disk
"""


@pytest.mark.parametrize(
    ("command", "endings"),
    [
        ("sharpen-image", (".png", ".tga", ".jpg", ".exr", ".tif", ".bmp")),
        ("sharpen-geometry", (".ply", ".obj", ".stl", ".glb")),
    ],
)
def test_half_a_file_is_never_left(folder, command, endings):
    pixels = np.random.default_rng(0).integers(0, 255, (99, 99, 3), dtype=np.uint8)
    for ending in endings:
        if command == "sharpen-geometry":
            rounded_box().export(f"in{ending}")
        elif ending == ".exr":
            write_exr(Path("in.exr"), ImageFile(pixels, ""), pixels.astype(np.float32))
        else:
            Image.fromarray(pixels).save(f"in{ending}")
    names = [f"in{ending}" for ending in endings]
    run = blender(command, *names, "out/", before=FULL_DISK, alone=True)
    assert run.code == 1
    failures = [line for line in run.err.splitlines() if line.startswith("Failed: ")]
    assert len(failures) == len(endings)
    for line in failures:
        assert "The disk of" in line
        assert "is full" in line
    assert not list(Path("out").iterdir())


def test_half_a_blend_file_is_never_left(scene, old, folder):
    shutil.copyfile(scene, "out.blend")
    for words in (["new.blend"], ["out.blend", "--overwrite"]):
        run = blender("sharpen-geometry", scene, *words, before=FULL_DISK, alone=True)
        assert run.code == 1
        assert "The disk of" in run.err
        assert "is full" in run.err
    assert [path.name for path in folder.iterdir()] == ["out.blend"]
    assert Path("out.blend").read_bytes() == scene.read_bytes()


# A writer that reports success and leaves a file cut short.
SPOILED = """
import contextlib, pathlib
from shock_filter.core.files import output
staged = output.staged
@contextlib.contextmanager
def spoiled(*words):
    with staged(*words) as path:
        from shock_filter.shock_addon.commands import blender_files
        reading_back = blender_files.reading_back
        def cut(name):
            path.write_bytes(path.read_bytes()[:60])
            blender_files.reading_back = reading_back
            return reading_back(name)
        blender_files.reading_back = cut
        yield path
output.staged = spoiled
"""


def test_what_cannot_be_read_back_replaces_nothing(scene, old, folder):
    rounded_box().export("in.ply")
    border = 255 / (1 + np.exp(-np.linspace(-16, 16, 99)))
    Image.fromarray(np.tile(border, (99, 1)).astype(np.uint8)).save("in.png")
    for command, source, target in (
        ("sharpen-image", "in.png", "out.png"),
        ("sharpen-geometry", "in.ply", "out.glb"),
        ("sharpen-geometry", "in.ply", "out.ply"),
        ("sharpen-geometry", scene, "out.blend"),
    ):
        Path(target).write_text("old")
        run = blender(command, source, target, "--overwrite", before=SPOILED, alone=True)
        assert run.code == 1
        assert f"{target} was not written: it could not be read back" in run.err
        assert Path(target).read_text() == "old"


def test_a_blend_file_finds_its_textures_from_where_it_is_saved(scene, old, folder):
    Path("textures").mkdir()
    Image.fromarray(soft_edge()).save("textures/wood.png")
    save = """
bpy.ops.wm.open_mainfile(filepath={scene!r})
bpy.data.images.load(os.path.abspath("textures/wood.png")).use_fake_user = True
bpy.ops.wm.save_as_mainfile(filepath=os.path.abspath("in.blend"), relative_remap=True)
bpy.ops.file.make_paths_relative()
bpy.ops.wm.save_mainfile()
"""
    after = """
bpy.ops.wm.open_mainfile(filepath=os.path.abspath("deep/out.blend"))
print(bpy.data.images["wood.png"].filepath)
"""
    Path("deep").mkdir()
    words = ["in.blend", "deep/out.blend"]
    run = blender("sharpen-geometry", *words, before=save.format(scene=str(scene)), after=after)
    assert run.code == 0, run.err
    assert run.out.splitlines()[-1] == "//../textures/wood.png"
    assert [path.name for path in Path("deep").iterdir()] == ["out.blend"]


def test_a_file_that_is_cut_before_its_faces_is_named(folder):
    Path("cut.obj").write_text("o Cut\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n")
    Image.fromarray(soft_edge()).save("in.png")
    for words in (
        ("sharpen-geometry", "cut.obj", "out.obj"),
        ("sharpen-texture", "cut.obj", "in.png", "out.png"),
    ):
        run = blender(*words)
        assert run.code == 1
        assert "cut.obj has no faces; is it a mesh, and not cut short?" in run.err
    assert sorted(path.name for path in folder.iterdir()) == ["cut.obj", "in.png"]


def test_usage_errors_and_refusals(scene, old, folder):
    bad = blender("sharpen-geometry", scene, "out.blend", "--smoothing-passes", "-3")
    assert bad.code == 2
    assert "smoothing_passes is -3; give a value from 0 to 1000" in bad.err
    content = scene.read_bytes()
    again = blender("sharpen-geometry", scene, scene)
    assert again.code == 1
    assert "exists already; add --overwrite" in again.err
    assert scene.read_bytes() == content


def test_nothing_stays_registered(scene, old, folder):
    after = """
operator = hasattr(bpy.types, "SHOCK_FILTER_OT_sharpen_geometry")
print(operator, hasattr(bpy.types.Scene, "shock_filter"))
"""
    run = blender("sharpen-geometry", scene, "out.blend", after=after)
    assert run.out.splitlines()[-1] == "False False"


def test_kernels_are_left_to_the_operator_to_load(scene, old, folder):
    run = blender(
        "sharpen-geometry",
        "gone.obj",
        "out.obj",
        after="print('shock_filter.core.mesh.triangle_mesh' in sys.modules)",
        alone=True,
    )
    assert run.code == 1
    assert run.out.splitlines()[-1] == "False"


def test_an_unforeseen_error_is_shown_and_fails(scene, old, folder):
    before = "import pathlib; pathlib.Path.exists = lambda path: 1 / 0"
    run = blender("sharpen-geometry", scene, "out.blend", before=before, alone=True)
    assert run.code == 1
    assert "ZeroDivisionError" in run.err


def test_an_error_before_the_start_fails_too(scene, old, folder):
    before = "bpy.utils.register_class = None"
    run = blender("sharpen-geometry", scene, "out.blend", before=before, alone=True)
    assert run.code == 1
    assert "TypeError" in run.err


def test_ctrl_c_stops_the_filter_and_writes_nothing(scene, old, folder):
    before = """
import os, signal
from shock_filter.core.base import parallel
ask = parallel.ask
def interrupted(fraction=0.0):
    os.kill(os.getpid(), signal.SIGINT)
    ask(fraction)
parallel.ask = interrupted
"""
    run = blender("sharpen-geometry", scene, "out.blend", before=before, alone=True)
    assert run.code == 130, run.err
    assert not (folder / "out.blend").exists()


def test_enabled_extension_is_used_and_stays(scene, old, folder):
    before = """
import addon_utils
module = addon_utils.enable("shock_filter")
"""
    after = """
from shock_filter.shock_addon.commands import registration as command
print(addon_utils.check("shock_filter")[1], hasattr(bpy.types.Scene, "shock_filter"),
      command.run(["sharpen-geometry", {scene!r}, "by_command.blend"]),
      command.run(["sharpen-geometry"]))
addon_utils.disable("shock_filter")
"""
    run = blender(
        "sharpen-geometry",
        scene,
        "out.blend",
        before=before,
        after=after.format(scene=str(scene)),
        alone=True,
    )
    assert run.code == 0, run.err
    assert run.out.splitlines()[-1] == "True True 0 2"
    assert Path("out.blend").exists()
    assert Path("by_command.blend").exists()
    assert "usage: blender --command shock_filter sharpen-geometry" in run.err


# ------------------------------------------------------------------------------------------- flows


def turning(size=24):
    """A velocity that turns round the middle, and its flow map."""
    y, x = np.mgrid[1 : -1 : size * 1j, -1 : 1 : size * 1j]
    velocity = np.stack([-y, x], axis=-1).astype(np.float32)
    values = np.rint(128 + 127 * np.dstack([velocity, np.zeros_like(x)]))
    return velocity, values.astype(np.uint8)


def test_flows_are_shown_as_outside_blender(folder):
    velocity, pixels = turning()
    np.save("field.npy", velocity)
    Image.fromarray(pixels).save("map.png")
    for name in ("field.npy", "map.png"):
        words = [name, "--frames", "3", "--step", "3", "--quiet"]
        assert cli.main(["visualize-flow", *words, f"plain {name[:3]}"]) == 0
        run = blender("visualize-flow", *words, f"blender {name[:3]}")
        assert run.code == 0, run.err
        for number in (1, 2, 3):
            paths = [f"{kind} {name[:3]}/frame_000{number}.png" for kind in ("plain", "blender")]
            one, other = (np.array(Image.open(path)) for path in paths)
            np.testing.assert_array_equal(one, other)
    run = blender("visualize-flow", "field.npy", "moving.apng", "--frames", "3")
    assert "3 frames of 24 x 24 pixels" in run.out
    with Image.open("moving.apng") as image:
        assert image.n_frames == 3


def test_attributes_of_a_scene_are_shown_on_its_texture(folder):
    before = """
bpy.ops.mesh.primitive_grid_add(x_subdivisions=8, y_subdivisions=8, calc_uvs=True)
mesh = bpy.context.object.data
wind = mesh.attributes.new("Wind", "FLOAT_VECTOR", "POINT")
wind.data.foreach_set("vector", [1.0, 0.0, 0.0] * len(mesh.vertices))
"""
    words = ["visualize-flow", "-", "out", "--frames", "3"]
    run = blender(*words, "--attribute", "Wind", "--size", "64x64", before=before)
    assert run.code == 0, run.err
    assert len(os.listdir("out")) == 3
    run = blender(*words, "--overwrite", "--attribute", "Rain", "--size", "64x64", before=before)
    assert run.code == 1 and "no attribute named 'Rain'" in run.err
    run = blender(*words, "--overwrite", "--attribute", "Wind", before=before)
    assert run.code == 1 and "add one such as --size" in run.err
