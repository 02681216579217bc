# SPDX-License-Identifier: GPL-3.0-or-later
"""From a release to a sharpened image: by a repository with an update, and by dropping the zip."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path

import bpy
import numpy as np
from harness import DRAWN, Steps, over, press, report

RELEASES = Path.home() / "releases"
REPOSITORY = "shock_releases"


def scenario() -> Steps:
    """Install, use, update, use and remove, twice; drop the zip; then have two copies."""
    preferences = bpy.context.preferences
    preferences.system.use_online_access = True  # asked for even where files are read
    url = (RELEASES / "index.json").as_uri()
    preferences.extensions.repos.new(name="Shock Filter", module=REPOSITORY, remote_url=url)
    yield from refresh()
    report["rounds"] = []
    for _ in range(2):
        yield from install_update_remove()
    yield from drop_zip()
    yield from enable_again(enabled_module())
    yield from install_second_copy()


def install_update_remove() -> Steps:
    """Install from the repository, update, and remove; the repository is as before then."""
    with over():
        bpy.ops.extensions.package_install("INVOKE_DEFAULT", enable_on_install=True, **package())
    yield from until(version)
    installed = version(), largest_change()
    bpy.context.scene.shock_filter.geometry.time = 77.0
    exchange_releases()
    yield from refresh()
    with over():
        bpy.ops.extensions.package_upgrade_all("INVOKE_DEFAULT")
    yield from until(lambda: version() not in ("", installed[0]))
    updated = version(), largest_change()
    time_set = bpy.context.scene.shock_filter.geometry.time
    with over():
        bpy.ops.extensions.package_uninstall("INVOKE_DEFAULT", **package())
    yield from until(lambda: not version())
    exchange_releases()
    yield from refresh()
    report["rounds"].append({"installed": installed, "updated": updated, "time": time_set})


def drop_zip() -> Steps:
    """Drop the zip onto the window, and sharpen a mesh at once."""
    with over():  # as Blender does with a file that is dropped: it asks
        zip_file = str(Path.home() / "extension.zip")
        bpy.ops.extensions.package_install_files("INVOKE_DEFAULT", url=zip_file)
    yield DRAWN
    began = time.perf_counter()
    yield from press("Return")
    yield from until(version)
    installed = time.perf_counter()
    report["sharpened"] = sharpened_mesh()
    report["seconds"] = installed - began, time.perf_counter() - installed
    report["dropped"] = version(), largest_change()


def enable_again(module: str) -> Steps:
    """Disable and enable the extension, twice."""
    report["again"] = []
    for _ in range(2):
        bpy.ops.preferences.addon_disable(module=module)
        yield DRAWN
        bpy.ops.preferences.addon_enable(module=module)
        yield DRAWN
        report["again"].append((version(), largest_change()))


def install_second_copy() -> Steps:
    """Install the newer version into another repository; use each, then remove the second."""
    first, second = enabled_module(), "bl_ext.user_default.shock_filter"
    newer = str(RELEASES.with_name("newer") / "newer.zip")
    bpy.ops.extensions.package_install_files(
        filepath=newer, repo="user_default", enable_on_install=False
    )
    try:
        bpy.ops.preferences.addon_enable(module=second)
    except RuntimeError as refused:  # an error that an operator reports
        report["refused"] = str(refused)
    report["both"] = [(version(), largest_change())]
    for off, on in 2 * ((first, second), (second, first)):
        bpy.ops.preferences.addon_disable(module=off)
        bpy.ops.preferences.addon_enable(module=on)
        yield DRAWN
        report["both"].append((version(), largest_change()))
    (number,) = [
        i
        for i, repo in enumerate(bpy.context.preferences.extensions.repos)
        if repo.module == "user_default"
    ]
    bpy.ops.extensions.package_uninstall(repo_index=number, pkg_id="shock_filter")
    yield DRAWN
    report["both"].append((version(), largest_change()))


def package() -> dict[str, object]:
    """Return what names the extension to Blender's operators."""
    return {"repo_index": repository(), "pkg_id": "shock_filter"}


def exchange_releases() -> None:
    """Have the repository hold the newer version, or the older one again."""
    other, between = RELEASES.with_name("newer"), RELEASES.with_name("between")
    RELEASES.rename(between)
    other.rename(RELEASES)
    between.rename(other)


def enabled_module() -> str:
    """Return the name of the module that is enabled."""
    addons = bpy.context.preferences.addons
    (module,) = [each.module for each in addons if each.module.endswith(".shock_filter")]
    return module


def repository() -> int:
    """Return the number of the repository."""
    repos = bpy.context.preferences.extensions.repos
    (number,) = [i for i, repo in enumerate(repos) if repo.module == REPOSITORY]
    return number


def refresh() -> Steps:
    """Have Blender read the repository, once its last job there has ended."""

    def is_read() -> bool:
        try:
            bpy.ops.extensions.repo_sync(repo_index=repository())
        except RuntimeError as problem:
            if "lock" not in str(problem):
                raise
            return False
        return True

    yield from until(is_read)


def version() -> str:
    """Return the version that is at work, out of any repository; empty where there is none."""
    for addon in bpy.context.preferences.addons:
        module = sys.modules.get(addon.module)
        if addon.module.endswith(".shock_filter") and getattr(module, "__addon_enabled__", False):
            return module.__version__
    return ""


def until(reached: Callable[[], object], limit: float = 120.0) -> Steps:
    """Wait for what a job in the background does."""
    end = time.monotonic() + limit
    while not reached():
        if time.monotonic() > end:
            raise TimeoutError("Blender has not done it.")
        yield 0.2
    yield DRAWN


def sharpened_mesh() -> list[str]:
    """Sharpen a mesh; return what Blender says of it."""
    bpy.ops.mesh.primitive_monkey_add()
    return sorted(bpy.ops.shock_filter.sharpen_geometry())


def largest_change() -> float:
    """Sharpen a soft edge in an image; return how much a value changes at most."""
    image = bpy.data.images.new("Edge", 32, 8, float_buffer=True)
    values = np.ones((8, 32, 4), np.float32)
    values[..., :3] = (1 / (1 + np.exp(-(np.arange(32) - 15.5) / 3)))[:, None]
    image.pixels.foreach_set(values.ravel())
    bpy.ops.shock_filter.sharpen_image(image=image.name, time=1024.0, output="REPLACE")
    found = np.empty(values.size, np.float32)
    image.pixels.foreach_get(found)
    return float(np.abs(found - values.ravel()).max())
