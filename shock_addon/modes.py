# SPDX-License-Identifier: GPL-3.0-or-later
"""The table of modes: one row for each choice in the panels.

Property groups, operators, buttons, menus, presets, previews, statistics, links into the manual and
Blender's command line are made from these rows; operators by ``type(...)`` in
`operators.filtering`. Settings, kind of data and the filter that may follow are in the filter's row
of `core.registry`; `kinds` is the table of Blender's data.

*Mode* means a row here, as it does on screen; what Blender calls a mode of the 3D view is an
*object mode*. This module uses neither bpy, numpy nor numba. Its annotations are not postponed,
because evaluating them later takes longer.
"""

import math
from collections.abc import Mapping
from functools import cache
from typing import Any

from ..core import registry
from ..core.registry import Row
from ..core.settings import OF_PAPER, Setting, describe, named
from .kinds import DATA, MASK, Data

STEADY_STATE = "steady_state"

_COUNTS = {"widest_fillet": ("where", "creases"), "bump_size": ("method", "automatic")}
"""Settings that the wheel changes only with a certain choice."""


class Preset(Row):
    """A named set of a mode's settings.

    Attributes
    ----------
    name : str
        Words on screen.
    reason : str
        The tooltip: its purpose, without the final period, which Blender adds.
    values : mapping
        Settings that differ from the defaults; all others are set to their defaults.
    """

    name: str
    reason: str
    values: Mapping[str, Any]


DEFAULTS = Preset("Defaults", "Sets everything back to its default", {})
"""A preset of each mode, first in its list."""

_PAINTERLY = Preset(
    "Painterly Steady State",
    "For style: colors flow until they meet, which leaves flat strokes with crisp borders",
    {"steady_state": True, "smoothing_passes": 4},
)


class Target(Row):
    """A filter and its data; a mode has one, or several among which a property chooses.

    Attributes
    ----------
    filter : str
        Name in the registry.
    key, label, about : str
        For the property's choice.
    prefix : str
        Prefix of the properties of its settings.
    kind : str
        Key of `kinds.DATA`. Default: the kind in the registry.
    defaults : mapping
        Defaults of settings that differ from the registry's.
    dials : tuple of str or None
        Settings that mouse and wheel change in a preview, empty for none. None for the time and
        the mode's `second`. If a time is given under Advanced, the mouse changes that, and the
        wheel the first one.
    first : tuple of str or None
        Settings that are shown at first, all others under Advanced. None for what the settings
        say themselves.
    advice : str
        Advice for the report if nothing has changed; by default that of the mode.
    mends_seams : bool
        Whether texels beside the charts count as a change on their own: they show at seams.
    """

    filter: str
    key: str = ""
    label: str = ""
    about: str = ""
    prefix: str = ""
    kind: str = ""
    defaults: Mapping[str, Any] = {}
    dials: tuple[str, str] | None = None
    first: tuple[str, ...] | None = None
    advice: str = ""
    mends_seams: bool = False

    def is_advanced(self, name: str) -> bool:
        """Whether a property of its settings is shown under Advanced."""
        if self.first is None:
            return self.fields[name].advanced
        return name.removeprefix(self.prefix) not in self.first

    @property
    def row(self) -> registry.Filter:
        """The filter's row in the registry."""
        return registry.find(self.filter)

    @property
    def data_kind(self) -> str:
        """Key of `kinds.DATA`."""
        return self.kind or self.row.kind.name

    @property
    def data(self) -> Data:
        """The kind of data."""
        return DATA[self.data_kind]

    @property
    def time(self) -> str:
        """Name the property of the time; empty if there is none."""
        return self._named("time")

    @property
    def width(self) -> str:
        """Name the property of the width, used if the time is below 0; empty if there is none."""
        return self._named("width")

    def _named(self, role: str) -> str:
        name = named(self.row.settings, role)
        return name and self.prefix + name

    def dial(self, parameters: Any) -> str:
        """Name the property that the mouse changes in a preview; empty if there is none."""
        if self.dials is None or self.has_time(parameters):
            return self.time
        return self.dials[0] and self.prefix + self.dials[0]

    def second(self, parameters: Any, of_mode: str) -> str:
        """Name the property that the wheel changes; empty if there is none."""
        if self.dials is None:
            name = of_mode
        else:
            name = self.dials[0] if self.has_time(parameters) else self.dials[1]
        if name in _COUNTS:
            choice, word = _COUNTS[name]
            name = name if getattr(parameters, self.prefix + choice) == word else ""
        return self.prefix + name if name else ""

    def has_time(self, parameters: Any) -> bool:
        """Whether a time is given, or the steady state, that is no main setting."""
        if not (self.time and self.fields[self.time].advanced):
            return False
        if self.steady_state and getattr(parameters, self.steady_state):
            return True
        if getattr(parameters, self.prefix + "method", "beltrami") != "beltrami":
            return False
        time = getattr(parameters, self.time)
        default = describe(self.row.settings)[self.time.removeprefix(self.prefix)][1]
        return time >= 0 if self.width else time != default

    @property
    def steady_state(self) -> str:
        """Name the property for an infinite time; empty if it must be finite."""
        is_endless = self.time and math.isinf(self.fields[self.time].maximum)
        return self.prefix + STEADY_STATE if is_endless else ""

    @property
    def fields(self) -> dict[str, Setting]:
        """Return descriptions of the filter's settings, by the names of their properties."""
        return _described(self.row.settings, self.prefix)

    @property
    def settings(self) -> list[str]:
        """List the properties of settings."""
        names, steady_state = list(self.fields), self.steady_state
        if steady_state:
            names.insert(names.index(self.time) + 1, steady_state)
        return names

    @property
    def places(self) -> list[str]:
        """List the properties of the data."""
        names, row = self.data.properties, self.row
        return [name for name in names if row.takes_mask or name not in MASK]


