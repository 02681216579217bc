# SPDX-License-Identifier: GPL-3.0-or-later
"""Matrices of meshes for the tests: stiffness, mass and gradient."""

import numpy as np
import scipy.sparse
from shock_filter.core.mesh import calculus


def stiffness_matrix(mesh):
    """The cotangent stiffness, positive semidefinite: (n, n)."""
    n = mesh.vertex_count
    halves = calculus.cotangents(mesh)
    start, columns, weights, diagonal = calculus.stiffness_weights(mesh, halves, np.zeros(n))
    off = scipy.sparse.csr_matrix((-weights, columns, start), shape=(n, n))
    return (off + scipy.sparse.diags(diagonal)).tocsr()


def mass_matrix(mesh):
    """The areas around the vertices as a diagonal matrix: (n, n)."""
    return scipy.sparse.diags(calculus.lumped_mass(mesh), format="csr")


def gradient_matrix(mesh):
    """The gradient as a matrix (3 m, n); rows are grouped by face, three components each."""
    corners = mesh.scaled_vertices[mesh.faces]
    opposite = np.roll(corners, 1, axis=1) - np.roll(corners, -1, axis=1)
    double = 2.0 * np.where(mesh.areas > 0, mesh.areas, np.inf)
    hats = np.cross(mesh.normals[:, None], opposite) / double[:, None, None]
    columns = np.repeat(mesh.faces, 3, axis=0).reshape(-1)
    values = hats.transpose(0, 2, 1).reshape(-1)
    start = np.arange(0, len(columns) + 1, 3)
    shape = 3 * mesh.face_count, mesh.vertex_count
    return scipy.sparse.csr_matrix((values, columns, start), shape=shape)


def divergence(mesh, vectors):
    """Integrate the divergence of (m, 3) vectors against each vertex's hat function: (n,)."""
    return -(gradient_matrix(mesh).T @ (mesh.areas[:, None] * vectors).reshape(-1))
