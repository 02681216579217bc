# SPDX-License-Identifier: GPL-3.0-or-later
"""Learned mixtures: small networks that weigh several results of filters, place by place.

A network never makes up a value: it sees how far the candidates are from each other and what lies
around, and says how much each of them counts. `network` runs it, `choice` tells the candidates
apart and mixes them, `cells` looks farther around.

May use only `core.base`.
"""
