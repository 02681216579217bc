# SPDX-License-Identifier: GPL-3.0-or-later
"""Textures as values on the sheet of their atlas, and results written back into images."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..atlas import TextureAtlas
from ..atlas.ghosts import fill_ghosts
from ..atlas.gutter import TexelWriter, unit_normals
from ..atlas.normal_frames import NormalFrames
from ..atlas.seam_fit import SeamFit
from ..atlas.seams import settle_seams
from ..atlas.sheet import ROWS
from ..base.checks import BAND, SCALES, Floats
from ..base.parallel import blocks, run
from ..base.progress import aside, phase
from ..color.signals import mix_rows
from ..elements.matrices import TextureSpace
from ..elements.surface_values import sheet_values
from ..errors import InvalidSignal, InvalidUV
from ..grid.channels import opacity_channel
from ..grid.pixels import copied
from ..mesh.triangle_mesh import TriangleMesh
from ..settings import (
    BeltramiTextureSettings,
    DilateSettings,
    EnlargeSettings,
    FillSettings,
    FilterSettings,
    RepairSettings,
    StitchSettings,
    TextureSettings,
)

_WithContent = (
    BeltramiTextureSettings
    | EnlargeSettings
    | FillSettings
    | FilterSettings
    | RepairSettings
    | StitchSettings
    | TextureSettings
)


class Texture(NamedTuple):
    """The texels of an atlas, and the content of their channels.

    Attributes
    ----------
    atlas : TextureAtlas
    pixels : (h, w, c) array
    alpha : int
        The channel of opacity; -1: none.
    normals : bool
        Whether the first channels are tangent-space normals, encoded as colors.
    frames : NormalFrames or None
        Frames that turn such normals to object space for the filter; `normals` is then False.
    unit : bool
        Whether the filter works on object-space normals of unit length in the first channels.
    opacity_stays : bool
        Whether opacity keeps its bits inside charts.
    made : bool
        Whether the image is made from the surface, and holds nothing before.
    """

    atlas: TextureAtlas
    pixels: npt.NDArray
    alpha: int = -1
    normals: bool = False
    frames: NormalFrames | None = None
    unit: bool = False
    opacity_stays: bool = True
    made: bool = False


def normals_of(
    texture: Texture,
    settings: FillSettings | FilterSettings | StitchSettings,
    normals: Floats | None,
) -> Texture:
    """Return the texture with the frames of its normals, if it holds normals.

    Parameters
    ----------
    texture : Texture
    settings : FillSettings, FilterSettings or StitchSettings
        Its `content` says whether the texture holds normals.
    normals : (m, 3, 3) float64, optional
        As in `NormalFrames`.
    """
    if settings.content == "values":
        return texture
    if settings.content == "object_normals":
        return texture._replace(unit=True)
    is_down = settings.content == "normals_y_down"
    frames = NormalFrames(texture.atlas, normals, green_down=is_down)
    return texture._replace(frames=frames, unit=True)


def check_content(pixels: npt.NDArray, settings: _WithContent) -> None:
    """Raise `InvalidSignal` if an image cannot hold the content that the settings name."""
    if settings.content != "values":
        check_channels(pixels)


def checked_content(
    pixels: npt.NDArray, settings: BeltramiTextureSettings | EnlargeSettings | TextureSettings
) -> tuple[int, bool]:
    """Return the channel of opacity, and whether the others are tangent-space normals.

    Raises
    ------
    InvalidSignal
        If an image cannot hold the content that the settings name.
    """
    check_content(pixels, settings)
    return opacity_channel(pixels.shape[2], settings.alpha), settings.content == "normals"


def check_channels(pixels: npt.NDArray) -> None:
    """Raise `InvalidSignal` if an image cannot hold normals."""
    if pixels.ndim != 3 or pixels.shape[2] not in (3, 4):
        raise InvalidSignal(
            f"The normal map has the shape {pixels.shape}; give three channels, or four."
        )


def gathered(texture: Texture, settings: DilateSettings) -> tuple[Texture, npt.NDArray[np.float32]]:
    """Return the texture with its seams settled, and the values of the nodes inside charts."""
    atlas, pixels, alpha, normals = texture[:4]
    with aside("Comparing the seams"):
        values = values_of(atlas, pixels, alpha, texture.frames)
        atlas = settle_seams(
            atlas, values, settings.seams, least_step(pixels), alpha=alpha, normals=normals
        )
    return texture._replace(atlas=atlas), values


def values_of(
    atlas: TextureAtlas, pixels: npt.NDArray, alpha: int, frames: NormalFrames | None = None
) -> npt.NDArray[np.float32]:
    """Return an image's values at the nodes inside charts, opacity clipped to [0, 1].

    With `frames`, tangent-space normals are turned to object space.
    """
    values = atlas.gather(pixels)
    if alpha >= 0:
        opacity = values[..., alpha]
        for rows in blocks(len(values), BAND):
            np.clip(opacity[rows], 0.0, 1.0, out=opacity[rows])
    if frames is not None:
        frames.to_object(values)
    return values


def least_step(pixels: npt.NDArray) -> float:
    """Return the distance between neighbouring values of an integer type; 0 for floats."""
    return SCALES[pixels.dtype.name] if pixels.dtype.kind == "u" else 0.0


def mix_texels(
    atlas: TextureAtlas,
    values: npt.NDArray[np.float32],
    amount: float,
    weights: npt.NDArray[np.float64] | None,
    result: npt.NDArray[np.float32],
) -> None:
    """Mix a result with its input, in place; `weights` is a mask (h, w)."""
    if weights is not None or amount < 1.0:
        with phase(1.0, 1.0, "Filling the gutter"):
            if weights is None:
                shares = np.full(atlas.sheet.nodes.size, amount, dtype=np.float32)
            else:
                shares = amount * atlas.gather(weights[..., None]).reshape(-1)
            flat = result.reshape(len(shares), -1)
            run(mix_rows, len(shares), values.reshape(flat.shape), flat, shares, flat)


class Output:
    """Writes results for one texture, whose seams and gutter are set up once.

    Parameters
    ----------
    texture : Texture
    settings : DilateSettings
    """

    def __init__(self, texture: Texture, settings: DilateSettings) -> None:
        self._texture = texture
        with phase(0.0, 0.5, "Filling the gutter"):
            self._fit = None if texture.normals else SeamFit(texture.atlas)
        with phase(0.5, 1.0, "Filling the gutter"):
            self._writer = TexelWriter(
                texture.atlas,
                settings,
                normals=texture.normals,
                frames=texture.frames,
                made=texture.made,
            )

    def written(
        self, values: npt.NDArray[np.float32], keep: npt.NDArray[np.bool_] | None
    ) -> npt.NDArray:
        """Return the image with the values of nodes inside charts, and with the gutter filled.

        Parameters
        ----------
        values : (rows, columns, c) float32
            Overwritten.
        keep : (h, w) bool, optional
            Texels inside charts that stay as they are.
        """
        texture = self._texture
        with aside("Filling the gutter"):
            read_ghosts(texture, values)
            if self._fit is not None:
                self._fit.apply(values, least_step(texture.pixels))
            if texture.normals or texture.unit:
                run(unit_normals, len(values), values, chunk=ROWS)
            out = copied(texture.pixels)
        opacity = texture.alpha if texture.opacity_stays else -1
        self._writer.write(values, keep, out, opacity=opacity)
        return out


def written(
    texture: Texture,
    values: npt.NDArray[np.float32],
    settings: DilateSettings,
    keep: npt.NDArray[np.bool_] | None,
) -> npt.NDArray:
    """Return the image with values as `Output.written` does, for a single result."""
    with phase(0.0, 0.6, "Filling the gutter"):
        output = Output(texture, settings)
    with phase(0.6, 1.0, "Filling the gutter"):
        return output.written(values, keep)


def drawn(texture: Texture, space: TextureSpace, values: npt.NDArray, gutter: int) -> npt.NDArray:
    """Return an image of a function on the surface: (n, c) -> (h, w, c) float32."""
    sheet = np.zeros((*space.labels.shape, values.shape[1]), dtype=np.float32)
    sheet_values(space, values, sheet)
    return written(texture._replace(made=True), sheet, DilateSettings(gutter=gutter), None)


def read_ghosts(texture: Texture, values: npt.NDArray[np.float32]) -> None:
    """Fill the ghosts from across the seams, in place."""
    atlas, _, alpha, normals = texture[:4]
    fill_ghosts(atlas.sheet, atlas.sources, values, alpha, 0.5 if normals else None)


def checked_atlas(
    atlas: TextureAtlas | None, mesh: TriangleMesh, uv: npt.ArrayLike, pixels: npt.NDArray
) -> TextureAtlas:
    """Return the given atlas if it fits the image, or a new one if it is None."""
    height, width = pixels.shape[:2]
    if atlas is None:
        return TextureAtlas(mesh, uv, size=(height, width))
    if not isinstance(atlas, TextureAtlas):
        raise InvalidSignal(f"atlas is {atlas!r}; give a TextureAtlas, or leave it out.")
    if atlas.mesh is not mesh or (atlas.height, atlas.width) != (height, width):
        raise InvalidSignal(
            f"The atlas is for {atlas.width} x {atlas.height} texels of its own mesh, the image"
            f" has {width} x {height}; make an atlas for this mesh and size."
        )
    return atlas


def check_covered(atlas: TextureAtlas) -> None:
    """Raise `InvalidUV` if all charts are too small to cover the centre of a texel."""
    if not atlas.inside.any():
        raise InvalidUV(
            "No chart covers the middle of a texel; use a larger image, or unwrap the mesh into"
            " larger charts."
        )


def grays_of(values: npt.NDArray[np.float32], inside: npt.NDArray[np.bool_]) -> npt.NDArray:
    """Return the visible values of a generated image: (h, w).

    Of several channels, such as those of `reaction_diffusion`, these are the values of the last
    one, scaled to at most 1.
    """
    if values.ndim == 2:
        return values
    last = values[..., -1]
    largest = float(last.max(initial=0.0, where=inside))
    return last / np.float32(largest) if largest > 0 else last
