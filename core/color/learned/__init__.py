# SPDX-License-Identifier: GPL-3.0-or-later
"""Learned sharpening of images: networks mix smoothings, unsharp masks and a flow for each pixel.

`images` sharpens pixels by settings, `recipe` runs two stages. `first` and `second` compute the
differences that each stage mixes and the features of its network, `surroundings` computes features
at larger scales, and `planes` and `rows` hold what all of them share. `enlarged_images` is for
images that are enlarged, by the networks of `enlarging`.

May use `core.mixture`, `core.grid`, and what `core.color` knows of images.
"""
