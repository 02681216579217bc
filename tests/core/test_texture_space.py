# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests of the finite elements on texels: cut cells, mass and stiffness across seams."""

import numpy as np
import pytest
import scipy.sparse.linalg
from shock_filter import core
from shock_filter.core.base.findings import gathering
from shock_filter.core.elements.cut import _jumps
from shock_filter.core.elements.matrices import TextureSpace
from surface_spaces import in_full, mass_matrix, positions, space_of, square


def aligned(off):
    # Puts the seams onto lines between texel centers, or beside by so many texels.
    def change(uv):
        size = 4 * (2 * 16 + 16)
        return np.round(uv * size) / size + (0.5 + off) / size

    return change


def mirrored(uv):
    return uv * [-1.0, 1.0] + [1.0, 0.0]


def some_shrunk(share):
    def change(uv):
        moved = uv.copy()
        blocks = moved.reshape(16, -1, 3, 2) if len(uv) % 16 == 0 else None
        assert blocks is not None
        number = (np.floor(uv.mean(axis=1)[:, ::-1] * 4) @ [4, 1]).astype(int)
        for b in range(0, 16, 2):
            middle = uv[number == b].reshape(-1, 2).mean(axis=0)
            moved[number == b] = middle + share * (uv[number == b] - middle)
        return moved

    return change


def one_face_flat(uv):
    moved = uv.copy()
    moved[40, 2] = moved[40, 1]
    return moved


LAYOUTS = {
    "one chart": (False, 0.4, lambda uv: uv),
    "turned charts": (True, 0.4, lambda uv: uv),
    "right angles and mirrored": (True, None, lambda uv: uv),
    "seams on lattice lines": (True, None, aligned(0.0)),
    "1e-7 texels beside": (True, None, aligned(1e-7)),
    "1e-4 texels beside": (True, None, aligned(1e-4)),
    "all mirrored": (True, 0.4, mirrored),
    "another density": (True, 0.4, some_shrunk(0.31)),
    "charts of a third of a texel": (True, 0.4, some_shrunk(0.02)),
    "a face without area in the texture": (True, 0.4, one_face_flat),
    "stretched": (False, 0.4, lambda uv: (uv - 0.5) * [1.0, 0.3] + 0.5),
}


@pytest.fixture(params=LAYOUTS, scope="module")
def space(request):
    charts, angle, change = LAYOUTS[request.param]
    return space_of(*square(64, charts, angle, change))


def vectors(space, columns=1, seed=0):
    values = np.random.default_rng(seed).normal(size=(space.size, columns)).astype(np.float32)
    values[: space.labels.size][space.labels.reshape(-1) < 0] = 0.0
    return values


def test_mass_adds_up_to_the_area(space):
    area = space.area * space.atlas.texel_size**2
    assert area == pytest.approx(64.0 * 64.0, rel=1e-6)
    assert mass_matrix(space).sum() == pytest.approx(space.area, rel=1e-5)


def test_the_stiffness_of_a_constant_is_zero(space):
    constant = np.full((space.size, 1), 3.0, dtype=np.float32)
    assert np.abs(space.apply_stiffness(constant)).max() < 1e-6
    couplings, _ = in_full(space, 0.0)
    assert np.abs(couplings.sum(axis=1)).max() < 1e-11 * np.abs(couplings).max()


def test_matrices_are_symmetric_and_definite(space):
    matrix, _ = in_full(space, 0.1)
    assert np.abs(matrix - matrix.T).max() < 1e-9 * np.abs(matrix).max()
    values = np.random.default_rng(1).normal(size=(matrix.shape[0], 5))
    assert (np.einsum("ij,ij->j", values, matrix @ values) > 0).all()


def test_products_are_those_of_the_assembled_matrix(space):
    matrix, used = in_full(space, 0.0)
    values = vectors(space, 2)
    product = space.apply_stiffness(values)
    expected = matrix @ values[used].astype(np.float64)
    scale = np.abs(matrix) @ np.abs(values[used])
    assert (np.abs(product[used] - expected) <= 3e-6 * scale + 1e-9).all()


