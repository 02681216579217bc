# SPDX-License-Identifier: GPL-3.0-or-later
"""A new filter that solves on a texture's surface costs no more: settings, a module and two rows.

It smooths a texture less where the surface bends: it solves the screened Poisson equation
``(w M / radius^2 + S) x = w M y / radius^2`` of paper B, in which the screen w grows with the
curvature of the mesh.
"""

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from toys import IN_BATCH, OUTSIDE, ROOT, run, tree_with

SETTINGS = '''

@_fields
class BendSettings(DilateSettings):
    """Settings of :func:`shock_filter.core.smooth_by_curvature`."""

    radius: float = _setting(
        8.0,
        "How far values are averaged where the surface is flat. 0.1 changes next to nothing",
        unit="mean texel sizes on the surface",
        minimum=0.1,
        maximum=1e4,
        soft_maximum=100.0,
        length_power=1,
        counts_in="texels",
    )
    hold: float = _setting(
        1000.0,
        "How much less they are averaged where it bends. 0 averages alike everywhere",
        unit="times",
        maximum=1e6,
        soft_maximum=10_000.0,
    )
    alpha: str = _alpha()
'''

MODULE = """
import numpy as np

from ..base.checks import LARGEST, checked_image, checked_weights
from ..base.progress import phase, reporting
from ..elements.matrices import TextureSpace
from ..elements.multigrid import SheetSolver
from ..elements.surface_values import added_to_sheet, painted_values
from ..grid.channels import opacity_channel
from ..mesh.curvature import curvature
from ..settings import BendSettings, given_or_default
from .texels import Output, Texture, checked_atlas, gathered, mix_texels


def smooth_by_curvature(
    mesh, uv, image, settings=None, mask=None, progress=None, *, atlas=None
):
    given = checked_image(image, LARGEST)
    settings = given_or_default(settings, BendSettings)
    weights = checked_weights(mask, given)
    pixels = given.reshape(*given.shape[:2], -1)
    alpha = opacity_channel(pixels.shape[2], settings.alpha)
    with reporting(progress):
        with phase(0.0, 0.4, "Finding texels"):
            texture = Texture(checked_atlas(atlas, mesh, uv, pixels), pixels, alpha)
            texture, sheet = gathered(texture, settings)
            space = TextureSpace(texture.atlas)
            values = painted_values(space, pixels)
        with phase(0.4, 0.8, "Filtering"):
            screen = 1.0 + settings.hold * _bends(texture.atlas, settings.radius)
            weigh = space.means(painted_values(space, screen[..., None])[:, 0])
            space = space.weighted(weigh, only_mass=True)
            colors = values if alpha < 0 else np.delete(values, alpha, axis=1)
            change = np.zeros_like(colors)
            solver = SheetSolver(space.matrix(settings.radius**-2.0))
            solver.solve(-space.apply_stiffness(colors), change, 1e-4)
        with phase(0.8, 1.0, "Filling the gutter"):
            result = added_to_sheet(space, sheet, colors, change, 1.0, alpha)
            mix_texels(texture.atlas, sheet, 1.0, weights, result)
            keep = None if weights is None else weights == 0
            return Output(texture, settings).written(result, keep).reshape(given.shape)


def _bends(atlas, radius):
    # The larger curvature of each texel, squared, in 1 / radius: (h, w).
    mesh = atlas.mesh
    most = np.abs(curvature(mesh).principal).max(axis=1) * radius * atlas.texel_size
    return atlas.bake(mesh.own_corners(most[mesh.faces] ** 2)).astype(np.float32)
"""

FILTERS = """
def _smooth_by_curvature():
    from .texture.by_curvature import smooth_by_curvature

    return smooth_by_curvature


FILTERS += (
    Filter(
        "smooth_by_curvature",
        "texture.by_curvature",
        _settings.BendSettings,
        TEXTURE,
        "smooth-by-curvature",
        "smooth textures where the surface is flat",
        _smooth_by_curvature,
        needs_levels=True,
    ),
)
"""

MODES = """
MODES += [
    Mode(
        "curvature",
        "By Curvature",
        "Smooth a texture where the surface is flat",
        "smooth_by_curvature",
        "Smooth a texture where the surface is flat; where it bends, detail stays",
        (Target("smooth_by_curvature", dials=("radius", "hold")),),
        "Smoothed",
        "curvature",
        advice="for more smoothing raise Radius",
        presets=(Preset("Edges", "For worn edges: holds on to them", {"hold": 5000.0}),),
    ),
]
"""

