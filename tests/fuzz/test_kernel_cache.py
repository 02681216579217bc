# SPDX-License-Identifier: GPL-3.0-or-later
"""Damaged files of compiled code: never loaded."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from numba import float64
from shock_filter.core.base import vectors
from strategies import examples

TYPES = (float64[:, ::1], float64[:, ::1])


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    """A kernel's cache, and the one file in it."""
    folder = tmp_path_factory.mktemp("kernels")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("numba.config.CACHE_DIR", str(folder))
        kernel = vectors.kernel(vectors.dot.py_func)
        kernel.compile(TYPES)
    (path,) = folder.rglob("*.nbc")
    return kernel, path, path.read_bytes()


@given(data=st.data())
@examples(60)
def test_damaged_code_is_not_loaded(kept, data):
    kernel, path, whole = kept
    damaged = bytearray(whole)
    for _ in range(data.draw(st.integers(1, 4))):
        start = data.draw(st.integers(0, len(whole)))
        stop = start + data.draw(st.integers(0, 40))
        damaged[start:stop] = data.draw(st.binary(max_size=40))
    path.write_bytes(damaged)
    found = kernel._cache.load_overload(TYPES, kernel.targetctx)
    assert (found is not None) == (damaged == whole)
