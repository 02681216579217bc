# SPDX-License-Identifier: GPL-3.0-or-later
"""Digests of the training scripts, stored in shipped networks to tell if they are up to date."""

from __future__ import annotations

import ast
from collections.abc import Iterable
from pathlib import Path

from shock_filter.core.mixture.network import digest


def meaning_of(scripts: Iterable[Path]) -> str:
    """Return a hash of scripts, of 16 hexadecimal digits; comments and docstrings do not count."""
    return digest(*(_meaning(path) for path in sorted(scripts)))


def _meaning(path: Path) -> str:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if isinstance(body, list):
            node.body = [part for part in body if not _is_text(part)]
    return path.name + ast.dump(tree)


def _is_text(part: ast.stmt) -> bool:
    return isinstance(part, ast.Expr) and isinstance(part.value, ast.Constant)
