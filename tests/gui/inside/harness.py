# SPDX-License-Identifier: GPL-3.0-or-later
"""What scenarios use inside Blender: steps, mouse, keys, the picture on the screen, the report.

A scenario is a generator that yields how many seconds Blender may go on before its next step.
"""

from __future__ import annotations

import hashlib
import json
import subprocess
import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import bpy
import numpy as np

MODULE = "bl_ext.user_default.shock_filter"
TAB = "Shock Filter"
SCREEN = Path.home() / "Xvfb_screen0"
REPORT, PICTURES = (Path(name) for name in sys.argv[sys.argv.index("--") + 2 :][:2])
PICTURES_ARE_KEPT = sys.argv[-1] == "kept"

DRAWN = 1.0  # seconds in which a window is drawn afresh, also on a slow machine
MARK = (1.0, 0.0, 1.0, 1.0)

Steps = Iterator[float]
Rectangle = tuple[int, int, int, int]

report: dict[str, Any] = {}
"""What was read back; written to a file when the scenario ends, in whatever way."""


def play(scenario: Callable[[], Steps]) -> None:
    """Run a scenario in this Blender, write the report, and quit."""
    steps = scenario()

    def step() -> float | None:
        try:
            return next(steps)
        except StopIteration:
            report["ended"] = True
        except Exception:  # whatever it is belongs into the report
            report["traceback"] = traceback.format_exc()
        save()
        bpy.ops.wm.quit_blender()
        return None

    bpy.context.preferences.view.show_splash = False
    if not PICTURES_ARE_KEPT:  # smooth outlines are drawn eight times, without a graphics card
        bpy.context.preferences.system.viewport_aa = "OFF"
    bpy.context.preferences.use_preferences_save = False  # the next scenario starts afresh
    bpy.app.timers.register(step, first_interval=2.0, persistent=True)


def save() -> None:
    """Write the report; while a scenario runs, for the case that Blender crashes in it."""
    REPORT.write_text(json.dumps(report, default=float), encoding="utf-8")


def addon(name: str) -> ModuleType:
    """Return one of the add-on's modules that are loaded."""
    return sys.modules[f"{MODULE}.shock_addon.{name}"]


def area(kind: str) -> bpy.types.Area:
    """Return the first area of a kind."""
    areas = bpy.context.window_manager.windows[0].screen.areas
    return next(a for a in areas if a.type == kind)


def region(kind: str, part: str = "WINDOW") -> bpy.types.Region:
    """Return a region of the first area of a kind."""
    return next(r for r in area(kind).regions if r.type == part)


def over(kind: str = "VIEW_3D") -> Any:
    """Let operators run as if the mouse were over an area."""
    window = bpy.context.window_manager.windows[0]
    return bpy.context.temp_override(window=window, area=area(kind), region=region(kind))


def run(name: str, kind: str = "VIEW_3D", **settings: Any) -> list[str]:
    """Start one of the extension's operators as its button does."""
    with over(kind):
        return sorted(getattr(bpy.ops.shock_filter, name)("INVOKE_DEFAULT", **settings))


def open_tab(kind: str = "VIEW_3D") -> Steps:
    """Show the extension's tab in the sidebar."""
    area(kind).spaces.active.show_region_ui = True
    yield DRAWN
    region(kind, "UI").active_panel_category = TAB
    region(kind, "UI").tag_redraw()
    yield DRAWN


def open_own_panel(number: int, kind: str = "VIEW_3D") -> Steps:
    """Close the tab's first panel, and open a closed one, by clicks on their headers.

    `number` counts from the bottom: -1 is the last one.
    """
    yield from click_header(0, kind)
    yield from click_header(number, kind)


def click_header(number: int, kind: str = "VIEW_3D") -> Steps:
    """Click on the header of one of the tab's panels."""
    places = yield from headers(kind)
    yield from click(places[number])
    yield from park(kind)
    yield 2 * DRAWN  # it opens slowly