# A sheet whose half is flat, and whose other half is bent around the Y axis.
SHEET = """
import numpy as np

def sheet():
    steps = np.linspace(-1.0, 1.0, 25)
    x, y = np.meshgrid(steps, steps, indexing="ij")
    angle = np.maximum(x, 0.0) * 4.0
    points = np.stack([np.minimum(x, 0.0) + 0.25 * np.sin(angle), y,
                       0.25 * np.cos(angle)], axis=-1).reshape(-1, 3)
    a = np.arange(24 * 25).reshape(24, 25)[:, :24].reshape(-1)
    faces = np.stack([a, a + 25, a + 26, a + 1], axis=1)
    uv = np.stack([x, y], axis=-1).reshape(-1, 2) * 0.45 + 0.5
    return points, faces, uv

def noise(size):
    return np.random.default_rng(0).random((size, size), np.float32)

def roughness(image):
    half = image.shape[1] // 2
    middle = image[8:-8]
    return [float(middle[:, 8 : half - 8].std()), float(middle[:, half + 8 : -8].std())]
"""

IN_BLENDER = (
    SHEET
    + """
import json, sys
from types import SimpleNamespace
import bpy
import shock_filter
bpy.ops.wm.read_homefile(use_empty=True)
shock_filter.register()
from shock_filter import core
from shock_filter.core.base.compiled import library
from shock_filter.core.host.fields import reduced_settings
from shock_filter.core.preview.patch import Patch
from shock_filter.core.rehearsal import rehearse as rehearsal
from shock_filter.shock_addon.data.arrays import read_pixels
from shock_filter.shock_addon.modes import find
from shock_filter.shock_addon.operators.base import task_of
from shock_filter.shock_addon.operators.properties import settings_of
from shock_filter.shock_addon.preview import images as preview_images
from shock_filter.shock_addon.ui import manual

def compiled():
    # By numba: all kernels, or what the library lacks.
    kernels = [vars(each).get("dispatcher", each) for each in rehearsal.imported_kernels()]
    return sum(len(getattr(kernel, "overloads", ())) for kernel in kernels)

runs = [each for each in rehearsal._runs({"texture"}) if "smooth_by_curvature" in each.args]
sizes = [each().recolored.colors.shape[0] for each in runs]
rehearsed = compiled()

points, faces, uv = sheet()
mesh = bpy.data.meshes.new("Sheet")
mesh.from_pydata(points.tolist(), [], faces.tolist())
layer = mesh.uv_layers.new()
layer.data.foreach_set("uv", uv[faces.reshape(-1)].astype(np.float32).reshape(-1))
obj = bpy.data.objects.new("Sheet", mesh)
bpy.context.collection.objects.link(obj)
bpy.context.view_layer.objects.active = obj
obj.select_set(True)
image = bpy.data.images.new("Noise", 128, 128, float_buffer=True, is_data=True)
pixels = np.ones((128, 128, 4), np.float32)
pixels[..., :3] = noise(128)[..., None]
image.pixels.foreach_set(pixels.reshape(-1))
material = bpy.data.materials.new("Noise")
material.use_nodes = True
node = material.node_tree.nodes.new("ShaderNodeTexImage")
node.image = image
material.node_tree.nodes.active = node
mesh.materials.append(material)

scene = bpy.context.scene.shock_filter
scene.mode = "CURVATURE"
preview = preview_images.begin(bpy.context, None, find("curvature"))
settings = settings_of(preview.mode, preview.parameters)
part, seen = preview.stage.part(settings)
task = task_of(preview.mode, preview.parameters, settings, [SimpleNamespace(surface=part)])
shown = seen(task.run(lambda *_: True)[0]).pixels[..., 0]
text = preview.text()
preview.drag(50.0)
preview.roll(1)
turned = preview.text()
preview.end()

ran = list(bpy.ops.shock_filter.smooth_by_curvature(image="Noise", output="NEW"))
smoothed = read_pixels(next(i for i in bpy.data.images if i.name != "Noise" and i.size[0] == 128))
pressed = compiled()
small = reduced_settings(core.BendSettings(radius=8.0, hold=3.0), (1024, 1024), (256, 256))
sys.path[:0] = sys.argv[1:]
import test_panels, write_tables
drawn = test_panels.draw(test_panels.panels.SHOCK_FILTER_PT_main)
preset = list(bpy.ops.shock_filter.use_preset(mode="curvature", name="Edges"))
print(json.dumps({
    "public": sorted({"BendSettings", "smooth_by_curvature"} & set(core.__all__)),
    "ran": ran,
    "before": roughness(pixels[..., 0]),
    "after": roughness(smoothed[..., 0]),
    "shown": roughness(shown),
    "alpha": float(smoothed[..., 3].min()),
    "text": [text, turned],
    "drawn": [test_panels.words(drawn, kind) for kind in ("prop", "operator")],
    "preset": [preset, scene.curvature.hold],
    "small": [small.radius, small.hold],
    "runs": [type(each.args[-1]).__name__ for each in runs],
    "sizes": sizes,
    "compiled": [rehearsed, pressed],
    "lent": library() is not None,
    "link": manual.entries()["bpy.types.shock_filter_pg_curvature.hold"],
    "settings": write_tables.settings_table("BendSettings"),
    "operators": write_tables.operator_tables(""),
    "presets": write_tables.preset_tables(""),
}))
shock_filter.unregister()
"""
)


