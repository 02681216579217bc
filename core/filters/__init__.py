# SPDX-License-Identifier: GPL-3.0-or-later
"""The filters, one module each; the table of them is core/registry.py."""