def headers(kind: str = "VIEW_3D") -> Iterator[float]:
    """Find the headers of the tab's panels; the generator returns their rectangles."""
    found = panel_headers(kind)
    true = tuple(getattr(*found))
    setattr(*found, MARK)
    yield from park(kind)
    yield DRAWN
    places = marked(region(kind, "UI"))
    setattr(*found, true)
    yield DRAWN
    return places


def panel_headers(kind: str) -> tuple[Any, str]:
    """Return the theme's color of the headers of panels: its owner and its name."""
    theme = bpy.context.preferences.themes[0]
    if hasattr(theme.user_interface, "panel_header"):  # Blender 5
        return theme.user_interface, "panel_header"
    space = theme.view_3d if kind == "VIEW_3D" else theme.image_editor
    return space.space.panelcolors, "header"


def running() -> bool:
    """Tell whether a run is under way, or its thread has not ended yet."""
    threads = [thread.name for thread in threading.enumerate()]
    return addon("running.jobs").current() is not None or any(
        "shock-filter-job" in n for n in threads
    )


def finished(limit: float = 240.0) -> Steps:
    """Wait for the end of the run, and for what Blender does then."""
    end = time.monotonic() + limit
    while running():
        if time.monotonic() > end:
            raise TimeoutError("The run has not ended.")
        yield 0.05
    yield DRAWN


# Mouse and keys. Places are pixels from the window's lower left corner, as Blender counts them.


def press(*keys: str) -> Steps:
    """Press keys, one after the other, and wait for what they do."""
    for key in keys:
        press_key(key)
        yield DRAWN


def press_key(key: str) -> None:
    """Press a key, such as ``ctrl+z``."""
    subprocess.run(["xdotool", "key", key], check=True)


def type_text(text: str) -> Steps:
    """Type words."""
    subprocess.run(["xdotool", "type", "--delay", "60", text], check=True)
    yield DRAWN


def move(x: float, y: float) -> None:
    """Move the mouse."""
    height = bpy.context.window_manager.windows[0].height
    subprocess.run(["xdotool", "mousemove", str(int(x)), str(int(height - 1 - y))], check=True)


def button(action: str, number: int = 1) -> None:
    """Press (``mousedown``), release (``mouseup``) or ``click`` a button of the mouse."""
    subprocess.run(["xdotool", action, str(number)], check=True)


def park(kind: str = "VIEW_3D") -> Steps:
    """Move the mouse over the middle of an area, where nothing is highlighted."""
    place = region(kind)
    for shift in (0, 5):
        move(place.x + place.width * 0.4 + shift, place.y + place.height * 0.5)
        yield 0.2


def click(place: Rectangle) -> Steps:
    """Click into the middle of a rectangle."""
    left, bottom, right, top = place
    for shift in (2, 0):
        move((left + right) / 2 + shift, (bottom + top) / 2)
        yield 0.2
    button("click")
    yield 0.3


def drag(place: Rectangle, distance: int) -> Steps:
    """Press the mouse in the middle of a rectangle, and drag it sideways."""
    left, bottom, right, top = place
    x, y = (left + right) / 2, (bottom + top) / 2
    move(x, y)
    yield 0.3
    button("mousedown")
    yield 0.1
    for part in range(1, 11):
        move(x + distance * part / 10, y)
        yield 0.1
    button("mouseup")
    yield DRAWN


def whole_window() -> SimpleNamespace:
    """Return the place of all that is seen."""
    window = bpy.context.window_manager.windows[0]
    return SimpleNamespace(x=0, y=0, width=window.width, height=window.height)


# The picture on the screen.


def screen() -> np.ndarray:
    """Return the screen's picture, row 0 at the bottom, as bytes (height, width, RGB)."""
    data = SCREEN.read_bytes()
    header = np.frombuffer(data, ">u4", 25)
    width, height, line, colors = (int(header[i]) for i in (4, 5, 12, 19))
    pixels = np.frombuffer(data, np.uint8, height * line, int(header[0]) + 12 * colors)
    return pixels.reshape(height, line)[::-1, : 4 * width].reshape(height, width, 4)[..., 2::-1]