@cache
def _described(settings: type, prefix: str) -> dict[str, Setting]:
    return {prefix + name: about for name, (_, _, about) in describe(settings).items()}


class Mode(Row):
    """A row.

    Attributes
    ----------
    key : str
        Name of its property group in ``scene.shock_filter``, and of its folder of presets.
    label, about : str
        The panel's choice; in the Image Editor it may be described by `about_in_images`.
    operator, tooltip : str
        Name after ``shock_filter.``, description without a period.
    targets : tuple of Target
    done : str
        The verb of the report, such as "Sharpened".
    page : str
        Its page in the manual.
    second : str
        The setting that the wheel changes in a preview; empty if the wheel changes nothing.
    about_in_images : str
    advice : str
        Advice for the report if little has changed.
    nothing : str
        The report if no vertex has moved.
    changes : str
        The amount for the report, if it is not how much colors have changed.
    announced : str
        The panel's text for the texture that a run would take.
    flow : str
        Description of its flow among the choices of Show Flow; empty if it has none.
    icon : str
        Of the button.
    presets : tuple of Preset
        In the order of the panel's list.
    former : tuple of Preset
        Those that are not offered any more; scripts that name them get them.
    within : str
        Key of the mode whose settings it uses; it then has no presets of its own.
    job : str
        Key of its button in the panel's first row. Default: that of its data.
    part : str
        What the second row calls it. Default: the label.
    """

    key: str
    label: str
    about: str
    operator: str
    tooltip: str
    targets: tuple[Target, ...]
    done: str
    page: str
    second: str = ""
    about_in_images: str = ""
    advice: str = ""
    nothing: str = ""
    changes: str = ""
    announced: str = "Will filter: {}"
    flow: str = ""
    icon: str = "SHARPCURVE"
    presets: tuple[Preset, ...] = ()
    former: tuple[Preset, ...] = ()
    within: str = ""
    job: str = ""
    part: str = ""

    def target(self, parameters: Any) -> Target:
        """Return the target that the parameters of the panel or the operator choose."""
        chosen = getattr(parameters, "target", "")
        return next((each for each in self.targets if each.key == chosen), self.targets[0])

    def makes_objects(self, parameters: Any, output: str = "OBJECT") -> bool:
        """Whether parameters ask for new objects, with modifiers and shape keys applied.

        With the output ``"AUTO"``: whether it depends on the modifiers; see `operators.poll`.
        """
        return "output" in self.target(parameters).places and parameters.output == output

    def target_in(self, object_mode: str) -> Target | None:
        """Return the first target that the menu of an object mode offers."""
        return next((t for t in self.targets if object_mode in t.data.object_modes), None)

    @property
    def title(self) -> str:
        """Return the words on the button."""
        return self.operator.replace("_", " ").title()

    @property
    def group(self) -> str:
        """Name the property group with its settings."""
        return self.within or self.key

    @property
    def data(self) -> Data:
        """The kind of data, the widest one of the targets."""
        return self.targets[-1].data

    @property
    def has_preview(self) -> bool:
        """Whether it has a preview; films do not, nor larger textures, nor mere gutters."""
        row = self.targets[0].row
        is_larger = row.kind.on_mesh and named(row.settings, "enlargement") != ""
        return self.data.handled_as != "films" and not row.fills_gutter and not is_larger

    @property
    def follows(self) -> type | None:
        """Return the settings class of the sharpening that may follow in the same run."""
        then = self.targets[0].row.then
        return registry.find(then).settings if then else None

    @property
    def names(self) -> tuple[str, ...]:
        """List its properties, whose values the panel keeps."""
        places = [name for target in self.targets for name in target.places]
        return tuple(dict.fromkeys([*self.filter_names, *places]))

    @property
    def filter_names(self) -> list[str]:
        """List the properties of settings, without those of input and output."""
        names = ["target"] * (len(self.targets) > 1)
        for target in self.targets:
            names += target.settings
        return names + ["then_sharpen", "sharpen_time"] * (self.follows is not None)

    def names_for(self, parameters: Any) -> list[str]:
        """List the properties that apply to the chosen target."""
        target = self.target(parameters)
        of_others = {name for each in self.targets for name in (*each.settings, *each.places)}
        of_others.difference_update(target.settings, target.places)
        return [name for name in self.names if name not in of_others]


