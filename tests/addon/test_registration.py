# SPDX-License-Identifier: GPL-3.0-or-later
"""Enabling and disabling, each in a Blender of its own."""

import json
import os
import subprocess
import sys

import bpy
import pytest
from shock_filter.core.base import compiled
from shock_filter.shock_addon.modes import MODES
from shock_filter.shock_addon.operators.filtering import operator_of

INVENTORY = """
import json, sys
import bpy
import shock_filter

def inventory():
    menus = ["VIEW3D_MT_object", "VIEW3D_MT_edit_mesh", "VIEW3D_MT_sculpt",
             "VIEW3D_MT_paint_vertex", "IMAGE_MT_image"]
    return {
        "types": sorted(name for name in dir(bpy.types) if "shock_filter" in name.lower()),
        "scene": sorted(bpy.types.Scene.bl_rna.properties.keys()),
        "manager": sorted(bpy.types.WindowManager.bl_rna.properties.keys()),
        "operators": sorted(dir(bpy.ops.shock_filter)),
        "handlers": [
            [function.__module__ for function in handlers]
            for handlers in (
                bpy.app.handlers.load_pre,
                bpy.app.handlers.undo_pre,
                bpy.app.handlers.undo_post,
                bpy.app.handlers.redo_pre,
                bpy.app.handlers.redo_post,
                bpy.app.handlers.translation_update_post,
            )
        ],
        "entries": [
            [function.__module__ for function in getattr(bpy.types, name)._dyn_ui_initialize()]
            for name in menus
        ],
    }
"""


@pytest.fixture
def blender(tmp_path):
    """Return a function that runs code after INVENTORY in a fresh bpy and reads its JSON line."""

    def run(code):
        done = subprocess.run(
            [sys.executable, "-c", INVENTORY + code],
            capture_output=True,
            text=True,
            timeout=120,
            env={**os.environ, "BLENDER_USER_RESOURCES": str(tmp_path)},
        )
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout.splitlines()[-1])

    return run


def test_nothing_is_left_behind_and_enabling_again_works(blender):
    states = blender(
        """
states = [inventory()]
for _ in range(2):
    shock_filter.register()
    states.append(inventory())
    shock_filter.unregister()
    states.append(inventory())
print(json.dumps(states))
"""
    )
    before, enabled, disabled, enabled_again, disabled_again = states
    assert before == disabled == disabled_again
    assert enabled == enabled_again
    assert before["operators"] == []
    assert before["types"] == []
    assert enabled["operators"] == [
        "auto_update_live", "bake_maps", "before_after", "blocks_preset_add", "cancel",
        "colors_preset_add",
        "crisp_low_poly", "denoise", "denoise_image", "denoise_image_preset_add",
        "denoise_preset_add", "denoise_texture", "denoise_texture_preset_add", "detail_preset_add",
        "dilate_texture", "enlarge_preset_add", "enlarge_texture", "fill_preset_add",
        "fill_texture", "filter_texture", "generate",
        "generate_preset_add", "geometry_preset_add", "hide_creases", "hide_flow",
        "image_preset_add", "keep_auto", "link_map", "make_tileable", "mark_creases", "paint_gain",
        "paint_live", "paint_live_texture", "preview", "preview_generated", "remove_blocks",
        "repair_preset_add", "repair_texture", "sharpen_colors",
        "sharpen_geometry", "sharpen_image", "sharpen_texture", "show_creases", "show_flow",
        "stitch_preset_add", "stitch_textures", "texture_preset_add", "tile_preset_add",
        "update_live", "use_preset", "visualize_flow", "visualize_preset_add",
    ]  # fmt: skip
    assert len(enabled["types"]) >= 20
    names = "", *4 * [".data.shown"], ".ui.translations"
    ours = [f"shock_filter.shock_addon{name}" for name in names]
    assert all(name in found for name, found in zip(ours, enabled["handlers"], strict=True))
    assert set(enabled["scene"]) - set(before["scene"]) == {"shock_filter"}
    assert [len(now) - len(old) for now, old in zip(enabled["entries"], before["entries"],
                                                    strict=True)] == [1] * 5  # fmt: skip