def crop(place: Any) -> np.ndarray:
    """Return a region's or an area's part of the screen's picture."""
    return screen()[place.y : place.y + place.height, place.x : place.x + place.width]


def picture(name: str, place: Any, width: int = 900) -> None:
    """Keep the upper right part of a region's or an area's picture, where the sidebar is."""
    np.save(PICTURES / f"{name}.npy", crop(place)[::-1][:600, -width:])


def different(one: np.ndarray, other: np.ndarray) -> int:
    """Count the pixels that differ so that one sees it."""
    return int((np.abs(one.astype(int) - other).max(axis=2) > 24).sum())


def mark(kind: str, marked: bool, names: tuple[str, ...] = ("inner",)) -> Steps:
    """Give a kind of widget, as themes call it, a color that nothing else has, or take it back."""
    widgets = getattr(bpy.context.preferences.themes[0].user_interface, f"wcol_{kind}")
    for name in names:
        if marked:
            _true_colors[kind, name] = tuple(getattr(widgets, name))
            setattr(widgets, name, MARK)
        else:
            setattr(widgets, name, _true_colors.pop((kind, name)))
    yield DRAWN


_true_colors: dict[tuple[str, str], tuple[float, ...]] = {}


def marked(place: Any) -> list[Rectangle]:
    """Return the rectangles of marked widgets in a region, from top to bottom, left to right."""
    hit = (np.abs(crop(place).astype(int) - [255 * c for c in MARK[:3]]) < 8).all(axis=2)
    found = []
    for bottom, top in reversed(_runs(hit.sum(axis=1) > 8)):
        for left, right in _runs(hit[bottom:top].any(axis=0)):
            if right - left > 8 and top - bottom > 8:
                found.append((place.x + left, place.y + bottom, place.x + right, place.y + top))
    return found


def buttons(kind: str = "VIEW_3D") -> Iterator[float]:
    """Find the buttons of the extension's tab; the generator returns their rectangles."""
    yield from park(kind)
    yield from mark("tool", True)
    found = marked(region(kind, "UI"))
    yield from mark("tool", False)
    return found


def widgets(name: str, kind: str = "VIEW_3D") -> Iterator[float]:
    """Find the tab's widgets of a kind, chosen ones too; the generator returns their rectangles."""
    yield from park(kind)
    yield from mark(name, True, ("inner", "inner_sel"))
    found = marked(region(kind, "UI"))
    yield from mark(name, False, ("inner", "inner_sel"))
    return found


def tallest(places: list[Rectangle]) -> Rectangle:
    """Return the tallest rectangle: the tab's main button."""
    return max(places, key=lambda place: place[3] - place[1])


def _runs(flags: np.ndarray) -> list[tuple[int, int]]:
    """Return where flags are set, as beginnings and ends."""
    steps = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(int)))
    return list(zip(steps[::2].tolist(), steps[1::2].tolist(), strict=True))


# What is compared.


def fingerprint(values: np.ndarray) -> str:
    """Return a word that differs when one bit of the values does."""
    return hashlib.sha1(np.ascontiguousarray(values).tobytes()).hexdigest()


def positions(name: str) -> str:
    """Return the fingerprint of an object's vertices, in any mode."""
    obj = bpy.data.objects[name]
    if obj.mode == "EDIT":
        obj.update_from_editmode()
    flat = np.empty(3 * len(obj.data.vertices), np.float32)
    obj.data.vertices.foreach_get("co", flat)
    return fingerprint(flat)


def colors(name: str) -> str:
    """Return the fingerprint of an object's active color attribute."""
    attribute = bpy.data.objects[name].data.color_attributes.active_color
    flat = np.empty(4 * len(attribute.data), np.float32)
    attribute.data.foreach_get("color", flat)
    return fingerprint(flat)


def pixels(image: bpy.types.Image) -> str:
    """Return the fingerprint of an image."""
    flat = np.empty(len(image.pixels), np.float32)
    image.pixels.foreach_get(flat)
    return fingerprint(flat)


def last_operator() -> str:
    """Return the operator that F9 shows."""
    operators = bpy.context.window_manager.operators
    return operators[-1].bl_idname if operators else ""
