# SPDX-License-Identifier: GPL-3.0-or-later
"""Denoising of published pairs of noisy and true meshes, compared with the papers' results.

Pairs lie in the folder ``denoise`` of the data: files ``NAME.npz`` with the arrays ``noisy``,
``truth`` and ``faces``. None of them is used for training.
"""

from __future__ import annotations

from pathlib import Path

import common
import numpy as np
from report import table
from shock_filter import core

PUBLISHED = {
    "fandisk_n6": ("GCN-Denoiser (Shen et al. 2022)", 3.95),
    "fertility_n3": ("GCN-Denoiser (Shen et al. 2022)", 4.01),
    "kinect_cone": ("MeshTGV (Liu et al. 2021)", 7.23),
}
"""Mean angles over faces in degrees, from the meshes that the authors give as their results."""

WHITE = "_n1", "_n2", "_n3"
"""Noise of 0.1, 0.2 and 0.3 mean edges."""


def pair_of(path: Path) -> tuple[core.TriangleMesh, core.TriangleMesh]:
    """The noisy mesh and the true one."""
    with np.load(path) as arrays:
        faces = arrays["faces"]
        return (
            core.TriangleMesh(arrays["noisy"].astype(np.float64), faces),
            core.TriangleMesh(arrays["truth"].astype(np.float64), faces),
        )


def published(job: common.Job) -> None:
    """Mean angles to the true normals, before and after, and what others have published."""
    if job.data is None:
        return
    rows, means, behind = [], [], []
    for path in sorted((job.data / "denoise").glob("*.npz")):
        noisy, truth = pair_of(path)
        before = common.normal_error(noisy, truth)
        denoised = noisy.moved_to(core.denoise_geometry(noisy))
        after = common.normal_error(denoised, truth)
        sharp = common.normal_error(denoised.moved_to(core.sharpen_geometry(denoised)), truth)
        who, theirs = PUBLISHED.get(path.stem, ("", None))
        if path.stem.endswith(WHITE):
            means.append((before, after, sharp))
        if theirs is not None and after > theirs:
            behind.append(f"{path.stem} ({after:.2f}, {who.partition(' ')[0]} {theirs:.2f})")
        other = "" if theirs is None else f"{theirs:.2f}, {who}"
        rows.append([path.stem, f"{before:.2f}", f"{after:.2f}", f"{sharp:.2f}", other])
    if not rows:
        raise SystemExit("There are no pairs: put them into the folder denoise of the data.")
    if means:
        mean = np.mean(means, axis=0)
        rows.append(["mean with noise of 0.1 to 0.3 edges", *(f"{off:.2f}" for off in mean), ""])
    text = [
        "Mean angle over faces to the true normals, in degrees, at the default, and after"
        " *Then Sharpen* at its default.",
        table(["pair", "noisy", "ours", "then sharpened", "published"], rows),
        f"Behind: {', '.join(behind) or 'nowhere'}.",
    ]
    job.page.write("published", "\n\n".join(text))