def test_linear_functions_have_the_energy_of_the_surface(space):
    places = positions(space)
    ways = (places[:, :2] @ [0.6, 0.8] / space.atlas.texel_size)[:, None]
    ways = np.nan_to_num(ways - np.nanmean(ways))  # 0 at what is no unknown
    result = space.apply_stiffness(ways.astype(np.float32))
    assert (ways * result).sum() == pytest.approx(space.area, rel=2e-5)


def test_faces_told_apart_within_cells_have_the_same_area_and_energy():
    mesh, uv, size = square(64, False)
    uv = uv + 0.05 * np.sin(9 * uv[..., ::-1])
    space = space_of(mesh, uv, size)
    finer = TextureSpace(space.atlas, 0.1)
    assert finer.cut_cells.cut.sum() > 1.3 * space.cut_cells.cut.sum()
    assert finer.area == pytest.approx(space.area, rel=1e-6)
    places = positions(finer)
    ways = np.nan_to_num(places[:, :1] - np.nanmean(places[:, 0])) / finer.atlas.texel_size
    result = finer.apply_stiffness(ways.astype(np.float32))
    assert (ways * result).sum() == pytest.approx(finer.area, rel=1e-2)


def test_diffusion_along_and_across_has_the_energy_of_its_tensor(space):
    mesh = space.atlas.mesh
    corners = mesh.vertices[mesh.faces][..., :2]
    one = corners[:, 1] - corners[:, 0]
    one /= np.linalg.norm(one, axis=1, keepdims=True)
    axes = np.stack([one, one[:, ::-1] * mesh.normals[:, 2:] * [-1.0, 1.0]], axis=1)
    tensor = np.array([[1.0, 0.3], [0.3, 0.2]])
    turned = axes @ tensor @ axes.transpose(0, 2, 1)
    other = space.diffusing(np.stack([turned[:, 0, 0], turned[:, 0, 1], turned[:, 1, 1]], axis=1))
    assert other.area == pytest.approx(space.area, rel=1e-6)
    way = np.array([0.6, -0.8])
    values = (positions(space)[:, :2] @ way / space.atlas.texel_size)[:, None]
    values = np.nan_to_num(values - np.nanmean(values))
    energy = (values * other.apply_stiffness(values.astype(np.float32))).sum()
    assert energy == pytest.approx(way @ tensor @ way * space.area, rel=5e-5)


def test_diffusion_alike_in_all_directions_changes_nothing(space):
    same = space.diffusing(np.tile([1.0, 0.0, 1.0], (space.atlas.mesh.face_count, 1)))
    assert np.array_equal(same.cells, space.cells)
    assert np.allclose(same.fans, space.fans, rtol=1e-6, atol=1e-9)


def poisson_error(space, n):
    """Root mean square error of a solution on the square, and the largest."""
    matrix, used = in_full(space, (space.atlas.texel_size / n) ** 2)
    x, y, _ = positions(space)[used].T / n
    exact = np.cos(np.pi * x) * np.cos(2 * np.pi * y)
    source = mass_matrix(space) @ ((1 + 5 * np.pi**2) * exact)
    right = source * (space.atlas.texel_size / n) ** 2
    error = scipy.sparse.linalg.spsolve(matrix.tocsc(), right) - exact
    return np.sqrt(np.mean(error**2)), np.max(np.abs(error))


@pytest.mark.parametrize(
    ("charts", "angle"), [(False, 0.4), (False, 0.0), (True, 0.4), (True, None)]
)
def test_solutions_converge_with_second_order_however_it_is_cut(charts, angle):
    errors = [poisson_error(space_of(*square(n, charts, angle)), n)[0] for n in (32, 64)]
    assert errors[1] < 5e-4
    assert np.log2(errors[0] / errors[1]) > 1.9


@pytest.mark.parametrize(
    ("layout", "most"),
    [
        ("seams on lattice lines", 5e-4),
        ("1e-7 texels beside", 5e-4),
        ("1e-4 texels beside", 5e-4),
        ("all mirrored", 5e-4),
        ("another density", 4e-3),
        ("charts of a third of a texel", 0.3),
        ("a face without area in the texture", 1e-2),
    ],
)
def test_unusual_layouts_give_the_solution_too(layout, most):
    charts, angle, change = LAYOUTS[layout]
    error, largest = poisson_error(space_of(*square(64, charts, angle, change)), 64)
    assert error < most
    assert largest < 12 * most