def test_enabling_imports_little(blender):
    enabled, asked, runnable = blender(
        """
names = ["numpy", "numba", "llvmlite", "scipy", "argparse", "concurrent.futures", "ctypes", "json",
         "logging", "pickle", "tempfile", "traceback", "unicodedata"]
for name in names:
    sys.modules[name] = None  # importing it fails
def imported():
    parts = "core.", "shock_addon.commands.command_", "shock_addon.data."
    ours = [name.removeprefix("shock_filter.") for name in sys.modules]
    return sorted(name for name in ours if name.startswith(parts))
bpy.ops.wm.read_homefile(use_empty=True)
shock_filter.register()
enabled = imported()
filters = ["sharpen_geometry", "sharpen_colors", "sharpen_texture", "sharpen_image", "denoise",
           "denoise_image", "denoise_texture", "dilate_texture", "filter_texture",
           "stitch_textures", "preview",
           "show_flow", "cancel"]
runnable = [name for name in filters if getattr(bpy.ops.shock_filter, name).poll()]
print(json.dumps([enabled, imported(), runnable]))
shock_filter.unregister()
"""
    )
    assert enabled == [
        "core.errors",
        "core.host",
        "core.host.forgetting",
        "core.registry",
        "core.settings",
        "shock_addon.data.shown",
        "shock_addon.data.skipped",
        "shock_addon.data.strokes",
        "shock_addon.data.views",
    ]
    # With nothing selected, menus and panels ask what could be run.
    assert asked == sorted([*enabled, "shock_addon.data.chosen", "shock_addon.data.materials"])
    assert runnable == []


TRY = """
bpy.ops.wm.read_homefile(use_empty=True)
shock_filter.register()
from shock_filter.shock_addon.running import kernels
known_before = kernels.problem()
bpy.ops.mesh.primitive_monkey_add()
before = [tuple(v.co) for v in bpy.context.object.data.vertices]
try:
    bpy.ops.shock_filter.sharpen_geometry()
    said = ""
except RuntimeError as error:
    said = str(error)
moved = before != [tuple(v.co) for v in bpy.context.object.data.vertices]
known_after = kernels.problem()
shock_filter.unregister()
print(json.dumps([known_before, said, known_after, moved]))
"""


def test_what_is_missing_is_named_before_and_after_the_first_run(blender):
    why = "The library of kernels is missing."
    known_before, said, known_after, moved = blender(
        "from shock_filter.core.base import compiled\n"
        f"compiled.library_problem = lambda: {why!r}" + TRY
    )
    assert known_before == why
    assert known_after == known_before
    assert known_after in said
    assert not moved


def test_a_library_that_does_not_fit_is_named_with_its_reason(blender, tmp_path):
    package = tmp_path / compiled.PACKAGE
    package.mkdir()
    (package / "__init__.py").touch()
    (package / "kernels.json").write_text('{"sources": "of another version"}')
    code = f"sys.path.insert(0, {str(tmp_path)!r}); sys.modules['numba'] = None"
    known_before, said, known_after, moved = blender(code + TRY)
    assert "cannot be loaded (" in known_before
    assert f"{package}: it was built from other sources): install the " in known_before
    assert known_after == known_before
    assert known_after in said
    assert not moved


SECOND_COPY = """
other = types.ModuleType("bl_ext.other.shock_filter")
other.__version__, other.__addon_enabled__ = "99.0.0", True
sys.modules[other.__name__] = other
try:
    shock_filter.register()
    said = ""
except RuntimeError as error:
    said = str(error)
left = hasattr(bpy.types.Scene, "shock_filter")
other.__addon_enabled__ = False
shock_filter.register()
print(json.dumps([said, left, hasattr(bpy.types.Scene, "shock_filter")]))
shock_filter.unregister()
"""


def test_a_second_copy_is_refused_while_one_is_enabled(blender):
    said, left, later = blender("import types" + SECOND_COPY)
    assert said.startswith("Shock Filter 99.0.0 is enabled already, as bl_ext.other.shock_filter.")
    assert (left, later) == (False, True)


