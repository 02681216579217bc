# SPDX-License-Identifier: GPL-3.0-or-later
"""What holds for every filter: progress rises, cancelling works, the input stays, no NaN."""

import time

import numpy as np
import pytest
from shock_filter import core

LONGEST = 300.0
"""Seconds that no example comes near, even if it compiles, except where something hangs."""


class Watch:
    """A progress callback that looks at what it gets; with `stop`, cancels at that call.

    Runs on several threads differ in their calls: so it cancels at the latest beyond `fraction`,
    what the call number `stop` got in another run, or at `end`, what the last call got there.
    """

    def __init__(self, stop=None, fraction=1.0, end=1.0):
        self.stop = stop
        self.fraction = fraction
        self.end = end
        self.seen = []

    def __call__(self, fraction, message):
        assert 0.0 <= fraction <= 1.0 + 1e-9
        assert not self.seen or fraction >= self.seen[-1]
        assert isinstance(message, str)
        self.seen.append(fraction)
        if self.stop is None:
            return True
        return len(self.seen) < self.stop and fraction <= self.fraction and fraction < self.end


def call(function, *arrays, stop_at=0.5):
    """Call ``function(progress)`` and cancel it on a second run; return the result.

    The named errors are passed on. `arrays` are what must not change; `stop_at` is where the
    second run is cancelled, as a part of all calls of the callback.
    """
    before = [array.copy() for array in arrays]

    def unchanged():
        return all(now.tobytes() == old.tobytes() for now, old in zip(arrays, before, strict=True))

    start = time.perf_counter()
    watch = Watch()
    try:
        result = function(watch)
    except core.ShockError as error:
        assert_sentence(error)
        raise
    finally:
        assert unchanged()
    for array in result if isinstance(result, tuple) else (result,):
        assert np.isfinite(array).all()
        assert not any(np.may_share_memory(array, given) for given in arrays)
    if watch.seen:
        number = int(stop_at * (len(watch.seen) - 1))
        with pytest.raises(core.Cancelled):
            function(Watch(number + 1, watch.seen[number], watch.seen[-1]))
        assert unchanged()
    assert time.perf_counter() - start < LONGEST
    return result


def assert_sentence(error):
    """The error is one of those that have names, and says something."""
    assert type(error) is not core.ShockError
    text = str(error)
    assert text[0].isupper() or text.split()[0].isidentifier()
    assert text.endswith(".")


def assert_alike(result, given):
    """The result has the type and the shape of the input."""
    assert result.dtype == given.dtype
    assert result.shape == given.shape


def assert_same_bits(result, given):
    """The result is the input, bit for bit."""
    assert result.tobytes() == np.ascontiguousarray(given).tobytes()


def assert_within(result, given, slack=0.0):
    """No value of a channel leaves the input's range."""
    channels = given.shape[-1] if given.ndim > 1 else 1
    rows, old = result.reshape(-1, channels), given.reshape(-1, channels)
    low, high = old.min(axis=0).astype(np.float64), old.max(axis=0).astype(np.float64)
    room = slack * np.maximum(abs(low), abs(high)) + np.finfo(np.float32).tiny
    assert (rows >= low - room).all()
    assert (rows <= high + room).all()
