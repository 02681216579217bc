# SPDX-License-Identifier: GPL-3.0-or-later
"""Run the rehearsal with numba, and keep each kernel that Python calls: its IR and its types.

The IR is that of before any optimisation, as optimised IR names instructions of this processor.

usage: harvest.py OUT [KIND ...]      OUT is read by build_kernels.py
"""

from __future__ import annotations

import argparse
import copy
from pathlib import Path
from typing import Any

import numpy as np
from numba.core import config, types
from numba.core.callconv import CPUCallConv
from numba.core.codegen import CPUCodeLibrary
from numba.core.registry import CPUDispatcher
from numba.np.numpy_support import as_dtype
from records import Call, Entry, Harvest, write
from shock_filter.core.base import compiled

compiled.library.cache_clear()
compiled.library = lambda: None  # type: ignore[assignment]  # a library that is there has no IR

from shock_filter.core.base import kernel_cache, parallel  # noqa: E402

_written: dict[int, list[str]] = {}
"""IR of each library, as numba's lowering wrote it."""

_libraries: list[CPUCodeLibrary] = []
"""All of them, so that no id is used twice."""

_asked: dict[tuple[Any, Any], None] = {}
"""Kernels and types that Python called, in this order."""

_seen: set[Any] = set()
"""Kernels and forms of arguments that Python called."""

_calls: list[Call] = []

_add_ir_module = CPUCodeLibrary.add_ir_module


def _keep_ir(library: CPUCodeLibrary, module: Any) -> None:
    _libraries.append(library)
    _written.setdefault(id(library), []).append(str(module))
    _add_ir_module(library, module)


_build_excinfo_struct = CPUCallConv.build_excinfo_struct


def _build_without_place(conventions, exc, exc_args, _, func_name):
    # An error's file would be a path on this machine; those of array expressions name it in words.
    if exc_args is not None:
        exc_args = tuple(
            each.partition('\nFile "')[0] if isinstance(each, str) else each for each in exc_args
        )
    return _build_excinfo_struct(conventions, exc, exc_args, None, func_name)


def _form(value: Any) -> Any:
    # What determines numba's type of an argument, and takes less time to find.
    if type(value) is np.ndarray:
        return value.dtype, value.ndim, value.flags.num
    return (type(value), *map(_form, value)) if isinstance(value, tuple) else type(value)


class _Recorded(CPUDispatcher):
    """A dispatcher that records the first call for each combination of types."""

    def __call__(self, *arguments: Any) -> Any:
        form = (self, *map(_form, arguments))
        if form in _seen:
            return super().__call__(*arguments)
        _seen.add(form)
        found = tuple(self.typeof_pyval(each) for each in arguments)
        if (self, found) in _asked:
            return super().__call__(*arguments)
        _asked[self, found] = None
        before = copy.deepcopy(arguments)
        result = super().__call__(*arguments)
        name = compiled.name_of(self.py_func)
        _calls.append(Call(name, before, copy.deepcopy(arguments), copy.deepcopy(result)))
        return result


def _without_passes(library: CPUCodeLibrary, module: Any) -> None:
    module.data_layout = library._codegen._data_layout


def _linked(library: CPUCodeLibrary, found: list[CPUCodeLibrary]) -> list[CPUCodeLibrary]:
    # A library and all that it links to, once each.
    if library not in found:
        found.append(library)
        for other in library._linking_libraries:
            _linked(other, found)
    return found


def type_name(kind: types.Type) -> str:
    """Write a type as `compiled.type_name` does for its values."""
    if isinstance(kind, types.Array):
        order = kind.layout if kind.aligned else "unaligned"
        return f"{as_dtype(kind.dtype).str}{kind.ndim}{order}{'' if kind.mutable else 'r'}"
    if isinstance(kind, types.BaseTuple):
        name = kind.instance_class.__name__ if isinstance(kind, types.BaseNamedTuple) else ""
        return f"{name}({','.join(map(type_name, kind))})"
    return {"int64": "i", "float64": "f", "bool": "b", "none": "n"}.get(str(kind), str(kind))


def result_name(kind: types.Type) -> Any:
    """Write what `compiled` needs to read a result."""
    if isinstance(kind, types.NoneType):
        return None
    if isinstance(kind, types.BaseTuple):
        return [result_name(each) for each in kind]
    return type_name(kind) if isinstance(kind, types.Array) else _LETTERS[str(kind)]


_LETTERS = {
    "int64": "q", "uint64": "Q", "float64": "d", "bool": "?", "int32": "i", "float32": "f",
}  # fmt: skip


def _entries() -> list[Entry]:
    found = []
    for kernel, arguments in _asked:
        code = kernel.overloads[arguments]
        found.append(
            Entry(
                compiled.name_of(kernel.py_func),
                ",".join(map(type_name, code.fndesc.argtypes)),
                result_name(code.signature.return_type),
                code.fndesc.llvm_func_name,
                [text for each in _linked(code.library, []) for text in _written[id(each)]],
            )
        )
    return found


def record() -> None:
    """Keep the IR of all kernels that are made from now on, and their first calls."""
    CPUCodeLibrary.add_ir_module = _keep_ir
    # The IR that is kept is that of before any pass. Without all of them runs would take longer.
    CPUCodeLibrary._optimize_functions = _without_passes
    config.OPT = config._OptLevel(1)
    CPUCallConv.build_excinfo_struct = _build_without_place
    compile_kernel = kernel_cache.compile_kernel

    def recorded(*arguments: Any) -> Any:
        kernel = compile_kernel(*arguments, keep=False)  # code on disk has no IR
        kernel.__class__ = _Recorded
        return kernel

    kernel_cache.compile_kernel = recorded
    parallel.most_threads = 1  # else another chunk writes to what is copied


def recorded() -> Harvest:
    """Return what was kept."""
    from shock_filter.core.rehearsal.rehearse import imported_kernels

    kernels = imported_kernels()
    names = {compiled.name_of(each.py_func) for each in kernels}
    used = {compiled.name_of(each.py_func) for each in kernels if each.overloads}
    return Harvest(_entries(), _calls, names, used)


def main() -> None:
    """Rehearse and write."""
    parser = argparse.ArgumentParser(description="Keep the IR of the kernels of a rehearsal.")
    parser.add_argument("out", type=Path)
    parser.add_argument("kinds", nargs="*")
    given = parser.parse_args()

    record()
    from shock_filter.core.rehearsal.rehearse import rehearse

    rehearse(**({"kinds": given.kinds} if given.kinds else {}))
    write(given.out, recorded())


if __name__ == "__main__":
    main()
