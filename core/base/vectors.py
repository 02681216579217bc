# SPDX-License-Identifier: GPL-3.0-or-later
"""Vector algebra in space and steps around a triangle, inlined into the kernels that use them.

Vectors are tuples of three numbers, or rows of arrays.
"""

from __future__ import annotations

from .parallel import kernel

TIE_BREAKER = (0.5842, 0.6117, 0.5333)
"""A direction along no axis or diagonal: it decides between equal lengths or costs."""


@kernel
def edge(vertices, a, b):
    """Vector from row a of `vertices` to row b."""
    return (
        vertices[b, 0] - vertices[a, 0],
        vertices[b, 1] - vertices[a, 1],
        vertices[b, 2] - vertices[a, 2],
    )


@kernel
def cross(u, v):
    """Cross product."""
    return u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]


@kernel
def dot(u, v):
    """Scalar product."""
    return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]


@kernel
def after(k):
    """The corner (or half-edge) of a triangle that follows k; twice, the one before it."""
    return k + 1 if k < 2 else 0
