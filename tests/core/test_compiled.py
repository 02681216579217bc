# SPDX-License-Identifier: GPL-3.0-or-later
"""Kernels of a library: which one serves which arguments, and what is said where none does."""

import sys
from typing import NamedTuple

import numpy as np
import pytest
from shock_filter.core.base import compiled
from shock_filter.core.errors import KernelMissing


class Rows(NamedTuple):
    """A tuple of arrays with a name."""

    start: np.ndarray
    values: np.ndarray


@pytest.mark.parametrize(
    ("value", "name"),
    [
        (np.zeros((2, 3)), "<f82C"),
        (np.zeros((2, 3)).T, "<f82F"),
        (np.zeros((4, 3))[::2], "<f82A"),
        (np.zeros(3, np.float32), "<f41C"),
        (np.zeros(2, bool), "|b11C"),
        (3, "i"),
        (np.int64(3), "i"),
        (3.0, "f"),
        (np.float32(3), "float32"),
        (True, "b"),
        (None, "n"),
        ((1, 2.0), "(i,f)"),
        (Rows(np.zeros(2, np.int32), np.zeros(2)), "Rows(<i41C,<f81C)"),
    ],
)
def test_types_are_named_as_in_the_table(value, name):
    assert compiled.type_name(value) == name


def test_arrays_that_are_read_only_or_unaligned_have_names_of_their_own():
    array = np.zeros(3)
    array.flags.writeable = False
    assert compiled.type_name(array) == "<f81Cr"
    odd = np.zeros(17, np.uint8)[1:].view(np.float64)
    assert compiled.type_name(odd) == "<f81unaligned"


@pytest.mark.parametrize(
    ("given", "taken", "fits"),
    [
        ("<f82C", "<f82C", True),
        ("<f82C", "<f82A", True),
        ("<f82F", "<f82A", True),
        ("<f82A", "<f82C", False),
        ("<f82C", "<f82F", False),
        ("<f82C", "<f82Cr", True),
        ("<f82Cr", "<f82C", False),
        ("<f82Cr", "<f82Ar", True),
        ("<f42C", "<f82C", False),
        ("<f81C", "<f82C", False),
        ("i", "f", False),
        ("Rows(<i41C,<f81C)", "Rows(<i41C,<f81A)", True),
        ("Rows(<i41C,<f81C)", "Other(<i41C,<f81C)", False),
        ("(i,f)", "(i,f),i", False),
    ],
)
def test_a_kernel_takes_what_it_can_read_and_write(given, taken, fits):
    assert compiled._fits([given], taken) == fits


def test_addresses_are_read_past_the_head_of_arrays():
    array = np.arange(12.0).reshape(3, 4)
    for each in (array, array[1:], array[:, 2], array.T):
        assert compiled._address(each) == each.ctypes.data


def test_a_missing_kernel_is_named_with_its_types(monkeypatch):
    class Empty:
        free = None

        def find(self, name, types):
            return None

    monkeypatch.setattr(compiled, "library", Empty)
    monkeypatch.setitem(sys.modules, f"{compiled.__package__}.kernel_cache", None)
    kernel = compiled.Kernel(test_addresses_are_read_past_the_head_of_arrays)
    with pytest.raises(
        KernelMissing, match=r"No kernel .*test_addresses.* types <f81C, i: install"
    ):
        kernel(np.zeros(2), 1)


class OfContiguous:
    """A library with one kernel, which adds a number to contiguous floats."""

    free = None

    def find(self, name, types):
        return (None, None) if types in (["<f82C", "f"], ["i", "i", "<f82C", "f"]) else None


class Adding:
    """Its call, without ctypes."""

    def __init__(self, name, arguments, *rest):
        pass

    def __call__(self, arguments):
        values, number = arguments
        assert values.flags.c_contiguous
        values += number
        return float(values.sum())

    def bind(self, arguments):
        def call(start, stop):
            assert arguments[0].flags.c_contiguous
            arguments[0][start:stop] += arguments[1]

        return call


@pytest.fixture
def adding(monkeypatch):
    monkeypatch.setattr(compiled, "library", OfContiguous)
    monkeypatch.setattr(compiled, "_Call", Adding)
    monkeypatch.setitem(sys.modules, f"{compiled.__package__}.kernel_cache", None)
    return compiled.Kernel(test_addresses_are_read_past_the_head_of_arrays)


def test_without_numba_other_orders_of_arrays_are_copied(adding):
    whole = np.zeros((6, 4))
    assert adding(whole[::2], 1.5) == 18.0
    assert (whole[::2] == 1.5).all() and (whole[1::2] == 0).all()
    fixed = np.zeros((3, 2))
    fixed.flags.writeable = False
    assert adding(fixed, 1.0) == 6.0
    assert not fixed.any()
    with pytest.raises(KernelMissing, match="types <f42C, f"):
        adding(whole.astype(np.float32), 1.5)


def test_bound_kernels_copy_back_after_each_chunk(adding):
    whole = np.zeros((8, 2))
    call = adding.bind(whole[::2], 1.0)
    call(0, 2)
    assert whole[:, 0].tolist() == [1, 0, 1, 0, 0, 0, 0, 0]
    call(2, 4)
    assert whole[:, 0].tolist() == [1, 0, 1, 0, 1, 0, 1, 0]
