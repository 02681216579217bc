# SPDX-License-Identifier: GPL-3.0-or-later
"""What the fuzz tests draw: meshes, signals, images, texture coordinates, masks and settings.

``SHOCK_FILTER_FUZZ=long`` draws at random, and much more; otherwise every run is alike.
"""

import os

import numpy as np
from hypothesis import HealthCheck, assume, settings
from hypothesis import strategies as st
from shapes import cube, grid, icosphere
from shock_filter import core
from shock_filter.core.base.checks import LARGEST
from shock_filter.core.settings import describe

LONG = os.environ.get("SHOCK_FILTER_FUZZ") == "long"

_TIMES_MORE = 5
_MOST_COUNT = 200 if LONG else 30  # passes, iterations and what else is counted


def examples(count):
    """Decorate a test: how many examples it gets in a short run."""
    return settings(
        max_examples=count * (_TIMES_MORE if LONG else 1),
        derandomize=not LONG,
        deadline=None,
        database=None,
        print_blob=True,
        suppress_health_check=list(HealthCheck),
    )


# ------------------------------------------------------------------------------------------ meshes


def _soup(rng):
    count = rng.integers(3, 20)
    vertices = rng.integers(0, 4, (count, 3)).astype(np.float64)
    return vertices, rng.integers(0, count, (rng.integers(1, 40), 3))


def _fan(rng):
    # One vertex with many faces, of which the last may not meet the first.
    count = rng.integers(3, 90)
    angles = np.linspace(0, 2 * np.pi, count, endpoint=bool(rng.integers(2)))
    rim = np.stack([np.cos(angles), np.sin(angles), rng.uniform(-0.2, 0.2, count)], axis=1)
    around = np.arange(1, count)
    faces = np.stack([np.zeros_like(around), around, around + 1], axis=1)
    return np.concatenate([np.zeros((1, 3)), rim]), faces


_SHAPES = {
    "triangle": lambda rng: (rng.normal(size=(3, 3)), np.array([[0, 1, 2]])),
    "soup": _soup,
    "fan": _fan,
    "sheet": lambda rng: grid(*rng.integers(2, 7, 2), jitter=0.3, seed=rng.integers(99)),
    "ball": lambda rng: icosphere(1),
    "box": lambda rng: cube(rng.integers(1, 5)),
    "threads": lambda rng: grid(26, 26, jitter=0.3),  # enough for several chunks
}


def _roughen(vertices, faces, rng):
    size = float(np.ptp(vertices, axis=0).max())
    return vertices + rng.normal(scale=0.02 * size, size=vertices.shape), faces


def _flatten(vertices, faces, rng):
    return vertices * np.roll([1.0, 1.0, 0.0], rng.integers(3)), faces


def _stretch(vertices, faces, rng):
    return vertices * np.roll([1.0, 1.0, 10.0 ** rng.integers(-9, 10)], rng.integers(3)), faces


def _repeat_faces(vertices, faces, rng):
    return vertices, np.concatenate([faces, faces[rng.integers(0, len(faces), 3)]])


def _turn_faces(vertices, faces, rng):
    turned = rng.random(len(faces)) < 0.4
    return vertices, np.where(turned[:, None], faces[:, ::-1], faces)


def _shrink_faces(vertices, faces, rng):
    faces = faces.copy()
    chosen = rng.integers(0, len(faces), 2)
    faces[chosen, 0] = faces[chosen, rng.integers(1, 3)]
    return vertices, faces


def _merge_vertices(vertices, faces, rng):
    index = np.arange(len(vertices))
    index[rng.integers(0, len(index), 2)] = rng.integers(0, len(index))
    return vertices, index[faces]


def _stack_vertices(vertices, faces, rng):
    vertices = vertices.copy()
    vertices[rng.integers(0, len(vertices), 3)] = vertices[rng.integers(0, len(vertices))]
    return vertices, faces


def _split_vertices(vertices, faces, rng):
    return vertices[faces].reshape(-1, 3), np.arange(3 * len(faces)).reshape(-1, 3)


def _add_loose(vertices, faces, rng):
    far = rng.normal(size=(3, 3)) * 10.0 ** rng.integers(-3, 12)
    return np.concatenate([vertices, far]), faces


