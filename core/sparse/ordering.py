# SPDX-License-Identifier: GPL-3.0-or-later
"""An order of elimination in which the factors of a symmetric matrix stay sparse.

Approximate minimum degree (Amestoy, Davis and Duff 1996). Eliminated unknowns are *elements*: each
stands for couplings among all unknowns on its list, which is also a column of the factor. An
unknown keeps the elements that it is on, and those neighbors with which no element couples it. Its
degree is bounded from above by the sum of what each element has outside the newest one. Unknowns
are not merged, because blocks along seams have few equivalent ones.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..base.parallel import kernel, run, run_in_order
from ..base.progress import ask
from ..errors import SolverError
from .matrix import Ints, Sparse, absolute, added, couplings_of, transposed

_AT_ONCE = 1 << 10
"""Number of unknowns that are eliminated between two checks for cancelling."""


class TooDense(SolverError):
    """The factor of a matrix would hold too many entries."""


class Ordering(NamedTuple):
    """An order of elimination, and what each column of the factor then holds.

    Attributes
    ----------
    order : (n,) int32
        The unknowns in the order of their elimination; subtrees of the elimination tree follow one
        another (postorder).
    parents : (n,) int32
        By places in that order: the first row below the diagonal; -1 if there is none.
    counts : (n,) int32
        Entries below the diagonal.
    """

    order: Ints
    parents: Ints
    counts: Ints


def minimum_degree(matrix: Sparse, most: float = np.inf) -> Ordering:
    """Order the unknowns of a symmetric matrix; entries of 0 do not count.

    Raises
    ------
    TooDense
        If the factor would hold more than `most` entries below the diagonal.

    Examples
    --------
    The middle of a star comes last but one, when one other is left:

    >>> import numpy as np
    >>> from shock_filter.core.sparse.matrix import from_triples
    >>> from shock_filter.core.sparse.ordering import minimum_degree
    >>> middle, ends = np.zeros(4, int), np.arange(1, 5)
    >>> places = np.concatenate([middle, ends]), np.concatenate([ends, middle])
    >>> minimum_degree(from_triples(*places, np.ones(8), (5, 5))).counts.tolist()
    [1, 1, 1, 1, 0]
    """
    count = matrix.shape[0]
    sizes = absolute(matrix)
    pattern = couplings_of(added(sizes, transposed(sizes)))
    graph = _graph_of(pattern)
    order, listed = np.empty(count, dtype=np.int32), np.empty(2 * len(pattern.columns), np.int32)
    done = 0
    while done < count:
        before, done = done, _eliminate(done, min(done + _AT_ONCE, count), graph, order, listed)
        if done == before:
            listed = np.concatenate([listed, np.empty(len(listed) + count, np.int32)])
        if graph.state[0] > most:
            raise TooDense(f"The factor has more than {most:g} entries; raise the limit.")
        ask(done / count)
    places = np.empty(count, dtype=np.int32)
    places[order] = np.arange(count, dtype=np.int32)
    parents = np.empty(count, dtype=np.int32)
    run(_find_parents, count, graph, order, places, listed, parents)
    post = _postorder(parents)
    renamed = np.empty(count + 1, dtype=np.int32)
    renamed[post] = np.arange(count, dtype=np.int32)
    renamed[-1] = -1
    return Ordering(order[post], renamed[parents[post]], graph.counts[order[post]])


class _Graph(NamedTuple):
    # The list of unknown i begins at start[i] of `lists`: some `elements`, then neighbors, in all
    # `lengths`. Element e lists `counts` unknowns, from begins[e] on. `absorbed` elements lie
    # within others; `outside` of the newest one lie so many unknowns, if `seen` by it. Unknowns
    # with the same bound of their degree are a list with links in both directions.
    start: Ints
    elements: Ints
    lengths: Ints
    lists: Ints
    begins: npt.NDArray[np.int64]
    counts: Ints
    absorbed: npt.NDArray[np.bool_]
    outside: Ints
    seen: Ints
    marks: Ints
    degrees: Ints
    heads: Ints
    after: Ints
    before: Ints
    state: npt.NDArray[np.int64]  # the length of all lists of elements, and the least degree


def _graph_of(pattern: Sparse) -> _Graph:
    count = pattern.shape[0]
    lengths = np.diff(pattern.start)
    nothing, none = np.zeros(count, dtype=np.int32), np.full(count, -1, dtype=np.int32)
    graph = _Graph(
        pattern.start,
        nothing.copy(),
        lengths,
        pattern.columns.copy(),
        np.zeros(count, dtype=np.int64),
        nothing.copy(),
        np.zeros(count, dtype=np.bool_),
        nothing.copy(),
        none.copy(),
        none.copy(),
        lengths.copy(),
        none.copy(),
        none.copy(),
        none.copy(),
        np.zeros(2, dtype=np.int64),
    )
    run_in_order(_hang_in, count, graph)
    return graph


def _postorder(parents: Ints) -> Ints:
    post = np.empty(len(parents), dtype=np.int32)
    _walk_tree(parents, post)
    return post


@kernel
def _hang_in(start, stop, graph):
    for i in range(start, stop):
        _hang(graph.degrees, graph.heads, graph.after, graph.before, i)


@kernel
def _hang(degrees, heads, after, before, i):
    # At the front: unknowns that have just changed are eliminated next, which keeps memory local.
    head = heads[degrees[i]]
    after[i] = head
    before[i] = -1
    if head >= 0:
        before[head] = i
    heads[degrees[i]] = i


@kernel
def _unhang(degrees, heads, after, before, i):
    if before[i] >= 0:
        after[before[i]] = after[i]
    else:
        heads[degrees[i]] = after[i]
    if after[i] >= 0:
        before[after[i]] = before[i]


@kernel
def _eliminate(start, stop, graph, order, listed):
    # Returns how many are eliminated: less than `stop` if `listed` is too short for the next one.
    for number in range(start, stop):
        least = graph.state[1]
        while graph.heads[least] < 0:
            least += 1
        graph.state[1] = least
        pivot = graph.heads[least]
        if graph.state[0] + least > len(listed):
            return number
        _unhang(graph.degrees, graph.heads, graph.after, graph.before, pivot)
        order[number] = pivot
        _make_element(graph, pivot, number, listed)
        _measure_outside(graph, pivot, number, listed)
        _update(graph, pivot, number, len(order) - number - 2, listed)
    return stop


@kernel
def _make_element(graph, pivot, number, listed):
    # Lists the unknowns that the pivot is coupled with, and marks them and the pivot.
    lists, marks, begins, counts = graph.lists, graph.marks, graph.begins, graph.counts
    first = graph.start[pivot]
    between, last = first + graph.elements[pivot], first + graph.lengths[pivot]
    begin = place = graph.state[0]
    marks[pivot] = number
    for k in range(between, last):
        marks[lists[k]] = number
        listed[place] = lists[k]
        place += 1
    for k in range(first, between):
        element = lists[k]
        graph.absorbed[element] = True
        for m in range(begins[element], begins[element] + counts[element]):
            i = listed[m]
            if marks[i] != number:
                marks[i] = number
                listed[place] = i
                place += 1
    begins[pivot] = begin
    counts[pivot] = place - begin
    graph.state[0] = place


@kernel
def _measure_outside(graph, pivot, number, listed):
    lists, starts, elements = graph.lists, graph.start, graph.elements
    seen, outside, counts = graph.seen, graph.outside, graph.counts
    for k in range(graph.begins[pivot], graph.begins[pivot] + counts[pivot]):
        i = listed[k]
        for m in range(starts[i], starts[i] + elements[i]):
            element = lists[m]
            if seen[element] != number:
                seen[element] = number
                outside[element] = counts[element]
            outside[element] -= 1


@kernel
def _update(graph, pivot, number, most, listed):
    # Lists and degrees of the unknowns on the newest element, which replaces those it covers.
    lists, starts, elements, lengths = graph.lists, graph.start, graph.elements, graph.lengths
    absorbed, outside, marks, degrees = graph.absorbed, graph.outside, graph.marks, graph.degrees
    heads, after, before = graph.heads, graph.after, graph.before
    least = graph.state[1]
    within = graph.counts[pivot] - 1
    for at in range(graph.begins[pivot], graph.begins[pivot] + graph.counts[pivot]):
        i = listed[at]
        first = starts[i]
        between, last = first + elements[i], first + lengths[i]
        place, degree = first, 0
        for k in range(first, between):
            element = lists[k]
            if outside[element] == 0:
                absorbed[element] = True
            if not absorbed[element]:
                lists[place] = element
                place += 1
                degree += outside[element]
        newest = place
        for k in range(between, last):
            other = lists[k]
            if marks[other] != number:
                lists[place] = other
                place += 1
                degree += 1
        # At least one place is free: that of the pivot, or of an element that it was on.
        lists[place] = lists[newest]
        lists[newest] = pivot
        elements[i] = newest + 1 - first
        lengths[i] = place + 1 - first
        _unhang(degrees, heads, after, before, i)
        degrees[i] = min(degree + within, degrees[i] + within, most)
        least = min(least, degrees[i])
        _hang(degrees, heads, after, before, i)
    graph.state[1] = least


@kernel
def _find_parents(start, stop, graph, order, places, listed, parents):
    for number in range(start, stop):
        pivot = order[number]
        parent = len(order)
        for k in range(graph.begins[pivot], graph.begins[pivot] + graph.counts[pivot]):
            parent = min(parent, places[listed[k]])
        parents[number] = parent if parent < len(order) else -1


@kernel
def _walk_tree(parents, post):
    # Children come before their parents, and subtrees stay together.
    count = len(parents)
    child, sibling = np.full(count, -1, np.int32), np.full(count, -1, np.int32)
    for i in range(count - 1, -1, -1):
        if parents[i] >= 0:
            sibling[i] = child[parents[i]]
            child[parents[i]] = i
    done = 0
    for root in range(count):
        if parents[root] >= 0:
            continue
        i = root
        while True:
            while child[i] >= 0:
                i = child[i]
            post[done] = i
            done += 1
            if i == root:
                break
            parent = parents[i]
            child[parent] = sibling[i]  # which is next, or none: then the parent
            i = parent