def cube_ball(n):
    """A ball of six turned charts in an image of n x n texels, its faces as large as a texel."""
    ticks = np.linspace(-1.0, 1.0, n // 3 + 1)
    steps = len(ticks) - 1
    flat = np.stack(np.meshgrid(ticks, ticks), axis=-1).reshape(-1, 2)
    first = (np.arange(steps) + (steps + 1) * np.arange(steps)[:, None]).reshape(-1, 1)
    quads = first[:, None] + np.array([[0, 1, steps + 2], [0, steps + 2, steps + 1]])
    vertices, faces, uv = [], [], []
    for side in range(6):
        corner = np.empty((len(flat), 3))
        corner[:, side % 3] = 1.0 if side < 3 else -1.0
        corner[:, (side + 1) % 3] = flat[:, 0] * corner[:, side % 3]
        corner[:, (side + 2) % 3] = flat[:, 1]
        vertices.append(np.tan(np.pi / 4 * corner))  # squares of about one size on the ball
        faces.append(quads.reshape(-1, 3) + side * len(flat))
        c, s = np.cos(0.35 * (side + 1)), np.sin(0.35 * (side + 1))
        place = np.array([side % 3 + 0.5, side // 3 + 0.75]) / 3
        uv.append(place + flat @ np.array([[c, s], [-s, c]]) * 0.112)
    kept, index = core.weld(np.round(np.concatenate(vertices), 9))
    points = np.concatenate(vertices)[kept]
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    corners = np.concatenate(faces)
    return core.TriangleMesh(points, index[corners]), np.concatenate(uv)[corners], n


def ring(n):
    """A torus in 2 x 2 charts, in an image of n x n texels; and the angles at its vertices."""
    steps = n // 2
    angle = 2 * np.pi * np.arange(steps) / steps
    around, across = np.meshgrid(angle, angle, indexing="ij")
    radius = 2.0 + np.cos(across)
    points = np.stack(
        [radius * np.cos(around), radius * np.sin(around), np.sin(across)], axis=-1
    ).reshape(-1, 3)
    i, j = (a.reshape(-1) for a in np.mgrid[:steps, :steps])
    squares = [(0, 0), (1, 0), (1, 1)], [(0, 0), (1, 1), (0, 1)]
    faces, uv = [], []
    chart = np.stack([2 * i // steps, 2 * j // steps], axis=-1)
    for triangle in squares:
        corner = [(i + a, j + b) for a, b in triangle]
        faces.append(np.stack([(a % steps) * steps + b % steps for a, b in corner], axis=-1))
        place = np.stack([np.stack(ab, axis=-1) for ab in corner], axis=1) / steps
        uv.append(0.45 * place + 0.02 + 0.5 * chart[:, None] - 0.45 * 0.5 * chart[:, None])
    return core.TriangleMesh(points, np.concatenate(faces)), np.concatenate(uv), n


def on_ball(places):
    # A harmonic of degree 2, and (1 - Laplacian) of it.
    x, y, z = (places / np.linalg.norm(places, axis=1, keepdims=True)).T
    value = x * y + 0.3 * (z * z - x * x)
    return value, 7 * value


def on_ring(places):
    # sin(2 around) cos(across); the metric is (2 + cos across)^2 and 1.
    x, y, z = places.T
    radius = np.hypot(x, y)
    around, across = np.arctan2(y, x), np.arctan2(z, radius - 2.0)
    radius = 2.0 + np.cos(across)
    value = np.sin(2 * around) * np.cos(across)
    laplacian = -4 * value / radius**2 - value
    laplacian += np.sin(2 * around) * np.sin(across) ** 2 / radius
    return value, value - laplacian


@pytest.mark.parametrize(
    ("surface", "function", "sizes"), [(cube_ball, on_ball, (36, 72)), (ring, on_ring, (40, 80))]
)
def test_solutions_on_curved_surfaces_converge_with_second_order(surface, function, sizes):
    errors = []
    for n in sizes:
        space = space_of(*surface(n))
        scale = space.atlas.texel_size**2
        matrix, used = in_full(space, scale)
        exact, source = function(positions(space)[used])
        right = scale * (mass_matrix(space) @ source)
        found = scipy.sparse.linalg.spsolve(matrix.tocsc(), right)
        errors.append(np.sqrt(np.mean((found - exact) ** 2)))
    assert np.log2(errors[0] / errors[1]) > 1.85
    assert errors[1] < 0.01


def test_the_ball_has_its_spectrum():
    off = []
    for n in (36, 72):
        space = space_of(*cube_ball(n))
        stiffness, _ = in_full(space, 0.0)
        found = scipy.sparse.linalg.eigsh(
            stiffness, k=16, M=mass_matrix(space), sigma=-1e-3, return_eigenvectors=False
        )
        off.append(
            np.sort(found) / space.atlas.texel_size**2 - np.repeat([0, 2, 6, 12], [1, 3, 5, 7])
        )
    coarse, fine = np.abs(off)
    assert coarse[0] < 1e-4
    for first, last in ((1, 4), (4, 9), (9, 16)):
        assert np.log2(coarse[first:last].max() / fine[first:last].max()) > 1.8


def test_nothing_crosses_closed_seams():
    space = space_of(*square(64), closed=True)
    labels = np.zeros((space.size, 1), dtype=np.float32)
    nodes = space.labels.reshape(-1)
    labels[: len(nodes), 0] = np.where(nodes >= 0, nodes, 0)
    couplings, used = in_full(space, 0.0)
    count, parts = scipy.sparse.csgraph.connected_components(couplings, directed=False)
    assert count == 16
    own = used < len(nodes)
    pairs = {(int(p), int(label)) for p, label in zip(parts[own], nodes[used[own]], strict=True)}
    assert len(pairs) == 16
    whole, _ = in_full(space_of(*square(64)), 0.0)
    assert scipy.sparse.csgraph.connected_components(whole, directed=False)[0] == 1


def test_weights_scale_cells_and_pieces():
    space = space_of(*square(64))
    values, half = vectors(space), np.full(space.size, 0.5, dtype=np.float32)
    expected = 0.5 * space.apply_stiffness(values)
    for weights in (space.means(half), space.least(half)):
        assert np.allclose(space.apply_stiffness(values, weights), expected, atol=1e-5)
        assert np.allclose(space.weighted(weights).apply_stiffness(values), expected, atol=1e-5)
    only_mass = space.weighted(space.means(half), only_mass=True)
    assert (only_mass.apply_stiffness(values) == space.apply_stiffness(values)).all()
    half_mass = mass_matrix(only_mass) - 0.5 * mass_matrix(space)
    assert abs(half_mass).max() < 1e-5


def test_faces_without_area_in_space_are_left_out():
    mesh, uv, size = square(64)
    vertices = mesh.vertices.copy()
    vertices[mesh.faces[40, 2]] = vertices[mesh.faces[40, 1]]
    space = space_of(core.TriangleMesh(vertices, mesh.faces), uv, size)
    matrix, _ = in_full(space, 0.1)
    assert np.isfinite(matrix.data).all()
    assert (matrix.diagonal() > 0).all()


@pytest.mark.parametrize("size", [100, 300])
def test_faces_without_area_in_the_texture_with_too_many_corners_are_told(size):
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    mesh = core.TriangleMesh(vertices, [[0, 1, 2], [1, 0, 3]])
    uv = np.array([[[0, 0], [1, 0], [0, 1]], [[1, 0], [0, 0], [0.5, 0]]], dtype=np.float64)
    with gathering() as findings:
        TextureSpace(core.TextureAtlas(mesh, uv, size=(size, size)))
    said = [str(finding) for finding in findings]
    assert [text.split(": ")[1] for text in said] == (["1."] if size == 300 else [])
    assert all(text.startswith("Faces without area in the texture") for text in said)


@pytest.mark.parametrize("stretch", [0.5, 0.9, 2.0, 4.0])
def test_lengths_jump_by_their_ratio_over_the_longer_texel(stretch):
    one, other = np.eye(2), stretch * np.eye(2)
    twins = np.array([[3, -1, -1], [0, -1, -1]], dtype=np.int32)
    jumps = _jumps(twins, np.stack([one, other])).reshape(2, 3)
    longer = np.sqrt(2.0) * max(1.0, stretch)
    expected = np.sqrt(2.0) * abs(stretch - 1.0 / stretch) * longer
    assert jumps[:, 0] == pytest.approx([expected, expected])
    assert (jumps[:, 1:] == 0).all()