def _add_fins(vertices, faces, rng):
    edges = faces[rng.integers(0, len(faces), 3), :2]
    tips = vertices[edges[:, 0]] + rng.normal(size=(3, 3))
    numbers = len(vertices) + np.arange(3)
    return np.concatenate([vertices, tips]), np.concatenate([faces, np.c_[edges, numbers]])


def _add_copy(vertices, faces, rng):
    away = rng.choice([0.0, 1.0, 1e5])
    copied = vertices * 10.0 ** rng.integers(-4, 1) + away
    return np.concatenate([vertices, copied]), np.concatenate([faces, faces + len(vertices)])


def _drop_faces(vertices, faces, rng):
    kept = rng.random(len(faces)) < 0.7
    return vertices, faces[kept] if kept.any() else faces


_CHANGES = [
    _roughen, _flatten, _stretch, _repeat_faces, _turn_faces, _shrink_faces, _merge_vertices,
    _stack_vertices, _split_vertices, _add_loose, _add_fins, _add_copy, _drop_faces,
]  # fmt: skip


@st.composite
def triangles(draw):
    """Draw vertices and faces that may be anything but out of range."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    vertices, faces = _SHAPES[draw(st.sampled_from(list(_SHAPES)))](rng)
    for change in draw(st.lists(st.sampled_from(_CHANGES), max_size=4)):
        vertices, faces = change(vertices, faces, rng)
    scale = draw(st.sampled_from([1.0, 1.0, 1.0, 1e-3, 1e4, 1e-30, 1e30, 1e-90, 1e90]))
    away = draw(st.sampled_from([0.0, 0.0, 0.0, 10.0, 1e6, -1e12]))
    vertices = (vertices + away) * scale
    if draw(st.booleans()) and 1e-10 < scale < 1e10:
        vertices = vertices.astype(np.float32)
    return vertices, faces


@st.composite
def meshes(draw):
    """Draw a mesh that has a surface."""
    vertices, faces = draw(triangles())
    try:
        return core.TriangleMesh(vertices, faces)
    except core.InvalidMesh:
        assume(False)


# ----------------------------------------------------------------------------------------- signals

_VALUES = {
    "constant": lambda rng, shape: np.full(shape, rng.normal()),
    "zeros": lambda rng, shape: rng.choice([0.0, -0.0], shape),
    "noise": lambda rng, shape: rng.random(shape),
    "steps": lambda rng, shape: rng.integers(0, 2, shape) * 1.0,
    "spike": lambda rng, shape: (rng.random(shape) > 0.95) * 1e6,
    "large": lambda rng, shape: rng.normal(size=shape) * 1e18,
    "largest": lambda rng, shape: rng.uniform(-1, 1, shape) * LARGEST,
    "tiny": lambda rng, shape: rng.normal(size=shape) * 1e-40,
    "around": lambda rng, shape: 1e7 + rng.random(shape),
    "sparse": lambda rng, shape: np.round(rng.random(shape), 1),
}


@st.composite
def values(draw, shape):
    """Draw an array of float32 or float64."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    array = _VALUES[draw(st.sampled_from(list(_VALUES)))](rng, shape)
    if draw(st.booleans()):
        return array.astype(np.float32)
    return array * draw(st.sampled_from([1.0, 1.0, 1.0, 1e-200, 1e-310]))


@st.composite
def signals(draw, *places):
    """Draw a signal of a few channels, or of none."""
    channels = draw(st.sampled_from([(), (1,), (2,), (3,), (4,), (7,)]))
    return draw(values((*places, *channels)))


@st.composite
def masks(draw, *shape):
    """Draw weights in [0, 1], many of them 0 and 1; or None."""
    if draw(st.booleans()):
        return None
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    weights = np.clip(rng.uniform(-0.5, 1.5, shape), 0.0, 1.0)
    return weights.astype(draw(st.sampled_from([np.float32, np.float64])))


