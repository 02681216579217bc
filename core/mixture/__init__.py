# SPDX-License-Identifier: GPL-3.0-or-later
"""Learned mixtures: small networks that weigh the results of several filters, place by place.

A network never invents a value: from the distances between the candidates, and from features of the
surroundings, it computes the weight of each candidate. `network` runs it, `choice` computes the
distances and mixes the candidates, `cells` averages features over wider surroundings.

May use only `core.base`.
"""
