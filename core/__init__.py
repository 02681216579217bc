# SPDX-License-Identifier: GPL-3.0-or-later
"""Shock filters on meshes and images: arrays in, arrays out.

The public names come from the table in :mod:`.registry`. They are loaded when first used, so that
importing this package (Blender does when the extension is enabled) needs neither numba nor scipy.
Editors and type checkers read them in ``__init__.pyi``, which ``tools/write_stub.py`` writes.

References
----------
Docstrings cite these papers by letter, section and equation.

.. [A] F. Prada, M. Kazhdan: Unconditionally Stable Shock Filters for Image and Geometry Processing.
   Computer Graphics Forum 34(5), 2015.
.. [B] F. Prada, M. Kazhdan, M. Chuang, H. Hoppe: Gradient-Domain Processing within a Texture Atlas.
   ACM Transactions on Graphics 37(4), 2018, doi:10.1145/3197517.3201317.
.. [C] A. Spira, R. Kimmel, N. Sochen: A Short-Time Beltrami Kernel for Smoothing Images and
   Manifolds. IEEE Transactions on Image Processing 16(6), 2007.
.. [D] B. Jobard, G. Erlebacher, M. Y. Hussaini: Lagrangian-Eulerian Advection for Unsteady Flow
   Visualization. IEEE Visualization 2001.
"""

from importlib import import_module as _import_module
from typing import Any as _Any

from . import registry as _registry

__all__ = sorted(_registry.public_names())


def __getattr__(name: str) -> _Any:
    module = _registry.public_names().get(name)
    if module is None:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(_import_module(f".{module}", __name__), name)


def __dir__() -> list[str]:
    return __all__
