# SPDX-License-Identifier: GPL-3.0-or-later
"""Find the examples of the documentation, and make what they work on."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh
import zarr
from PIL import Image

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]

_FENCE = re.compile(
    r"(?:^<!-- not run: (?P<reason>.+?) -->\n)?^```(?P<language>\w*)\n(?P<text>.*?)^```$",
    re.MULTILINE | re.DOTALL,
)


@dataclass(frozen=True)
class Example:
    """A fenced block of a page; `reason` says why it is not run."""

    page: str
    line: int
    language: str
    text: str
    reason: str | None

    @property
    def name(self) -> str:
        """Where the example stands."""
        return f"{self.page}:{self.line}"

    @property
    def in_blender(self) -> bool:
        """Whether it is a script for Blender."""
        return self.language == "python" and "import bpy" in self.text


def examples() -> list[Example]:
    """List all fenced blocks."""
    found = []
    for path in PAGES:
        page = path.read_text(encoding="utf-8")
        for match in _FENCE.finditer(page):
            line = page.count("\n", 0, match.start("text"))
            found.append(
                Example(path.name, line, match["language"], match["text"], match["reason"])
            )
    return found


def rounded_box() -> trimesh.Trimesh:
    """A box with soft edges."""
    box = trimesh.creation.box().subdivide().subdivide().subdivide()
    return trimesh.smoothing.filter_laplacian(box, iterations=4)


def write_inputs(folder: Path) -> None:
    """Write the files that examples name: a scan, a mesh with its texture, photos."""
    scan = rounded_box()
    scan.visual.vertex_colors = np.uint8(255 * (0.5 + 0.5 * np.tanh(4 * scan.vertices)))
    for name in ("in.ply", "in.glb", "scans/one.ply", "scans/two.ply"):
        (folder / name).parent.mkdir(exist_ok=True)
        scan.export(folder / name)
    ramp = np.tile(np.uint8(255 / (1 + np.exp(np.linspace(-6, 6, 32)))), (32, 1))
    picture = Image.fromarray(np.stack([ramp, ramp.T, ramp], axis=2))
    for name in (
        "in.png",
        "left.png",
        "right.png",
        "textures/wood.png",
        "textures/metal.png",
        "photos/one.png",
    ):
        (folder / name).parent.mkdir(exist_ok=True)
        picture.save(folder / name)
    Image.fromarray(ramp).save(folder / "where.png")
    y, x = np.mgrid[1:-1:16j, -1:1:24j]
    np.save(folder / "flow.npy", np.stack([-y, x], axis=-1))
    textured = trimesh.creation.box().subdivide()
    uv = textured.vertices[:, :2] + 0.5
    textured.visual = trimesh.visual.TextureVisuals(uv=uv, image=picture)
    textured.export(folder / "mesh.glb")
    textured.export(folder / "mesh.obj")
    zarr.save_array(folder / "in.zarr", np.array(picture))
    (folder / "shock_addon").symlink_to(ROOT / "shock_addon", target_is_directory=True)
