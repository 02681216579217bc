# SPDX-License-Identifier: GPL-3.0-or-later
"""Random values for all settings: accepted within their ranges, refused with a sentence beyond."""

import math

import numpy as np
import pytest
from checks import assert_sentence
from hypothesis import given
from hypothesis import strategies as st
from shock_filter import core
from shock_filter.core.settings import describe
from strategies import examples

CLASSES = [getattr(core, name) for name in core.__all__ if name.endswith("Settings")]
CLASSES.remove(core.InvalidSettings)

ANYTHING = st.one_of(
    st.floats(),
    st.integers(),
    st.integers(0, 20),
    st.booleans(),
    st.text(max_size=9),
    st.none(),
    st.floats().map(np.float64),
    st.floats(width=32).map(np.float32),
    st.integers(0, 200).map(np.uint8),
    st.sampled_from([10**400, -(10**400), 1j, b"7", [1.0], np.ones(1), np.ones((2, 2)), {}]),
)


def as_float(value):
    try:
        return float(value)
    except OverflowError:
        return math.inf


@pytest.mark.parametrize("cls", CLASSES)
def test_any_value_is_kept_or_refused(cls):
    @examples(60)
    @given(st.data())
    def check(data):
        fields = describe(cls)
        name = data.draw(st.sampled_from(list(fields)))
        kind, _, about = fields[name]
        words = st.sampled_from(list(about.choices) or ["coupled"])
        value = data.draw(st.one_of(ANYTHING, words))
        try:
            kept = getattr(cls(**{name: value}), name)
        except core.InvalidSettings as error:
            assert_sentence(error)
            assert name in str(error)
            return
        assert type(kept) is kind
        if kind is str:
            assert kept in about.choices
        else:
            assert not math.isnan(kept)
            assert about.minimum <= kept <= about.maximum
            assert kept == as_float(value)

    check()
