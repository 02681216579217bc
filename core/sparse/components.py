# SPDX-License-Identifier: GPL-3.0-or-later
"""Connected components of a graph that is given as a list of links."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..base.parallel import kernel, run_in_order

Ints = npt.NDArray[np.int32]


def connected_components(
    count: int, one: npt.NDArray[np.integer], other: npt.NDArray[np.integer]
) -> tuple[int, Ints]:
    """Find which nodes links connect, directly or through others.

    Parameters
    ----------
    count : int
        Number of nodes.
    one, other : (k,) int
        The two ends of each link.

    Returns
    -------
    components : int
        How many there are; nodes without links are components of their own.
    labels : (count,) int32
        The component of each node; components are ordered by their lowest nodes.

    Notes
    -----
    Disjoint sets with path halving (Tarjan and van Leeuwen 1984); the lowest node is the root of
    its set, so that one pass in order finds roots before their members.

    Examples
    --------
    >>> import numpy as np
    >>> from shock_filter.core.sparse.components import connected_components
    >>> components, labels = connected_components(5, np.array([3, 4]), np.array([1, 0]))
    >>> components, labels.tolist()
    (3, [0, 1, 2, 1, 0])
    """
    parents = np.arange(count, dtype=np.int32)
    ends = (np.ascontiguousarray(nodes, dtype=np.int32) for nodes in (one, other))
    run_in_order(_join, len(one), *ends, parents)
    components = np.zeros(1, dtype=np.int32)
    run_in_order(_label, count, parents, components)
    return int(components[0]), parents


@kernel
def root_of(parents, node):
    """Return the root of a node's set, and halve the path to it."""
    while parents[node] != node:
        parents[node] = parents[parents[node]]
        node = parents[node]
    return node


@kernel
def _join(start, stop, one, other, parents):
    for i in range(start, stop):
        a, b = root_of(parents, one[i]), root_of(parents, other[i])
        parents[max(a, b)] = min(a, b)


@kernel
def _label(start, stop, parents, components):
    # In place: parents come before their children, and have their labels already.
    for i in range(start, stop):
        if parents[i] == i:
            parents[i] = components[0]
            components[0] += 1
        else:
            parents[i] = parents[parents[i]]
