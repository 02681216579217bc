# SPDX-License-Identifier: GPL-3.0-or-later
"""Sums, products and logarithms along rows of pixels, in float32."""

from __future__ import annotations

import numpy as np

from ...base.parallel import kernel


@kernel
def half_log(value):
    """Return log(value + 1e-5) / 2 + 2 for a value that is not negative, exact to 1e-4.

    The exponent is read from the bits, and a polynomial of the mantissa adds the rest. This gives
    the same bits on every machine, and compilers vectorize it. Windows without contrast give NaN,
    0/0, whose sign differs between processors. It is taken as negative, as on those that the
    networks were trained on, and gives about -42.
    """
    bits = np.float32(value + np.float32(1e-5)).view(np.int32)
    if (bits & 0x7FFFFFFF) > 0x7F800000:
        bits = np.int32(-0x400000)
    m = np.int32((bits & 0x7FFFFF) | 0x3F800000).view(np.float32) - np.float32(1)
    p = np.float32(-0.2023112) + m * np.float32(0.0483346)
    p = np.float32(1.4420250) + m * (np.float32(-0.7128051) + m * (np.float32(0.4247566) + m * p))
    return (np.float32((bits >> 23) - 127) + m * p) * np.float32(0.34657359) + np.float32(2)


@kernel
def put_logs(inverse, energy, out):
    """Write the `half_log` of energies times `inverse`."""
    for x in range(len(out)):
        out[x] = half_log(energy[x] * inverse[x])


@kernel
def add_square(scale, a, out):
    """Add squares."""
    for x in range(len(out)):
        out[x] += scale * a[x] * a[x]


@kernel
def add_product(a, b, out):
    """Add products."""
    for x in range(len(out)):
        out[x] += a[x] * b[x]


@kernel
def add_squared_difference(scale, a, b, out):
    """Add squared differences."""
    for x in range(len(out)):
        d = a[x] - b[x]
        out[x] += scale * d * d


@kernel
def put_difference(a, b, out):
    """Subtract one row from another."""
    for x in range(len(out)):
        out[x] = a[x] - b[x]


@kernel
def multiply(a, out):
    """Multiply a row in place."""
    for x in range(len(out)):
        out[x] *= a[x]


@kernel
def signed_root(scale, out):
    """Take the square roots of scaled absolute values, in place, and keep the signs."""
    for x in range(len(out)):
        root = np.sqrt(abs(out[x]) * scale[x])
        out[x] = root if out[x] >= 0 else -root


@kernel
def add_slopes(scale, plane, y, out):
    """Add four times the squared gradient of a plane in row y."""
    h, w = plane.shape
    up, here, down = plane[max(y - 1, 0)], plane[y], plane[min(y + 1, h - 1)]
    for x in range(1, w - 1):
        a, b = down[x] - up[x], here[x + 1] - here[x - 1]
        out[x] += scale * (a * a + b * b)
    for x, left, right in ((0, 0, min(1, w - 1)), (w - 1, max(w - 2, 0), w - 1)):
        if x == 0 or w > 1:
            a, b = down[x] - up[x], here[right] - here[left]
            out[x] += scale * (a * a + b * b)


@kernel
def tell_products(scale, d, count, n, told, at):
    """Write the products of all pairs of `count` differences, as signed roots, to features.

    `d` is (k, c, rows, w) and `told` is (f, rows, w), both used in row `n`. The features begin at
    index `at`; returned is the index after them.
    """
    for k in range(count):
        for m in range(k + 1):
            row = told[at, n]
            row[:] = 0
            for i in range(d.shape[1]):
                add_product(d[k, i, n], d[m, i, n], row)
            signed_root(scale, row)
            at += 1
    return at


@kernel
def tell_range(share, inverse, total, value, low, high, other, spare, span, away, cross):
    """Compute features of a window: its range, the position in it, and its product with `other`.

    `value`, `low`, `high` and `other` are rows of all channels; `span`, `away` and `cross` are
    overwritten with the features.
    """
    span[:], away[:], cross[:] = 0, 0, 0
    for i in range(len(value)):
        v, least, most, o = value[i], low[i], high[i], other[i]
        for x in range(len(spare)):
            s, m = most[x] - least[x], 2 * v[x] - most[x] - least[x]
            span[x] += s * s
            away[x] += m * m
            cross[x] += m * o[x]
    for x in range(len(spare)):
        spare[x] = np.float32(1) / (span[x] + np.float32(1e-6) * total[x])
        away[x] *= spare[x]
        span[x] = half_log(share * span[x] * inverse[x])
    signed_root(spare, cross)


@kernel
def scales_of(near, top, y, bands, share, total, inverse, scale):
    """Set the inverse of the total, and the inverse of the near energy, which scales products."""
    scale[:] = 0
    for k in range(bands):
        row = near[k, y - top]
        for x in range(len(scale)):
            scale[x] += row[x]
    for x in range(len(scale)):
        inverse[x] = np.float32(1) / total[x]
        scale[x] = share / (scale[x] + np.float32(1e-4) * total[x])
