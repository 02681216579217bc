# SPDX-License-Identifier: GPL-3.0-or-later
"""A new filter costs a settings class, two rows and a module: nothing else has to know it."""

import json
from pathlib import Path

import pytest
from PIL import Image
from toys import IN_BATCH, OUTSIDE, run, tree_with

SETTINGS = '''

@dataclass(kw_only=True, repr=False, eq=False)
class InvertSettings(_Settings):
    """Settings of the toy."""

    time: float = _setting(0.0, "Nothing", unit="seconds", minimum=0.0, maximum=9.0, soft_maximum=9,
                           role="time")
    strength: float = _setting(1.0, "How much. 0 changes nothing", minimum=0.0, maximum=1.0,
                               soft_minimum=0.0, soft_maximum=1.0)
    alpha: str = _alpha()

    @property
    def reach(self):
        return 24_000
'''

MODULE = """
import numpy as np

from ..base.progress import reporting


def invert_vertex_signal(mesh, signal, settings=None, mask=None, progress=None):
    with reporting(progress):
        signal = np.asarray(signal)
        white = 255 if signal.dtype == np.uint8 else 1
        return (signal + settings.strength * (white - 2.0 * signal)).astype(signal.dtype)


def invert_corner_signal(mesh, signal, settings=None, mask=None, progress=None):
    return invert_vertex_signal(mesh, signal, settings, mask, progress)


def invert_image(image, settings=None, mask=None, progress=None):
    colors = image[..., :3]
    inverted = np.array(image)
    inverted[..., :3] = invert_vertex_signal(None, colors, settings, mask, progress)
    return inverted


def invert_texture(mesh, uv, image, settings=None, progress=None, atlas=None):
    return invert_image(image, settings)
"""

FILTERS = """
def _invert_vertex_signal():
    from .color.inverting import invert_vertex_signal

    return invert_vertex_signal


def _invert_corner_signal():
    from .color.inverting import invert_corner_signal

    return invert_corner_signal


def _invert_image():
    from .color.inverting import invert_image

    return invert_image


def _invert_texture():
    from .color.inverting import invert_texture

    return invert_texture


FILTERS += (
    Filter("invert_vertex_signal", "color.inverting", _settings.InvertSettings, COLORS,
           "invert-colors", "invert the vertex colors of meshes", _invert_vertex_signal,
           corners="invert_corner_signal", load_corners=_invert_corner_signal),
    Filter("invert_image", "color.inverting", _settings.InvertSettings, IMAGE,
           "invert-image", "invert images", _invert_image),
    Filter("invert_texture", "color.inverting", _settings.InvertSettings, TEXTURE,
           "invert-texture", "invert textures", _invert_texture, takes_mask=False),
)
"""

MODES = """
_TWICE = (Preset("Half", "For gray", {"strength": 0.5}), Preset("None", "For fun", {"strength": 0}))
MODES += [
    Mode("invert", "Invert", "Turn colors around", "invert_colors",
         "Turn colors around", (Target("invert_vertex_signal"),), "Inverted", "inverting",
         second="strength", presets=_TWICE),
    Mode("invert_image", "Invert", "", "invert_image", "Turn an image around",
         (Target("invert_image"),), "Inverted", "inverting", second="strength", presets=_TWICE),
    Mode("invert_texture", "Invert Texture", "", "invert_texture",
         "Turn a texture around", (Target("invert_texture"),), "Inverted", "inverting"),
]
"""


@pytest.fixture(scope="module")
def tree(tmp_path_factory):
    folder = tmp_path_factory.mktemp("tree")
    return tree_with(folder, "color.inverting", MODULE, SETTINGS, FILTERS, MODES)


