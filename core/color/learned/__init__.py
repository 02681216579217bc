# SPDX-License-Identifier: GPL-3.0-or-later
"""Sharpening of images: smoothings, unsharp masks and a flow, mixed pixel by pixel as learned.

`images` is for pixels with settings, `recipe` runs two stages. `first` and `second` make what each
stage mixes and what its network is told, `surroundings` looks farther around, and `planes` and
`rows` hold what all of them use. `enlarged_images` is for pixels that are enlarged, and asks
`enlarging` for the networks' answers.

May use `core.mixture`, `core.grid`, and what `core.color` knows of images.
"""
