# SPDX-License-Identifier: GPL-3.0-or-later
"""What all benchmarks share: meshes, errors against ground truth, clocks and processes."""

from __future__ import annotations

import argparse
import math
import multiprocessing
import os
import platform
import resource
import sys
import tempfile
import time
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from PIL import Image
from report import Page
from shock_filter import core
from shock_filter.core.base.parallel import thread_count

FLOW_TIMES = [1.0, 4.0, 16.0, 64.0, 256.0, 1024.0, 4096.0, math.inf]

CREASED_SPHERE = "creased sphere"
"""Name of the mesh that needs no file."""


def machine() -> str:
    """Say in words what this runs on."""
    model = platform.processor() or platform.machine()
    about = Path("/proc/cpuinfo")
    if about.is_file():
        models = [line for line in about.read_text().splitlines() if line.startswith("model name")]
        model = models[0].partition(":")[2].strip() if models else model
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 1024**3
    return (
        f"Measured on {thread_count()} cores of {model} with {memory:.0f} GiB of memory,"
        f" {platform.system()}, Python {platform.python_version()}."
    )


def load_image(data: Path, name: str) -> np.ndarray:
    """Load a photo as (h, w, 3) uint8."""
    return np.array(Image.open(data / "images" / name).convert("RGB"))


def load_mesh(data: Path | None, name: str, subdivisions: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Load a mesh, welded, with each triangle split into four `subdivisions` times."""
    if name == CREASED_SPHERE:
        sphere = trimesh.creation.icosphere(subdivisions=subdivisions)
        points = np.asarray(sphere.vertices)
        return points / np.sqrt(abs(points).max(axis=1, keepdims=True)), np.asarray(sphere.faces)
    mesh = trimesh.load(data / "meshes" / name, process=False)
    if not len(mesh.faces):
        raise SystemExit(f"{name} was read as an empty mesh.")
    representatives, index = core.weld(mesh.vertices)
    vertices, faces = np.asarray(mesh.vertices)[representatives], index[mesh.faces]
    for _ in range(subdivisions):
        vertices, faces = trimesh.remesh.subdivide(vertices, faces)
    return vertices, faces


def shuffled(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the same mesh with vertices and faces in random order."""
    random = np.random.default_rng(1)
    order = random.permutation(len(vertices))
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return vertices[order], rank[faces][random.permutation(len(faces))]


def save_mesh(path: Path, data: Path | None, name: str, subdivisions: int, shuffle: bool) -> int:
    """Write a mesh for `read_mesh`; return its number of vertices."""
    vertices, faces = load_mesh(data, name, subdivisions)
    if shuffle:
        vertices, faces = shuffled(vertices, faces)
    np.savez(path, vertices=vertices, faces=faces)
    return len(vertices)


def read_mesh(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Read what `save_mesh` wrote."""
    with np.load(path) as arrays:
        return arrays["vertices"], arrays["faces"]


def normal_error(mesh: core.TriangleMesh, clean: core.TriangleMesh) -> float:
    """Mean angle to the clean mesh's normals in degrees, over faces with area in both."""
    real = (mesh.areas > 0) & (clean.areas > 0)
    cosines = (mesh.normals[real] * clean.normals[real]).sum(axis=1)
    return float(np.degrees(np.arccos(np.clip(cosines, -1.0, 1.0))).mean())


def position_error(mesh: core.TriangleMesh, clean: core.TriangleMesh) -> float:
    """Root mean square distance to the clean positions, in its mean edge lengths."""
    squares = ((mesh.vertices - clean.vertices) ** 2).sum(axis=1)
    return float(np.sqrt(squares.mean())) / clean.mean_edge_length


def fastest(function: Callable[[], Any], runs: int) -> float:
    """Return the least wall-clock time of some runs, in seconds."""
    times = []
    for _ in range(runs):
        start = time.perf_counter()
        function()
        times.append(time.perf_counter() - start)
    return min(times)


class PhaseClock:
    """A progress callback that charges the time between calls to the message that stood then.

    Parameters
    ----------
    names : dict
        The phase that each message belongs to; the first one counts from the start. Messages
        that are not listed are phases of their own.
    """

    def __init__(self, names: dict[str, str]) -> None:
        self._names = names
        self._seconds = dict.fromkeys(names.values(), 0.0)
        self._phase = next(iter(names.values()))
        self._last = time.perf_counter()

    def __call__(self, fraction: float, message: str) -> bool:
        """Take note of a progress report."""
        now = time.perf_counter()
        self._seconds[self._phase] = self._seconds.get(self._phase, 0.0) + now - self._last
        self._last = now
        if message:
            self._phase = self._names.get(message, message)
        return True

    def stop(self) -> dict[str, float]:
        """Return the seconds of each phase that took any, up to now."""
        self(1.0, "")
        return {phase: seconds for phase, seconds in self._seconds.items() if seconds > 0}


def peak_memory() -> int:
    """Return the most memory that this process has held so far, in bytes."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else 1024 * peak


def in_own_process(function: Callable[..., Any], *arguments: Any) -> Any:
    """Call a module's function in a fresh process, so that its memory and libraries are its own."""
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        return pool.submit(function, *arguments).result()


@dataclass(frozen=True)
class Job:
    """What the sections work with."""

    data: Path | None
    scratch: Path
    page: Page
    everything: bool

    def scaling_meshes(self) -> list[tuple[str, int]]:
        """Meshes of growing size: names and how often they are subdivided."""
        if self.data:
            return [("bunny.obj", 0), ("igea.ply", 0), ("igea.ply", 1), ("igea.ply", 2)]
        return [(CREASED_SPHERE, level) for level in (6, 7, 8, 9)]

    def stored(self, name: str, subdivisions: int, shuffle: bool = False) -> tuple[Path, int]:
        """Make a mesh in its own process; return its file and its number of vertices."""
        file = f"{Path(name).stem}-{subdivisions}{'-shuffled' if shuffle else ''}.npz"
        path = self.scratch / file
        count = in_own_process(save_mesh, path, self.data, name, subdivisions, shuffle)
        return path, count


def make_parser(
    about: str, sections: Iterable[str], needs_data: bool = False
) -> argparse.ArgumentParser:
    """Make the parser of a program whose sections `measure` runs; `about` is its docstring."""
    parser = argparse.ArgumentParser(description=about.partition("\n")[0])
    parser.add_argument(
        "--data",
        type=_data_folder,
        required=needs_data,
        metavar="FOLDER",
        help="what holds meshes/, images/ and textured/"
        + ("" if needs_data else "; shapes made by code stand in if left out"),
    )
    parser.add_argument("--write", type=Path, metavar="PAGE", help="put the results into this page")
    parser.add_argument(
        "--only", default=",".join(sections), metavar="PARTS", help="parts to run: %(default)s"
    )
    parser.add_argument("--all", action="store_true", help="also what takes many minutes")
    return parser


def _data_folder(text: str) -> Path:
    if not Path(text, "meshes").is_dir():
        raise argparse.ArgumentTypeError(f"{text} has no folder meshes/")
    return Path(text)


def measure(
    arguments: argparse.Namespace, sections: dict[str, Callable[[Job], None]], pictures: str
) -> None:
    """Run the sections that were asked for; `pictures` names the folder of the page's pictures."""
    chosen = {name for name in arguments.only.split(",") if name}
    if unknown := chosen - set(sections):
        raise SystemExit(f"--only knows {', '.join(sections)}; not {', '.join(sorted(unknown))}")
    if arguments.write and not arguments.data:
        raise SystemExit("--write needs the test meshes: give their folder with --data")
    if not arguments.data:
        print("No test meshes, so shapes made by code stand in; give the meshes with --data.")
    page = Page(arguments.write, pictures)
    page.write("machine", machine())
    with tempfile.TemporaryDirectory() as scratch:
        job = Job(arguments.data, Path(scratch), page, arguments.all)
        for name, section in sections.items():
            if name in chosen:
                section(job)


def mesh_label(name: str, subdivisions: int) -> str:
    """Name a mesh in a table."""
    if name == CREASED_SPHERE or not subdivisions:
        return Path(name).stem
    return f"{Path(name).stem}, subdivided {'once' if subdivisions == 1 else 'twice'}"
