# SPDX-License-Identifier: GPL-3.0-or-later
"""Velocities in NetCDF and Zarr files, read by xarray, with the names of the CF conventions."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ....errors import ShockError
from ...reading import check_claim, check_source, needed, reading
from .hdf5 import check_hdf5
from .zarr_metadata import check_zarr

GRIDS = (".nc", ".nc4", ".cdf", ".zarr")

_PAIRS = (
    ("u", "v"), ("U", "V"), ("u10", "v10"), ("uo", "vo"), ("ugos", "vgos"), ("uas", "vas"),
    ("ua", "va"), ("water_u", "water_v"), ("vx", "vy"), ("velocity_x", "velocity_y"),
)  # fmt: skip
"""Names of both components, in the order of preference."""

_TURNS = (("eastward", "northward"), ("x_", "y_"))
"""Words in which both components' standard names differ."""

_AXES = {
    "x": ({"longitude", "projection_x_coordinate", "grid_longitude"}, {"lon", "longitude", "x"}),
    "y": ({"latitude", "projection_y_coordinate", "grid_latitude"}, {"lat", "latitude", "y"}),
    "t": ({"time"}, {"time", "t"}),
}
"""Standard names and names of coordinates."""

_EVEN = 0.01  # largest deviation from even times, in steps


def read_grid(
    path: Path, variables: Sequence[str] | None, select: Mapping[str, int], any_size: bool
) -> tuple[npt.NDArray[np.float32], tuple[str, ...]]:
    """Read (h, w, 2) or (k, h, w, 2) velocities, rows from the top down, and notes on them."""
    xarray = needed("xarray", path, "fields")
    with reading(path, any_size), _opened(xarray, path) as (data, stored):
        names = _names(path, data, variables)
        pair = [data[name].isel(_chosen(path, data[name], select)) for name in names]
        first, second = pair
        if first.dims != second.dims or first.shape != second.shape:
            raise ShockError(
                f"{path}: {names[0]} is given at {_told(first)}, {names[1]} at {_told(second)};"
                " interpolate both to the same places."
            )
        _check_numbers(path, pair)
        check_claim(path, 2.0 * first.size * 4, stored)
        order = _order(path, first)
        single = {name: 0 for name in first.dims if name not in order}
        parts = [each.isel(single).transpose(*order) for each in pair]
        first, _ = parts
        velocity = _loaded(parts)
        for axis, dimension in zip((-3, -2), order[-2:], strict=True):
            velocity = _sorted(velocity, axis, _places(first, dimension))
        notes = [f"velocities are {names[0]} and {names[1]}"]
        if len(order) == 3:
            velocity, note = _evenly(velocity, _places(first, order[0]))
            notes += note
    return velocity, tuple(notes)


@contextmanager
def _opened(xarray: Any, path: Path) -> Iterator[tuple[Any, int | None]]:
    """Open a file after checking what that would read, and count the bytes of a folder.

    xarray gets a store or an absolute path, as it takes some names for network addresses.
    """
    words: dict[str, Any]
    if path.suffix.lower() == ".zarr":
        zarr = needed("zarr", path, "fields")
        stored = check_zarr(path)
        source = zarr.storage.LocalStore(path.absolute(), read_only=True)
        # A folder's consolidated metadata may differ from those of its arrays.
        words = {"engine": "zarr", "consolidated": False}
    else:
        check_source(path, GRIDS)
        netcdf = needed("netCDF4", path, "fields")
        check_hdf5(path)
        check_claim(path, _claimed_at_once(netcdf, path))
        stored, source, words = None, path.absolute(), {"engine": "netcdf4"}
    with xarray.open_dataset(source, decode_times=False, **words) as data:
        yield data, stored


def _claimed_at_once(netcdf: Any, path: Path) -> float:
    """Count the bytes of coordinates, named like their only dimension, which opening reads."""
    with netcdf.Dataset(str(path.absolute())) as data:
        return sum(
            float(np.dtype(variable.dtype).itemsize) * variable.size
            for name, variable in data.variables.items()
            if variable.dimensions == (name,)
        )


def _check_numbers(path: Path, pair: Sequence[Any]) -> None:
    for values in pair:
        if values.dtype.kind not in "fiu":
            raise ShockError(
                f"{path}: {values.name} holds values of type {values.dtype}; save real numbers."
            )


def _loaded(parts: Sequence[Any]) -> npt.NDArray[np.float32]:
    """Read both components, one time at a time, so that memory holds only the result."""
    first, _ = parts
    velocity = np.empty((*first.shape, 2), np.float32)
    for component, values in enumerate(parts):
        moments = range(len(values)) if values.ndim == 3 else [slice(None)]
        for moment in moments:
            with np.errstate(over="ignore"):  # infinity is refused later, in a sentence
                velocity[moment, ..., component] = values[moment].values
    return velocity