def test_nothing_of_a_file_is_kept_when_another_is_opened(blender):
    kept = blender(
        """
shock_filter.register()
from shock_filter.shock_addon.operators import base as operators
from shock_filter.shock_addon.data.image import images as image_data
from shock_filter.core.host import welding
def kept():
    return [len(operators.summaries), len(image_data._overwritten), len(welding._recent)]
bpy.ops.wm.read_homefile(use_empty=True)
bpy.ops.mesh.primitive_monkey_add()
bpy.ops.shock_filter.sharpen_geometry()
image = bpy.data.images.new("Edge", 16, 16)
image_data.overwrite(image, image_data.read_parts(image), image_data.read_parts(image))
before = kept()
bpy.ops.wm.read_homefile(use_empty=True)
print(json.dumps([before, kept()]))
shock_filter.unregister()
"""
    )
    assert kept == [[1, 1, 1], [0, 0, 0]]


def test_handlers_that_others_have_removed_do_not_matter(blender):
    before, after = blender(
        """
states = [inventory()]
shock_filter.register()
handlers = bpy.app.handlers
for cleared in (handlers.load_pre, handlers.save_pre, handlers.undo_pre, handlers.undo_post,
                handlers.redo_pre, handlers.translation_update_post):
    cleared.clear()
shock_filter.unregister()
states.append(inventory())
print(json.dumps(states))
"""
    )
    assert {**after, "handlers": None} == {**before, "handlers": None}


def test_disabling_during_a_run_stops_it(blender):
    stopped = blender(
        """
import time
shock_filter.register()
from shock_filter.core import Cancelled
from shock_filter.shock_addon.running import jobs
def work(progress):
    while progress(0.5, "Working"):
        time.sleep(0.01)
    raise Cancelled("The run was cancelled; nothing was changed.")
job = jobs.Job(work)
shock_filter.unregister()
print(json.dumps(job.done))
"""
    )
    assert stopped is True


@pytest.mark.parametrize(
    "enable", ["shock_filter.register()", "__import__('addon_utils').enable('shock_filter')"]
)
def test_a_process_that_forgets_to_unregister_ends_well(tmp_path, enable):
    done = subprocess.run(
        [sys.executable, "-c", f"import bpy, shock_filter; {enable}; raise SystemExit(3)"],
        capture_output=True,
        text=True,
        timeout=120,
        env={**os.environ, "BLENDER_USER_RESOURCES": str(tmp_path)},
    )
    assert done.returncode == 3
    assert "Exception" not in done.stderr


REFUSAL = "NotImplementedError"
HOOKS = {
    "finish", "read", "task", "write", "summary", "done",
}  # fmt: skip


@pytest.mark.parametrize(
    "name",
    ["sharpen_geometry", "sharpen_colors", "sharpen_image", "sharpen_texture", "dilate_texture",
     "filter_texture", "stitch_textures", "denoise", "denoise_image", "denoise_texture"],
)  # fmt: skip
def test_each_operator_fills_in_the_hooks_of_its_mixins(name):
    cls = getattr(bpy.types, f"SHOCK_FILTER_OT_{name}")
    functions = {hook: getattr(cls, hook) for hook in dir(cls) if hook in HOOKS}
    codes = {hook: getattr(value, "__code__", None) for hook, value in functions.items()}
    assert {"finish", "read", "task", "write", "summary"} <= set(codes)
    empty = [hook for hook, code in codes.items() if code and REFUSAL in code.co_names]
    assert not empty


@pytest.mark.parametrize("mode", MODES, ids=lambda mode: mode.operator)
def test_no_setting_hides_what_its_operator_does(mode):
    bases = operator_of(mode).__bases__[0].__mro__
    taken = {name for base in bases if base is not object for name in vars(base)}
    cls = getattr(bpy.types, f"SHOCK_FILTER_OT_{mode.operator}")
    assert not taken & set(cls.__annotations__)