IN_BLENDER = """
import json, sys
from types import SimpleNamespace
import bpy, numpy as np
import shock_filter
bpy.ops.wm.read_homefile(use_empty=True)
shock_filter.register()
from shock_filter import core
from shock_filter.shock_addon.ui import manual, menus
from shock_filter.shock_addon.preview import images as preview_images, previewing
from shock_filter.shock_addon.modes import find
from shock_filter.shock_addon.operators.base import task_of
from shock_filter.shock_addon.operators.properties import settings_of

bpy.ops.mesh.primitive_grid_add(x_subdivisions=3, y_subdivisions=3)
mesh = bpy.context.object.data
paint = mesh.color_attributes.new("Paint", "FLOAT_COLOR", "POINT")
mesh.color_attributes.active_color = paint
for point in paint.data:
    point.color = (0.25, 0.5, 1.0, 0.5)
ran = [list(bpy.ops.shock_filter.invert_colors())]
image = bpy.data.images.new("Plain", 4, 4, float_buffer=True)
image.pixels.foreach_set(np.tile(np.float32([0.25, 0.25, 0.25, 1]), 16))
ran.append(list(bpy.ops.shock_filter.invert_image(image="Plain", output="REPLACE")))
scene = bpy.context.scene.shock_filter
material = bpy.data.materials.new("Plain")
material.use_nodes = True
node = material.node_tree.nodes.new("ShaderNodeTexImage")
node.image = image
mesh.materials.append(material)
ran.append(list(bpy.ops.shock_filter.invert_texture(image="Plain", output="REPLACE")))

def tried(name):
    preview = preview_images.begin(bpy.context, None, find(name))
    settings = settings_of(preview.mode, preview.parameters)
    part, seen = preview.stage.part(settings)
    target = SimpleNamespace(surface=part)
    task = task_of(preview.mode, preview.parameters, settings, [target])
    found = seen(task.run(lambda *_: True)[0])
    colors = found.pieces[0].colors if found.pieces else found.pixels
    preview.end()
    return [part.size, float(colors[0, 0, 0])]

node.image = bpy.data.images.new("Large", 80, 80, float_buffer=True)
preview_images._place = lambda *_: (0.5, 0.5)
tries = [tried("invert_image"), tried("invert_texture")]
scene.mode = "INVERT"
preset = list(bpy.ops.shock_filter.use_preset(mode="invert", name="Half"))
parameters = previewing.parameters_of(bpy.context.scene, find("invert"))
stage = SimpleNamespace(note="", settings=lambda s: s, end=lambda: None, shown=[],
                        part=lambda s: (None, None))
preview = previewing.Preview(find("invert"), parameters, stage)
preview.roll(2)
links = manual.entries()
sys.path.insert(0, sys.argv[1])
import test_panels
drawn = test_panels.draw(test_panels.panels.SHOCK_FILTER_PT_main)
print(json.dumps({
    "drawn": [test_panels.words(drawn, kind) for kind in ("prop", "operator")],
    "public": sorted(set(core.__all__) & {"invert_image", "invert_vertex_signal",
                                          "invert_corner_signal", "InvertSettings"}),
    "ran": ran,
    "color": list(paint.data[0].color),
    "pixel": list(image.pixels[:4]),
    "choices": [[item.name for item in scene.bl_rna.properties[name].enum_items]
                for name in ("mode", "image_mode")],
    "strength": scene.invert.strength,
    "preset": preset,
    "tries": tries,
    "labels": [getattr(bpy.ops.shock_filter, name).get_rna_type().name
               for name in ("invert_colors", "invert_image", "invert_preset_add")],
    "text": preview.text(),
    "links": [links["bpy.ops.shock_filter.invert_image"],
              links["bpy.types.shock_filter_pg_invert.strength"]],
}))
shock_filter.unregister()
"""


@pytest.fixture(scope="module")
def found(tree):
    return json.loads(run(tree, IN_BLENDER, Path(__file__).parent).splitlines()[-1])


def test_the_core_gives_its_names(found):
    names = ["InvertSettings", "invert_corner_signal", "invert_image", "invert_vertex_signal"]
    assert found["public"] == names


def test_its_operators_are_found_by_their_labels_and_invert(found):
    assert found["labels"] == ["Invert Colors", "Invert Image", "Add Invert Preset"]
    assert found["ran"] == [["FINISHED"]] * 3
    assert found["color"] == pytest.approx([0.75, 0.5, 0.0, 0.5], abs=1e-6)
    assert found["pixel"] == pytest.approx([0.25, 0.25, 0.25, 1.0], abs=1e-6)  # inverted twice


def test_the_panels_offer_it_with_settings_and_presets(found):
    assert all("Invert" in names for names in found["choices"])
    assert found["preset"] == ["FINISHED"]
    assert found["strength"] == 0.5


def test_the_preview_has_its_dials(found):
    assert found["text"] == "Time 0 (move mouse) | Strength 0.6 (wheel)"


def test_previews_take_a_patch_that_fits_its_reach_and_need_neither_mask_nor_gutter(found):
    (patch, color), (texture, painted) = found["tries"]
    assert patch == 49**2  # of 80**2, since each reads all of the patch
    assert texture == 80**2
    assert color == painted == pytest.approx(1.0)  # of black


def test_the_manual_has_its_place(found):
    assert found["links"] == ["inverting", "inverting#strength"]


def test_the_panel_draws_its_settings_and_button(found):
    properties, operators = found["drawn"]
    assert properties == ["time", "strength"]
    assert ["shock_filter.invert_colors"] in operators


@pytest.mark.parametrize("code", [OUTSIDE, IN_BATCH], ids=["shock-filter", "Blender"])
def test_the_command_lines_run_it(tree, tmp_path, code):
    Image.new("RGB", (4, 4), (0, 51, 255)).save(tmp_path / "in.png")
    said = run(tree, code, "invert-image", tmp_path / "in.png", tmp_path / "out.png")
    assert "changed 16 of 16 pixels" in said
    assert Image.open(tmp_path / "out.png").getpixel((0, 0))[:3] == (255, 204, 0)