def _names(path: Path, data: Any, variables: Sequence[str] | None) -> tuple[str, str]:
    known = list(data.data_vars)
    listed = ", ".join(known) or "none"
    if variables is not None:
        missing = [name for name in variables if name not in known]
        if missing:
            raise ShockError(f"{path} has no variable {missing[0]}; it has: {listed}.")
        return variables[0], variables[1]
    found = [pair for pair in _PAIRS if set(pair) <= set(known)]
    if found:
        return found[0]
    pairs = _by_standard_names(data)
    if len(pairs) == 1:
        return pairs[0]
    what = "several velocities" if pairs else "no variables named u and v, or as CF has them"
    raise ShockError(f"{path} has {what}; name both with --variables. It has: {listed}.")


def _by_standard_names(data: Any) -> list[tuple[str, str]]:
    names = {data[name].attrs.get("standard_name", ""): name for name in data.data_vars}
    names.pop("", None)
    pairs = []
    for standard, name in names.items():
        for first, second in _TURNS:
            other = names.get(standard.replace(first, second, 1))
            if first in standard and other not in (None, name):
                pairs.append((name, other))
                break
    return pairs


def _chosen(path: Path, values: Any, select: Mapping[str, int]) -> dict[str, int]:
    for name, number in select.items():
        if name not in values.dims:
            dimensions = ", ".join(map(str, values.dims))
            raise ShockError(f"{path} has no dimension {name}; it has: {dimensions}.")
        if not -values.sizes[name] <= number < values.sizes[name]:
            raise ShockError(
                f"{path}: {name} has {values.sizes[name]} places; give one from 0, not {number}."
            )
    return dict(select)


def _order(path: Path, values: Any) -> list[str]:
    """Order the dimensions in use: time if there are several, rows, columns."""
    axes = {name: _axis(values, name) for name in values.dims}
    plane = [next((name for name, axis in axes.items() if axis == wanted), None) for wanted in "yx"]
    if None in plane:  # curvilinear grids, and those without coordinates
        others = [name for name, axis in axes.items() if axis != "t"]
        if len(others) < 2:
            raise ShockError(f"{path}: velocities are given at {_told(values)}; they need a plane.")
        plane = others[-2:]
    rest = [name for name in values.dims if name not in plane and values.sizes[name] > 1]
    times = [name for name in rest if axes[name] == "t"]
    for name in rest:
        if name not in times[:1]:
            raise ShockError(
                f"{path}: velocities have a dimension {name} of {values.sizes[name]} places; choose"
                f" one of these with --select {name}=0."
            )
    return [*times, *plane]


def _axis(values: Any, name: str) -> str:
    """Tell whether a dimension is x, y or t, from its coordinate or otherwise from its name."""
    attributes = values.coords[name].attrs if name in values.coords else {}
    stated = str(attributes.get("axis", "")).lower()
    if stated in _AXES:
        return stated
    for axis, (standard, plain) in _AXES.items():
        if attributes.get("standard_name") in standard or str(name).lower() in plain:
            return axis
    return "t" if " since " in str(attributes.get("units", "")) else ""


def _places(values: Any, name: str) -> npt.NDArray[np.float64]:
    """Return the coordinates of a dimension's samples; their numbers if there are none."""
    if name in values.coords and values.coords[name].dtype.kind in "fiu":
        places = values.coords[name].values.astype(np.float64)
        if np.isfinite(places).all():
            return places
    return np.arange(values.sizes[name], dtype=np.float64)


def _sorted(velocity: npt.NDArray, axis: int, places: npt.NDArray) -> npt.NDArray:
    """Order rows from the top down, by descending coordinate, and columns from the left."""
    falls = len(places) > 1 and places[-1] < places[0]
    wanted = axis == -3
    return velocity if falls == wanted else np.flip(velocity, axis)


def _evenly(velocity: npt.NDArray, times: npt.NDArray) -> tuple[npt.NDArray, list[str]]:
    """Interpolate key frames to even times."""
    steps = np.diff(times)
    if not ((steps > 0).all() or (steps < 0).all()):
        return velocity, ["its times do not rise: taken as even"]
    if steps[0] < 0:
        velocity, times = velocity[::-1], times[::-1]
    even = np.linspace(times[0], times[-1], len(times))
    if np.abs(even - times).max() <= _EVEN * np.abs(steps).min():
        return velocity, []
    place = np.interp(even, times, np.arange(len(times)))
    before = np.minimum(place.astype(np.int64), len(times) - 2)
    share = (place - before).astype(np.float32)[:, None, None, None]
    brought = (1 - share) * velocity[before] + share * velocity[before + 1]
    return brought, ["its times are uneven: interpolated to even ones"]


def _told(values: Any) -> str:
    return " x ".join(f"{name} {size}" for name, size in values.sizes.items())