MODES: list[Mode] = [
    Mode(
        "denoise",
        "Denoise",
        "Remove noise from vertices and colors; creases and edges stay",
        "denoise",
        "Remove noise from meshes and their colors; creases and edges between colors stay",
        (
            Target(
                "denoise_geometry",
                "geometry",
                "Geometry",
                "Move vertices so that the surface becomes smooth between its creases",
                dials=("strength", "bump_size"),
                advice="For more noise raise Bump Size; with Beltrami raise Time or lower Keep"
                " Edges.",
            ),
            Target(
                "beltrami_vertex_signal",
                "colors",
                "Colors",
                "Average colors within the areas between edges",
                prefix="color_",
            ),
            Target(
                "beltrami_vertex_signal",
                "both",
                "Both",
                "Average vertices and colors with the same weights, so that edges between colors"
                " keep the shape, too",
                prefix="color_",
                kind="both",
            ),
        ),
        "Denoised",
        "denoising",
        second="beta",
        announced="Will denoise: {}",
        advice="to remove more, raise Time or lower Keep Edges",
        icon="SMOOTHCURVE",
        presets=(
            Preset(
                "Noisy CAD Part",
                "For machine parts: removes the noise, then sharpens the creases, which would"
                " otherwise stay a little soft",
                {"then_sharpen": True, "sharpen_time": 1024.0},
            ),
            Preset(
                "Noisy Vertex Colors",
                "For photographed colors: keeps edges better than the default, averages three"
                " times, and leaves about half the noise",
                {"target": "colors", "color_beta": 6.0, "color_iterations": 3},
            ),
        ),
        former=(Preset("As in the Paper", "", {"method": "beltrami"}),),
        job="DENOISE",
    ),
    Mode(
        "denoise_image",
        "Denoise",
        "",
        "denoise_image",
        "Remove noise from an image; edges stay",
        (Target("beltrami_image"),),
        "Denoised",
        "denoising",
        job="DENOISE",
        part="Image",
        second="beta",
        about_in_images="Remove noise; edges stay",
        announced="Will denoise: {}",
        advice="to remove more, raise Time, or set Keep Edges lower than the measured value",
        icon="SMOOTHCURVE",
        presets=(
            Preset(
                "Flat Colors",
                "For style, and for pictures to be traced: flattens the areas between edges, and"
                " sharpens the edges",
                {"beta": 5.0, "iterations": 5, "then_sharpen": True, "sharpen_time": 100000.0},
            ),
        ),
    ),
    Mode(
        "denoise_texture",
        "Texture Noise",
        "Remove noise from an image on the surface that shows it, across seams; edges stay",
        "denoise_texture",
        "Remove noise from a texture, on the surface and across UV seams; edges stay",
        (Target("beltrami_texture"),),
        "Denoised",
        "denoising",
        job="DENOISE",
        part="Texture",
        second="beta",
        about_in_images="Remove noise on the surface of the selected objects that show it, across"
        " seams",
        announced="Will denoise: {}",
        advice="to remove more, raise Time, or set Keep Edges lower than the measured value",
        icon="SMOOTHCURVE",
        presets=(
            Preset(
                "Normal Map",
                "For tangent-space normals: they are rotated where they cross a seam, stay unit"
                " length, and no channel is treated as opacity",
                {"content": "normals", "alpha": "none"},
            ),
        ),
    ),
    Mode(
        "geometry",
        "Geometry",
        "Move vertices so that rounded creases become sharp",
        "sharpen_geometry",
        "Turn rounded creases into sharp ones: normals flow towards the creases, positions follow",
        (Target("sharpen_geometry", dials=("amount", "widest_fillet")),),
        "Sharpened",
        "geometry",
        announced="Will sharpen: {}",
        advice="Sharp creases stay as they are; for wide or gentle ones raise Time or lower"
        " Threshold.",
        nothing="Found nothing to sharpen in {meshes}: {changes}, {seconds:.1f} s.",
        flow="Flow of the normals: to the creases",
        presets=(
            Preset(
                "Subtle",
                "For surfaces that are nearly right: creases become sharper, and vertices move"
                " less than by default. Gentle curves do not change",
                {"amount": 0.5},
            ),
            Preset(
                "Crisp CAD Edges",
                "For machine parts with rounded or smoothed edges: flows longer and fits in more"
                " steps, so that wider roundings become creases, too",
                {"time": 1024.0, "fit_steps": 25},
            ),
            Preset(
                "Carved Facets",
                "For style: everything flows as far as it can, as if the surface were carved with a"
                " knife",
                {
                    **OF_PAPER,
                    "steady_state": True,
                    "smoothing_passes": 8,
                    "feature_threshold": 0.0,
                    "sampling": "linear",
                },
            ),
        ),
        former=(
            Preset("Remeshed Hard Surface", "", {"align_passes": 3, "fit_steps": 25}),
            Preset("As in the Paper", "", OF_PAPER),
        ),
    ),
    Mode(
        "colors",
        "Colors",
        "Move the colors on the surface so that blurred edges in them become sharp",
        "sharpen_colors",
        "Turn blurred edges between painted colors into sharp ones, without new colors beside them",
        (Target("sharpen_vertex_signal", dials=("amount", "width")),),
        "Sharpened",
        "colors",
        announced="Will sharpen: {}",
        advice="for wider edges raise Width",
        flow="Flow of the colors: to the edges between them",
        presets=(
            Preset(
                "Subtle",
                "For colors that are nearly right: half of the change",
                {"amount": 0.5},
            ),
            Preset(
                "Crisp Borders",
                "For wide, soft borders between areas that should have one color each, where Auto"
                " finds too little: closes borders 12 edges wide",
                {"what": "drawing", "width": 12.0},
            ),
            _PAINTERLY,
        ),
    ),
    Mode(
        "image",
        "Image",
        "",
        "sharpen_image",
        "Turn blurred edges in an image into sharp ones, without halos beside them",
        (Target("sharpen_image", dials=("amount", "width")),),
        "Sharpened",
        "images",
        part="Sharpen",
        announced="Will sharpen: {}",
        advice="for wider edges raise Width",
        about_in_images="Sharpen it as a flat picture",
        presets=(
            Preset(
                "Subtle",
                "For images that are nearly right: half of the change",
                {"amount": 0.5},
            ),
            Preset(
                "Blurred Photo",
                "For photos that Auto leaves too soft: detail is raised, and borders become half as"
                " wide",
                {"what": "photo"},
            ),
            Preset(
                "Very Blurred Photo",
                "For scaled-up or badly focused photos that Auto leaves too soft: closes borders 12"
                " pixels wide",
                {"what": "photo", "width": 12.0},
            ),
            _PAINTERLY,
        ),
    ),
    Mode(
        "texture",
        "Texture",
        "Move the colors of an image on the surface of its model, across seams, so that blurred"
        " edges become sharp",
        "sharpen_texture",
        "Turn blurred edges in a texture into sharp ones, on the surface and across UV seams",
        (Target("sharpen_texture", dials=("amount", "width")),),
        "Sharpened",
        "textures",
        part="Sharpen",
        announced="Will sharpen: {}",
        advice="for wider edges raise Width",
        about_in_images="Sharpen it on the surface of the selected objects that show it, across"
        " seams",
        presets=(
            Preset(
                "Subtle",
                "For textures that are nearly right: half of the change",
                {"amount": 0.5},
            ),
            Preset(
                "Blurred Bake",
                "For bakes, masks and scaled-up painted colors: areas get one clean border, as"
                " wide as a texel or two",
                {"what": "drawing"},
            ),
            Preset(
                "Normal Map",
                "For tangent-space normals: they are rotated where they cross a seam, stay unit"
                " length, and no channel is treated as opacity",
                {"content": "normals", "alpha": "none"},
            ),
            _PAINTERLY,
        ),
    ),
    Mode(
        "detail",
        "Detail",
        "Raise or smooth the detail of a texture on the surface that shows it, across seams;"
        " structures larger than the radius stay",
        "filter_texture",
        "Raise or smooth the detail of a texture, on the surface and across UV seams",
        # A larger radius makes logos and letters glow.
        (
            Target(
                "filter_texture",
                kind="detail",
                defaults={"radius": 10.0},
                dials=("gain", "radius"),
            ),
        ),
        "Filtered",
        "detail",
        advice="a Gain of 1 changes nothing, nor does middle gray in a Gain Map; 2 doubles detail,"
        " 0 smooths it away",
        about_in_images="Raise or smooth its detail on the surface of the selected objects that"
        " show it, across seams",
        presets=(
            Preset(
                "Fine Grain",
                "For pores, fabric and rust: raises only detail a few texels wide, and keeps all"
                " larger light and shade",
                {"radius": 4.0},
            ),
            Preset(
                "Punch",
                "For flat, washed-out textures: raises larger forms, too, but less",
                {"gain": 1.5, "radius": 100.0},
            ),
            Preset(
                "Soften",
                "For textures that are too busy: half of the detail",
                {"gain": 0.5},
            ),
            Preset(
                "Smooth",
                "For style, and as a base to paint over: detail is removed, large colors stay",
                {"gain": 0.0},
            ),
        ),
    ),
    Mode(
        "stitch",
        "Stitch",
        "Remove the steps at the seams of a texture, such as of baked light or a scan, or merge"
        " several pictures of the surface, such as projected photos",
        "stitch_textures",
        "Remove the steps between the charts of a texture, or merge several pictures into one"
        " texture without steps",
        (Target("stitch_textures", kind="stitch", dials=("radius", ""), mends_seams=True),),
        "Stitched",
        "stitch",
        announced="Will stitch: {}",
        advice="steps that are still seen need a larger Radius",
        about_in_images="Remove the steps at its seams on the surface of the selected objects"
        " that show it, or merge it with other pictures of them",
        icon="MOD_UVPROJECT",
        presets=(
            Preset(
                "Even Out Charts",
                "For baked light and scans whose charts differ in brightness or color: matches"
                " whole charts, so that no gradual change is left beside the seams either",
                {"radius": 1000.0},
            ),
            Preset(
                "Seams Only",
                "For fine lines: both sides of each seam match, and everything else stays bit"
                " for bit",
                {"where": "seams"},
            ),
        ),
    ),
    Mode(
        "fill",
        "Fill",
        "Fill missing parts of a texture from their surroundings on the surface, across seams:"
        " transparent texels, and faces that no photo saw",
        "fill_texture",
        "Fill transparent, unseen or masked texels smoothly from their surroundings on the"
        " surface, across UV seams; all others stay",
        (Target("fill_texture", dials=("", "")),),
        "Filled",
        "repair",
        announced="Will fill: {}",
        advice="what is to be filled may be painted as a mask",
        about_in_images="Fill its missing texels on the surface of the selected objects that"
        " show it",
        icon="SNAP_FACE",
        presets=(
            Preset(
                "Unseen Faces",
                "For photogrammetry and generated models: fills faces that are completely black",
                {"find": "unseen"},
            ),
            Preset(
                "Continue Slopes",
                "For slow gradients: slopes of colors are continued, which takes longer",
                {"surface": "thin_plate"},
            ),
        ),
    ),
    Mode(
        "repair",
        "Repair",
        "Repair the texture of a generated or photographed model: blocks, noise, unseen faces,"
        " seams, blur",
        "repair_texture",
        "Remove blocks of compression and noise, fill faces that no photo saw, match both sides"
        " of seams, and sharpen, each only where needed",
        (
            Target(
                "repair_texture",
                mends_seams=True,
                first=("enlarge", "sharpen", "denoise", "blocks", "fill", "stitch"),
            ),
        ),
        "Repaired",
        "repair",
        announced="Will repair: {}",
        advice="what is missing may be painted as a mask",
        about_in_images="Repair it on the surface of the selected objects that show it",
        icon="TOOL_SETTINGS",
        presets=(
            Preset(
                "Twice as Large",
                "For generated models: 1K becomes 2K, with crisp borders",
                {"enlarge": 2},
            ),
            Preset(
                "Even Out Charts",
                "For photogrammetry whose charts differ in brightness",
                {"stitch": "everywhere"},
            ),
        ),
    ),
    Mode(
        "enlarge",
        "Enlarge",
        "Enlarge a texture, sharper than by stretching it, and read across its seams",
        "enlarge_texture",
        "Make a texture higher and wider, with crisp edges, and read across its seams, so that"
        " seams do not show",
        (Target("enlarge_texture", first=("factor",)),),
        "Enlarged",
        "repair",
        announced="Will enlarge: {}",
        about_in_images="Enlarge it on the surface of the selected objects that show it",
        icon="FULLSCREEN_ENTER",
        presets=(Preset("Four Times", "For textures of 1K that should become 4K", {"factor": 4}),),
    ),
    Mode(
        "tile",
        "Tile",
        "Make opposite sides of an image meet, so that it can be repeated without joints",
        "make_tileable",
        "Make opposite sides of an image match in color and slope, without ghosts, so that it"
        " tiles",
        (Target("make_tileable", dials=("radius", "even_light")),),
        "Joined",
        "repair",
        announced="Will join sides: {}",
        about_in_images="Make opposite sides match, so that the image tiles without joints",
        icon="MOD_ARRAY",
        presets=(
            Preset(
                "Even Light",
                "For photos of ground and walls: light that varies over the picture is removed,"
                " too",
                {"even_light": 1.0},
            ),
        ),
    ),
    Mode(
        "blocks",
        "Blocks",
        "Remove the blocks of JPEG compression from an image; pictures without blocks stay",
        "remove_blocks",
        "Remove the blocks and ringing of JPEG compression, found by their grid; edges stay, and"
        " pictures without blocks do not change",
        (Target("remove_blocks", dials=("strength", "")),),
        "Cleaned",
        "repair",
        announced="Will clean: {}",
        advice="blocks of pictures that were scaled or saved twice cannot be found",
        about_in_images="Remove the blocks of JPEG compression",
        icon="MESH_GRID",
        presets=(Preset("Strong", "For pictures that were compressed twice", {"strength": 1.5}),),
    ),
    Mode(
        "generate",
        "Generate",
        "Make an image from the shape of the surface, across seams: masks by distance, brushed"
        " streaks, animal patterns, curvature, occlusion, thickness, worn edges, dirt, dust",
        "generate",
        "Make a mask by distance, brushed streaks, an animal pattern, a map of curvature, occlusion"
        " or thickness, or a mask of worn edges, dirt or dust on the surface, across UV seams",
        (
            Target(
                "geodesic_distance",
                "distance",
                "Distance",
                "Distance along the surface: masks, falloffs and lines",
                kind="distance",
                defaults={"look": "gradient"},  # which is seen, whatever the object's size
                dials=("width", "smoothing"),
            ),
            Target(
                "surface_line_convolution",
                "streaks",
                "Streaks",
                "Noise stretched along a direction: brushed metal, hair, wood",
                prefix="streak_",
                kind="streaks",
                dials=("length", "width"),
            ),
            Target(
                "reaction_diffusion",
                "pattern",
                "Pattern",
                "Stripes, dots and labyrinths that grow on the surface, as on animals",
                prefix="pattern_",
                kind="pattern",
                dials=("scale", "seed"),
            ),
            Target(
                "curvature_map",
                "curvature",
                "Curvature",
                "Curvature of the surface: masks of edges and of cavities, without facets",
                prefix="curvature_",
                kind="curvature",
                defaults={"look": "gray"},  # which is seen, whatever the object's size
                dials=("radius", "white"),
            ),
            Target(
                "ambient_occlusion",
                "occlusion",
                "Occlusion",
                "Ambient occlusion, for dirt in corners and contact shadows",
                prefix="occlusion_",
                kind="occlusion",
                dials=("distance", "smoothing"),
            ),
            Target(
                "thickness",
                "thickness",
                "Thickness",
                "Thickness of the body behind each place, for translucent materials",
                prefix="thickness_",
                kind="thickness",
                defaults={"look": "gray"},
                dials=("white", "smoothing"),
            ),
            Target(
                "wear",
                "wear",
                "Wear",
                "Worn edges, dirt in corners, dust on top: masks between two materials",
                prefix="wear_",
                kind="wear",
                dials=("width", "amount"),
            ),
        ),
        "Generated",
        "generate",
        icon="TEXTURE",
        presets=(
            Preset(
                "Contour Lines",
                "For bands and rings: ten lines of equal distance",
                {"look": "lines"},
            ),
            Preset(
                "Measured",
                "For shaders and scripts that count: the distance itself, in the scene's units",
                {"look": "distance"},
            ),
            Preset(
                "Brushed Metal",
                "For roughness and bump: long, thin scratches",
                {"target": "streaks", "streak_length": 150.0, "streak_width": 1.5},
            ),
            Preset(
                "Hair",
                "For fur and bark: streaks of some width",
                {"target": "streaks", "streak_length": 60.0, "streak_width": 4.0},
            ),
            Preset(
                "Labyrinth",
                "For brains and fish: rings and winding walls",
                {"target": "pattern"},
            ),
            Preset(
                "Stripes",
                "For zebras and fingerprints: lines that seldom branch; with Along and Stretch they"
                " run one way",
                {
                    "target": "pattern",
                    "pattern_feed": 0.029,
                    "pattern_kill": 0.057,
                    "pattern_steps": 1500,
                },
            ),
            Preset(
                "Dots",
                "For leopards and ladybirds: spots at even distances",
                {
                    "target": "pattern",
                    "pattern_feed": 0.03,
                    "pattern_kill": 0.062,
                    "pattern_steps": 1500,
                },
            ),
            Preset(
                "Coral",
                "For corals and giraffes: rings that grow until they touch",
                {
                    "target": "pattern",
                    "pattern_feed": 0.0545,
                    "pattern_kill": 0.062,
                    "pattern_steps": 1500,
                },
            ),
            Preset(
                "Worn Edges",
                "For paint and metal: exposed edges are worn",
                {"target": "wear"},
            ),
            Preset(
                "Dirt",
                "For corners and cavities, where dirt collects",
                {"target": "wear", "wear_kind": "dirt"},
            ),
            Preset(
                "Dust",
                "For surfaces that face up, below the open sky",
                {"target": "wear", "wear_kind": "dust"},
            ),
            Preset(
                "Edge Mask",
                "For wear: edges and bumps are white",
                {"target": "curvature", "curvature_kind": "convex"},
            ),
            Preset(
                "Cavity Mask",
                "For dirt: valleys and dents are white",
                {"target": "curvature", "curvature_kind": "cavity"},
            ),
            Preset(
                "On the Ground",
                "For models that stand on a floor: they are darker near it",
                {"target": "occlusion", "occlusion_ground": "below"},
            ),
            Preset(
                "Skin and Wax",
                "For translucent materials: thin places are black",
                {"target": "thickness"},
            ),
        ),
    ),
    Mode(
        "visualize",
        "Flow",
        "Show a flow as a moving texture: the flow of the shock filter, an attribute of vectors,"
        " or a flow map",
        "visualize_flow",
        "Show a flow as noise that moves: frames on disk, and an image sequence that plays them",
        (
            Target(
                "advect_noise",
                "shape",
                "Shape",
                "The flow of Sharpen Geometry, with that panel's settings: to the creases",
                kind="flow",
            ),
            Target(
                "advect_noise",
                "colors",
                "Colors",
                "The flow of Sharpen Colors, with that panel's settings: to the edges between"
                " colors",
                kind="flow",
            ),
            Target(
                "advect_noise",
                "attribute",
                "Attribute",
                "Vectors of the mesh, or numbers whose gradient it follows",
                kind="attribute_flow",
            ),
            Target(
                "advect_noise",
                "map",
                "Flow Map",
                "An image: red is to the right, green is up, and the middle is 0",
                kind="flow_map",
            ),
        ),
        "Showed",
        "visualize-flow",
        about_in_images="Show it as a flow map: noise that moves with it",
        icon="FORCE_WIND",
        presets=(
            Preset(
                "Long Streaks",
                "For slow, calm flows: streaks are twice as long",
                {"blending": 0.05},
            ),
            Preset(
                "Only Where It Flows",
                "For flows that are fast in few places: slow ones stay dark",
                {"speed_mask": 1.0},
            ),
            Preset(
                "Loop",
                "For games: the last frame is followed by the first without a jump",
                {"loop": 24},
            ),
        ),
    ),
    Mode(
        "dilate",
        "Dilate",
        "Fill the texture around its UV islands with colors from across the seams",
        "dilate_texture",
        "Fill the texture around its UV islands with colors from across the seams, so that no"
        " seam shows",
        (Target("dilate_texture", first=("gutter", "seams")),),
        "Dilated",
        "textures#dilate-texture",
        changes="filled {changed:,} of {total:,} pixels",
        announced="Will dilate: {}",
        icon="UV_ISLANDSEL",
        within="texture",
    ),
]
"""All rows, in the order of the panel's choices."""


