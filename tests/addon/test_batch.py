# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender's command line: each test runs batch.py in a Blender process of its own."""

import copy
import json
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree
from shock_filter import core
from shock_filter.core.files import sharpen_file

BATCH = Path(__file__).resolve().parents[2] / "shock_addon" / "batch.py"

# The bpy module stands in for `blender -b [FILE] -P batch.py -- WORDS`.
PROCESS = """
import json, os, runpy, sys
import bpy
batch, words, before, after = json.loads(sys.argv[1])
bpy.ops.wm.read_homefile(use_empty=True)
exec(before)
sys.argv = ["blender", "-b", "-P", batch, "--", *words]
try:
    runpy.run_path(batch, run_name="__main__")
except SystemExit as stop:
    code = stop.code
exec(after)
sys.stdout.flush()
sys.stderr.flush()
os._exit(code)  # the bpy module, unlike Blender, may hang when Python takes it down
"""

# A scene as people have them: two rounded boxes (one hidden), a light, a material, a picture.
SCENE = """
def box(name, size):
    import bmesh
    shape = bmesh.new()
    bmesh.ops.create_cube(shape, size=size)
    bmesh.ops.bevel(shape, geom=shape.edges[:], offset=0.2 * size, segments=4, profile=0.5,
                    affect="EDGES")
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


def blender(*words, before="", after="", look_at=None):
    """Run batch.py; with `look_at`, `Run.state` says what that file holds afterwards."""
    if look_at is not None:
        after += LOOK.format(path=str(Path(look_at).absolute()))
    task = json.dumps([str(BATCH), [str(word) for word in words], before, after])
    process = subprocess.run(
        [sys.executable, "-c", PROCESS, task], capture_output=True, text=True, timeout=60
    )
    run = Run(process.returncode, process.stdout, process.stderr)
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
    run = blender("sharpen-geometry", f"in.{ending}", f"out.{ending}", "--time", "64")
    assert run.code == 0, run.err
    assert f"in.{ending} -> out.{ending}: moved " in run.out
    sharpen_file(f"in.{ending}", f"wanted.{ending}", core.GeometrySettings(time=64))
    old, new, wanted = (
        trimesh.load_mesh(f"{name}.{ending}").vertices for name in ("in", "out", "wanted")
    )
    assert np.median(nearest(new, wanted)) < 1e-4
    assert nearest(old, wanted).max() > 0.01
    assert sorted(path.name for path in folder.iterdir() if path.name.startswith(".")) == []


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
    run = blender("sharpen-geometry", "gone.obj", "out.obj", after="print('numba' in sys.modules)")
    assert run.code == 1
    assert run.out.splitlines()[-1] == "False"


def test_an_unforeseen_error_is_shown_and_fails(scene, old, folder):
    before = "import pathlib; pathlib.Path.exists = lambda path: 1 / 0"
    run = blender("sharpen-geometry", scene, "out.blend", before=before)
    assert run.code == 1
    assert "ZeroDivisionError" in run.err


def test_an_error_before_the_start_fails_too(scene, old, folder):
    before = "bpy.utils.register_class = None"
    run = blender("sharpen-geometry", scene, "out.blend", before=before)
    assert run.code == 1
    assert "TypeError" in run.err


def test_ctrl_c_stops_the_filter_and_writes_nothing(scene, old, folder):
    before = """
import os, signal
from shock_filter.core import parallel
report = parallel.Progress.update
def interrupted(self, fraction):
    os.kill(os.getpid(), signal.SIGINT)
    report(self, fraction)
parallel.Progress.update = interrupted
"""
    run = blender("sharpen-geometry", scene, "out.blend", before=before)
    assert run.code == 130, run.err
    assert not (folder / "out.blend").exists()


def test_enabled_extension_is_used_and_stays(scene, old, folder):
    before = """
import addon_utils
module = addon_utils.enable("shock_filter")
"""
    after = """
from shock_filter.shock_addon import command_line
print(addon_utils.check("shock_filter")[1], hasattr(bpy.types.Scene, "shock_filter"),
      command_line._command(["sharpen-geometry", {scene!r}, "by_command.blend"]),
      command_line._command(["sharpen-geometry"]))
addon_utils.disable("shock_filter")
"""
    run = blender(
        "sharpen-geometry",
        scene,
        "out.blend",
        before=before,
        after=after.format(scene=str(scene)),
    )
    assert run.code == 0, run.err
    assert run.out.splitlines()[-1] == "True True 0 2"
    assert Path("out.blend").exists()
    assert Path("by_command.blend").exists()
    assert "usage: blender --command shock_filter sharpen-geometry" in run.err
