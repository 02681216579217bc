# SPDX-License-Identifier: GPL-3.0-or-later
"""Measure denoising: speed, distances, images and meshes, compared with other programs.

``python benchmarks/denoise.py --data FOLDER --write docs/denoise-benchmarks.md`` measures all and
puts tables, plots and pictures into the page. Without test meshes, generated shapes are used.
"""

from __future__ import annotations

from pathlib import Path

import common
from denoise_bumps import bumps
from denoise_distances import distances, flow
from denoise_images import betas, images, kernels, manifold
from denoise_kinds import speed_of_kinds
from denoise_made import made
from denoise_meshes import meshes, noise
from denoise_models import models
from denoise_pictures import draw_scans, joint, painted, pictures
from denoise_published import published
from denoise_relief import relief
from denoise_speed import speed
from denoise_textures import textures
from scans import scans

SECTIONS = {
    "speed": speed,
    "kinds": speed_of_kinds,
    "distances": distances,
    "flow": flow,
    "images": images,
    "betas": betas,
    "kernels": kernels,
    "manifold": manifold,
    "textures": textures,
    "meshes": meshes,
    "noise": noise,
    "scans": scans,
    "made": made,
    "published": published,
    "models": models,
    "relief": relief,
    "bumps": bumps,
    "pictures": pictures,
    "painted": painted,
    "joint": joint,
}


def main() -> None:
    """Run the benchmarks."""
    parser = common.make_parser(__doc__, SECTIONS)
    parser.add_argument(
        "--scans", type=Path, metavar="FOLDER", help="also draw the test meshes, into this folder"
    )
    arguments = parser.parse_args()
    if arguments.scans and not arguments.data:
        parser.error("--scans needs the test meshes: give their folder with --data")
    common.measure(arguments, SECTIONS, "denoise")
    if arguments.scans:
        draw_scans(arguments.data, arguments.scans)


if __name__ == "__main__":
    main()