class Job(Row):
    """A button in the panel's first row, which leads to one mode or to several.

    Attributes
    ----------
    key, label, about : str
        For the choice.
    does : str
        What stands in place of a second row where there is one mode only.
    """

    key: str
    label: str
    about: str
    does: str = ""


_TEXTURE = Job(
    "TEXTURE",
    "Texture",
    "Filter an image on the surface of its model, across seams",
)

JOBS = {
    "mode": (
        Job(
            "GEOMETRY",
            "Geometry",
            "Move vertices so that rounded creases become sharp",
            does="Rounded creases become sharp.",
        ),
        Job(
            "DENOISE",
            "Denoise",
            "Remove noise from a mesh, its colors or its texture; creases and edges stay",
        ),
        Job(
            "COLORS",
            "Colors",
            "Move the colors on the surface so that blurred edges in them become sharp",
            does="Blurred edges become sharp.",
        ),
        _TEXTURE,
    ),
    "image_mode": (
        Job(
            "IMAGE",
            "Image",
            "Sharpen it as a flat picture",
            does="Blurred edges become sharp.",
        ),
        Job(
            "DENOISE",
            "Denoise",
            "Remove noise from the image, flat or on the surface that shows it; edges stay",
        ),
        _TEXTURE,
    ),
}
"""The first row of the panel in the 3D view and in the Image Editor, by the property of the mode.

The modes of no job have panels of their own.
"""


_JOB_OF_DATA = {"textures": "TEXTURE", "images": "IMAGE"}


def job_of(choice: str, mode: Mode) -> Job | None:
    """Return the button that leads to a mode; None if the mode has a panel of its own."""
    key = mode.job or _JOB_OF_DATA.get(mode.data.handled_as, "")
    if not key and mode.data.handled_as == "meshes":
        key = "GEOMETRY" if mode.data.moves else "COLORS"
    return next((job for job in JOBS[choice] if job.key == key), None)


def modes_of(choice: str, job: Job) -> list[Mode]:
    """List the modes to which a button of the first row leads, the first one by a click."""
    return [
        mode
        for mode in MODES
        if job_of(choice, mode) is job
        if (mode.data.on_surface if choice == "mode" else mode.data.in_images)
    ]


def find(key: str) -> Mode:
    """Find a row by its key."""
    return next(mode for mode in MODES if mode.key == key)


def choices() -> list[Mode]:
    """List the modes that have settings of their own."""
    return [mode for mode in MODES if not mode.within]


def within(mode: Mode) -> list[Mode]:
    """List the modes that use the settings of a mode."""
    return [each for each in MODES if each.within == mode.key]