@st.composite
def broken(draw, array):
    """Spoil an array: NaN, infinity, another shape or type."""
    how = draw(
        st.sampled_from(["nan", "inf", "1e200", "longer", "shorter", "deeper", "type", "text"])
    )
    if how in ("nan", "inf", "1e200"):
        spoiled = np.array(array, dtype=np.float64)
        spoiled.reshape(-1)[draw(st.integers(0, spoiled.size - 1))] = float(how)
        return spoiled
    if how == "longer":
        return np.concatenate([array, array[:1]])
    if how == "shorter":
        return array[:-1]
    if how == "deeper":
        return np.zeros((*array.shape, 2, 2))
    if how == "type":
        return np.zeros(np.shape(array), draw(st.sampled_from([complex, object, "datetime64[s]"])))
    return draw(st.sampled_from([None, "text", [[1, 2], [3]], {}, np.nan, np.zeros((0, 3))]))


# ------------------------------------------------------------------------------------------ images


@st.composite
def images(draw):
    """Draw an image of any type that the filters take."""
    sizes = st.sampled_from([1, 2, 3, 4, 5, 8, 13, 20])
    shape = draw(sizes), draw(sizes)
    kind = draw(st.sampled_from([np.uint8, np.uint16, float, float]))
    if kind is float:
        image = draw(signals(*shape))
        return image * image.dtype.type(draw(st.sampled_from([1.0, 1.0, 1.0, 3e8])))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    channels = draw(st.sampled_from([(), (1,), (2,), (3,), (4,), (5,)]))
    most = draw(st.sampled_from([1, 2, np.iinfo(kind).max + 1]))
    return rng.integers(0, most, (*shape, *channels)).astype(kind)


@st.composite
def texture_coordinates(draw, mesh):
    """Draw coordinates of the corners: layouts good and bad."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    kind = draw(st.sampled_from(["flat", "flat", "apart", "random", "small", "line", "point"]))
    corners = mesh.scaled_vertices[mesh.faces]
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    flat = (corners - low)[..., :2] / max((high - low).max(), 1e-9)
    size = int(np.ceil(np.sqrt(mesh.face_count)))
    number = np.arange(mesh.face_count)
    cells = np.stack([number % size, number // size], axis=1)[:, None]
    uv = {
        "flat": flat,  # sides that face away lie mirrored, over the others
        "apart": (cells + 0.1 + 0.8 * np.array([[0, 0], [1, 0], [0, 1]])) / size,
        "random": rng.random((mesh.face_count, 3, 2)),
        "small": 0.5 + 1e-3 * flat,
        "line": flat * [1.0, 0.0],
        "point": np.full_like(flat, 0.3),
    }[kind]
    if draw(st.integers(0, 3)) == 0:
        some = rng.random(mesh.face_count) < 0.3
        uv[some] = uv[some][:, :1]  # no area
    move = draw(st.sampled_from([0.0, 0.0, 0.5, -1.0, 17.25, 9e5]))
    scale = draw(st.sampled_from([1.0, 1.0, -1.0, 2.5, 40.0, 1e-7]))
    return uv * [scale, abs(scale)] + [move, 0.0]


# ---------------------------------------------------------------------------------------- settings


def _numbers(kind, about):
    low, high = max(about.minimum, about.soft_minimum), min(about.maximum, about.soft_maximum)
    if kind is int:
        return st.integers(int(low), int(min(high, low + 4)))
    ends = st.sampled_from([about.minimum, about.maximum])
    return st.one_of(st.floats(low, high), st.floats(low, high), ends)


@st.composite
def settings_of(draw, cls):
    """Draw settings over their whole ranges; at most one count is its largest."""
    fields = describe(cls)
    chosen = {
        name: draw(st.sampled_from(list(about.choices)) if kind is str else _numbers(kind, about))
        for name, (kind, _, about) in fields.items()
        if draw(st.integers(0, 2)) or name == "time"
    }
    counts = [name for name, (kind, *_) in fields.items() if kind is int]
    if draw(st.integers(0, 15)) == 0 and counts:
        name = draw(st.sampled_from(counts))
        chosen.update(dict.fromkeys(set(counts) & chosen.keys(), 1))
        chosen[name] = min(int(fields[name][2].maximum), _MOST_COUNT)
        if name == "iterations":  # a wide kernel so often would take many minutes
            chosen["time"] = min(chosen["time"], 1.0)
    return cls(**chosen)