@pytest.fixture(scope="module")
def tree(tmp_path_factory):
    folder = tmp_path_factory.mktemp("tree")
    return tree_with(folder, "texture.by_curvature", MODULE, SETTINGS, FILTERS, MODES)


@pytest.fixture(scope="module")
def found(tree):
    said = run(tree, IN_BLENDER, Path(__file__).parent, ROOT / "tools")
    return json.loads(said.splitlines()[-1])


def test_the_core_gives_its_names(found):
    assert found["public"] == ["BendSettings", "smooth_by_curvature"]


def test_the_operator_smooths_where_the_surface_is_flat(found):
    assert found["ran"] == ["FINISHED"]
    (flat, bent), (was_flat, was_bent) = found["after"], found["before"]
    assert flat < 0.1 * was_flat
    assert 5.0 * flat < bent < was_bent
    assert found["alpha"] == 1.0


def test_the_preview_shows_the_same_and_has_its_dials(found):
    assert found["shown"] == pytest.approx(found["after"], rel=1e-4)
    assert found["text"] == [
        "Radius 8 (move mouse) | Hold 1000 (wheel)",
        "Radius 16 (move mouse) | Hold 1500 (wheel)",
    ]


def test_lengths_scale_with_the_texels_of_a_preview(found):
    assert found["small"] == [2.0, 3.0]


def test_the_panel_draws_its_settings_and_button(found):
    properties, operators = found["drawn"]
    assert {"radius", "hold"} <= set(properties)
    assert ["shock_filter.smooth_by_curvature"] in operators
    assert found["preset"] == [["FINISHED"], 5000.0]


def test_rehearsal_runs_it_on_textures_with_levels_and_presses_compile_nothing(found):
    choices = 1 + 1 + 2 + 1  # the defaults; other backgrounds, seams, opacity
    assert found["runs"] == ["BendSettings"] * 2 * choices
    assert found["sizes"] == [160] * 2 * choices
    rehearsed, pressed = found["compiled"]
    assert pressed == rehearsed
    assert found["lent"] or rehearsed > 0


def test_the_manual_has_its_tables(found):
    assert found["link"] == "curvature#hold"
    rows = found["settings"].splitlines()
    wanted = "| [Radius](#radius) | `radius` | 8 | 0.1, 10000 | mean texel sizes on the surface |"
    assert wanted in rows
    assert "| `radius` | 8 | 0.1, 10000 | " in found["operators"]
    assert "| Edges | For worn edges: holds on to them | Hold 5000 |" in found["presets"]


WRITE_FILES = (
    SHEET
    + """
import sys
from PIL import Image
points, faces, uv = sheet()
lines = ["v {} {} {}".format(*p) for p in points] + ["vt {} {}".format(*p) for p in uv]
lines += ["f " + " ".join(f"{c + 1}/{c + 1}" for c in face) for face in faces.tolist()]
open("sheet.obj", "w").write("\\n".join(lines) + "\\n")
gray = np.uint8(255 * noise(64))
Image.fromarray(np.stack([gray] * 3, axis=2)).save("in.png")
half = np.tile(np.uint8([0] * 16 + [255] * 48), (64, 1))
Image.fromarray(half).save("half.png")
"""
)


@pytest.mark.parametrize("code", [OUTSIDE, IN_BATCH], ids=["shock-filter", "Blender"])
def test_the_command_lines_list_and_run_it(tree, tmp_path, code):
    assert "smooth-by-curvature" in run(tree, code.replace("sys.argv[1:]", "['--help']"))
    run(tree, f"import os; os.chdir({str(tmp_path)!r})\n{WRITE_FILES}")
    names = [tmp_path / name for name in ("sheet.obj", "in.png", "out.png", "half.png")]
    words = ["smooth-by-curvature", *names[:3], "--radius", "12"]
    said = run(tree, code, *words)
    assert "pixels" in said
    old, new = (np.array(Image.open(path))[..., 0] / 255.0 for path in names[1:3])
    assert new[8:-8, 8:24].std() < 0.3 * old[8:-8, 8:24].std()
    run(tree, code, *words, "--mask", names[3], "--overwrite", "--quiet")
    masked = np.array(Image.open(names[2]))[..., 0] / 255.0
    assert (masked == old)[8:-8, 8:16].all() and (masked == new)[8:-8, 16:-8].all()
