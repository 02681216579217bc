# SPDX-License-Identifier: GPL-3.0-or-later
"""Measure denoising: speed, distances, images and meshes, beside other programs.

``python benchmarks/denoise.py --data FOLDER --write docs/denoise-benchmarks.md`` measures all and
puts tables, plots and pictures into the page. Without test meshes shapes made by code stand in.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import common
from denoise_distances import distances, flow
from denoise_images import betas, images, kernels, manifold
from denoise_meshes import meshes, noise
from denoise_pictures import draw_scans, joint, painted, pictures
from denoise_speed import speed
from report import Page

SECTIONS = {
    "speed": speed,
    "distances": distances,
    "flow": flow,
    "images": images,
    "betas": betas,
    "kernels": kernels,
    "manifold": manifold,
    "meshes": meshes,
    "noise": noise,
    "pictures": pictures,
    "painted": painted,
    "joint": joint,
}


def main() -> None:
    """Run the benchmarks."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument(
        "--data", type=Path, help="folder that holds meshes/; ../shared/data beside the checkout"
    )
    parser.add_argument("--write", type=Path, metavar="PAGE", help="put the results into this page")
    parser.add_argument("--only", default=",".join(SECTIONS), help="parts to run: %(default)s")
    parser.add_argument(
        "--scans", type=Path, metavar="FOLDER", help="also draw the test meshes, into this folder"
    )
    arguments = parser.parse_args()
    chosen = [name for name in arguments.only.split(",") if name]
    if unknown := set(chosen) - set(SECTIONS):
        parser.error(f"--only knows {', '.join(SECTIONS)}; not {', '.join(sorted(unknown))}")
    data = common.find_data(arguments.data)
    if not data:
        if arguments.write or arguments.scans:
            parser.error("the test meshes are needed: give their folder with --data")
        print(
            "No test meshes: give the folder that holds meshes/ with --data. A creased sphere"
            " made by code stands in."
        )
    page = Page(arguments.write, "denoise")
    page.write("machine", common.machine())
    with tempfile.TemporaryDirectory() as scratch:
        job = common.Job(data, Path(scratch), page, False)
        for name, section in SECTIONS.items():
            if name in chosen:
                section(job)
    if arguments.scans:
        draw_scans(data, arguments.scans)


if __name__ == "__main__":
    main()
