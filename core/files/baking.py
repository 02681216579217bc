# SPDX-License-Identifier: GPL-3.0-or-later
"""Maps baked from mesh files, also from a detailed mesh onto a simple one."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..atlas import TextureAtlas
from ..base.progress import phase, reporting
from ..errors import ShockError
from ..maps.baking import SIGNED, bake_maps
from ..maps.names import files_of_maps
from ..mesh.triangle_mesh import TriangleMesh
from ..mesh.weld import weld
from ..settings import BakeSettings
from ..texture.texels import check_covered
from .fields import field_outcome, field_pixels
from .formats.mesh.trimesh import SceneFile
from .image_formats import FORMATS, image_size
from .images import write_image_files
from .meshes import IN_PLACE, read_document
from .output import DEFAULTS, Options, Outcome, check_free
from .reading import check_target
from .textures import RAW, read_textured_mesh


def bake_file(
    mesh: str | Path,
    target: str | Path,
    maps: Sequence[str],
    high: str | Path | None,
    size: tuple[int, int] | str | Path,
    settings: BakeSettings,
    options: Options = DEFAULTS,
) -> Outcome:
    """Bake maps of a mesh file in one run, and write them as images.

    Parameters
    ----------
    mesh, target, size, options
        As in :func:`shock_filter.core.files.fields.field_file`. Files of several maps are named by
        `files_of_maps`, and appear together.
    maps : sequence of str
        Maps of `bake_maps` that need no colors.
    high : path, optional
        The file of the detailed mesh of which the maps are.
    settings : BakeSettings

    Raises
    ------
    ShockError
        If a file cannot be read or written, or a map needs a detailed mesh.
    """
    maps = list(dict.fromkeys(maps))
    targets = dict(zip(maps, files_of_maps(Path(target), maps), strict=True))
    for name, each in targets.items():
        _check(name, each, high is not None, settings.look, options.overwrite)
    height, width = size if isinstance(size, tuple) else image_size(size, options.any_size, False)
    surface = read_textured_mesh(mesh, options.material, options.any_size)
    detailed = None if high is None else _read_detailed(Path(high), options.any_size)
    with reporting(options.progress):
        with phase(0.0, 0.1, "Finding the charts"):
            atlas = TextureAtlas(surface.mesh, surface.uv, size=(height, width))
            check_covered(atlas)
        with phase(0.1, 1.0, "Baking maps"):
            baked = bake_maps(
                surface.mesh, surface.uv, settings, size=(height, width), maps=maps, high=detailed,
                atlas=atlas,
            )  # fmt: skip
    images = {}
    for name, each in targets.items():
        depth = np.uint16 if each.suffix.lower() == ".png" else np.uint8
        pixels = field_pixels(baked[name], atlas.inside, each, depth)
        images[each] = np.ascontiguousarray(pixels[::-1])
    write_image_files(images, options.overwrite)
    notes = (*surface.notes, *atlas.report.sentences(made=True))
    if len(maps) == 1:
        (values,) = baked.values()
        return field_outcome(values.reshape(height, width, -1).mean(axis=2), atlas.inside, notes)
    names = ", ".join(each.name for each in targets.values())
    done = f"{names} on {{changed}} of {{total}} texels"
    return Outcome(height * width, int(atlas.inside.sum()), notes, done)


def _check(name: str, target: Path, has_high: bool, look: str, overwrite: bool) -> None:
    # Before anything is computed.
    check_target(target, FORMATS)
    check_free(target, overwrite)
    if not has_high and name in ("normals", "displacement"):
        raise ShockError(f"A map of {name} is that of a detailed mesh; name its file with --high.")
    if name in SIGNED and look == "values" and target.suffix.lower() not in RAW:
        raise ShockError(
            f"Values of {name} may be negative, and {target.suffix} files hold 0 to 1; choose"
            " --look gray, or write .npy, .tif or .exr."
        )


def _read_detailed(path: Path, any_size: bool) -> TriangleMesh:
    document = read_document(path, IN_PLACE.get(path.suffix.lower(), SceneFile), any_size)
    first, index = weld(document.vertices)
    return TriangleMesh(document.vertices[first], index[document.faces])
