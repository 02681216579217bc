# SPDX-License-Identifier: GPL-3.0-or-later
"""Compile the IR of harvest.py for a platform, with the passes that numba runs.

Each kernel gets a function ``int sf_DIGEST(void *slots, void *result, void *error)``, which loads
the arguments from slots of 8 bytes; see `core.base.compiled`.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import re
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

import llvmlite.binding as llvm
from numba.core import config
from numba.core.codegen import _parse_refprune_flags
from numba.core.llvm_bindings import create_pass_builder
from records import Entry, Harvest, read


class Target(NamedTuple):
    """What LLVM knows a platform by: the oldest system and processor that are supported.

    `newer` is a processor for which all kernels are compiled once more: networks over many values
    are a third faster there, flows a fifth. No kernel reorders sums or contracts products, so that
    bits are the same.
    """

    triple: str
    processor: str
    newer: str | None = None


TARGETS = {
    "linux-x64": Target("x86_64-unknown-linux-gnu", "x86-64-v2", "x86-64-v3"),
    "windows-x64": Target("x86_64-pc-windows-gnu", "x86-64-v2", "x86-64-v3"),
    "macos-arm64": Target("arm64-apple-macosx12.0.0", "apple-m1"),
    "macos-x64": Target("x86_64-apple-macosx10.15.0", "x86-64-v2", "x86-64-v3"),
    "linux-arm64": Target("aarch64-unknown-linux-gnu", "neoverse-n1"),
}

NOT_OF_HOSTS = (
    "advection.convolution:",
    "advection.dye:",
    "advection.opacity:",
    "advection.sharpening:",
    "beltrami.grid_smoothing:_measure_areas",  # of positions beside colors
    "color.pde:",
    "elements.multigrid:_transpose_back",  # a product, for tests
)
"""Kernels that only `core` and the command line have."""

_WRAPPER = re.compile(r'^define [^@]*@"?(_ZN7cpython|cfunc)', re.MULTILINE)
"""Functions for calls from Python."""

_ADDRESS = re.compile(r"(@\"?numba\.dynamic\.globals[^=]*= .*? )inttoptr \(i64 \d+ to [^)]*\)")
"""Addresses in the process that made the IR; only wrappers and unused code need them."""

_OF_A_PROCESS = re.compile(
    r"(\.const\.pickle(?:buf|data)\.|numba\.dynamic\.globals\.|object at 0x)([0-9a-f]+)"
)
"""Names that numba makes of addresses."""

_LOADED = {"i64", "i32", "i16", "i8", "double", "float", "ptr"}
"""Types of arguments that are loaded from a slot as they are."""


def symbol(entry: Entry, wide: bool = False) -> str:
    """Return the name of a kernel's function in the library."""
    text = f"{entry.name} {entry.types}{' wide' if wide else ''}"
    return "sf_" + hashlib.blake2b(text.encode(), digest_size=8).hexdigest()


def without_addresses(text: str) -> str:
    """Count through the names in an IR that differ from process to process, at the same length."""
    numbers: dict[str, str] = {}

    def counted(name: re.Match[str]) -> str:
        address = name[2]
        return name[1] + numbers.setdefault(address, str(len(numbers)).zfill(len(address)))

    return _OF_A_PROCESS.sub(counted, _ADDRESS.sub(r"\1null", text))


def table_of(entries: Iterable[Entry], platform: str) -> dict[str, dict[str, list[Any]]]:
    """Return the functions and results of kernels by their names and types.

    A third item is the function for newer processors.
    """
    table: dict[str, dict[str, list[Any]]] = {}
    has_newer = TARGETS[platform].newer is not None
    for each in entries:
        wide = [symbol(each, wide=True)] if has_newer else []
        table.setdefault(each.name, {})[each.types] = [symbol(each), each.result, *wide]
    return table


def compile_entries(entries: Iterable[Entry], platform: str, wide: bool = False) -> bytes:
    """Compile kernels to an object file, for the platform's oldest processor or the newer one.

    Raises
    ------
    SystemExit
        If a kernel needs an address of the process that made its IR.
    """
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    compiler = _Compiler(TARGETS[platform], wide)
    whole = llvm.parse_assembly(compiler.head())
    for entry in entries:
        whole.link_in(compiler.kernel(entry))
    return compiler.machine.emit_object(whole)


class _Compiler:
    """The passes for one target."""

    def __init__(self, target: Target, wide: bool) -> None:
        self._target, self._wide = target, wide
        processor = target.newer if wide and target.newer else target.processor
        self.machine = llvm.Target.from_triple(target.triple).create_target_machine(
            cpu=processor, features="", opt=3, reloc="pic", codemodel="default"
        )
        self._done: dict[str, bytes] = {}

    def head(self) -> str:
        """Return the first lines of a module."""
        layout = self.machine.target_data
        return f'target triple = "{self._target.triple}"\ntarget datalayout = "{layout}"\n'

    def kernel(self, entry: Entry) -> llvm.ModuleRef:
        """Return a module whose only function that others see is the kernel's entry."""
        name = symbol(entry, self._wide)
        wanted = {without_addresses(text) for text in entry.modules if not _WRAPPER.search(text)}
        modules = [self._parsed(text) for text in sorted(wanted)]
        for module in modules:
            for function in _defined(module):  # those that nobody needs so far must stay
                function.linkage = "weak_odr"
        whole = modules[0]
        for module in modules[1:]:
            whole.link_in(module)
        kinds = [str(each.type) for each in whole.get_function(entry.symbol).arguments][2:]
        whole.link_in(llvm.parse_assembly(self._entry(entry.symbol, kinds, name)))
        for function in _defined(whole):
            if function.name != name:
                function.linkage = "linkonce_odr"
        whole.get_function(entry.symbol).linkage = "internal"
        for variable in whole.global_variables:
            if not variable.is_declaration:
                variable.linkage = "internal"
        self._optimise(whole)
        for function in _defined(whole):
            if function.name != name:
                function.linkage = "internal"
        whole.verify()
        if any("dynamic.globals" in each.name for each in whole.global_variables):
            raise SystemExit(f"{entry.name} for {entry.types} needs an address of numba's process.")
        return whole

    def _parsed(self, text: str) -> llvm.ModuleRef:
        # Each function is optimised by itself, once.
        if text not in self._done:
            given = re.sub(r"^target (triple|datalayout) = .*\n", "", text, flags=re.MULTILINE)
            module = llvm.parse_assembly(self.head() + given)
            for function in module.functions:
                builder = self._builder()
                passes = builder.getFunctionPassManager()
                passes.add_refprune_pass(_parse_refprune_flags())
                passes.run(function, builder)
            self._done[text] = module.as_bitcode()
        return llvm.parse_bitcode(self._done[text])

    def _optimise(self, module: llvm.ModuleRef) -> None:
        builder = self._builder(opt=0, loop_vectorize=False, slp_vectorize=False)
        passes = builder.getModulePassManager()
        passes.add_loop_rotate_pass()
        passes.add_instruction_combine_pass()
        passes.add_jump_threading_pass()
        passes.add_refprune_pass(_parse_refprune_flags())
        passes.run(module, builder)
        builder = self._builder()
        passes = builder.getModulePassManager()
        passes.add_refprune_pass(_parse_refprune_flags())
        passes.run(module, builder)

    def _builder(self, **changes: Any) -> Any:
        usual = {
            "opt": 3, "loop_vectorize": True, "slp_vectorize": bool(config.SLP_VECTORIZE),
        }  # fmt: skip
        return create_pass_builder(self.machine, **{**usual, **changes})

    def _entry(self, kernel: str, kinds: list[str], name: str) -> str:
        kinds = ["ptr" if kind.endswith("*") else kind for kind in kinds]
        declared = ", ".join(["ptr", "ptr", *kinds])
        export = "dllexport " if "windows" in self._target.triple else ""
        lines = [
            f'declare i32 @"{kernel}"({declared})',
            f"define {export}i32 @{name}(ptr %slots, ptr %result, ptr %error) {{",
        ]
        for number, kind in enumerate(kinds):
            lines.append(f"  %p{number} = getelementptr i8, ptr %slots, i64 {8 * number}")
            if kind == "i1":
                lines.append(f"  %b{number} = load i8, ptr %p{number}")
                lines.append(f"  %a{number} = trunc i8 %b{number} to i1")
            elif kind in _LOADED:
                lines.append(f"  %a{number} = load {kind}, ptr %p{number}")
            else:
                raise SystemExit(f"{kernel} takes {kind}, for which there is no slot.")
        values = [f"{kind} %a{number}" for number, kind in enumerate(kinds)]
        given = ", ".join(["ptr %result", "ptr %error", *values])
        lines += [f'  %r = call i32 @"{kernel}"({given})', "  ret i32 %r", "}"]
        return self.head() + "\n".join(lines)


def _defined(module: llvm.ModuleRef) -> list[llvm.ValueRef]:
    return [each for each in module.functions if not each.is_declaration]


def check_complete(harvests: Iterable[Harvest]) -> None:
    """Refuse harvests that lack kernels, as hosts might call these."""
    harvests = list(harvests)
    imported = set().union(*(each.imported for each in harvests))
    lost = imported - set().union(*(each.compiled for each in harvests))
    lost = {name for name in lost if not name.startswith(NOT_OF_HOSTS)}
    if lost:
        raise SystemExit(
            f"The rehearsal calls none of these kernels: {', '.join(sorted(lost))}. Add an example"
            " to core/rehearsal, or name them in NOT_OF_HOSTS if Blender never runs them."
        )


def main() -> None:
    """Compile what harvests hold: writes kernels.o, wide.o (or an empty one), and the table."""
    parser = argparse.ArgumentParser(description="Compile the kernels of harvests.")
    parser.add_argument("platform", choices=TARGETS)
    parser.add_argument("folder", type=Path)
    parser.add_argument("harvests", type=Path, nargs="+")
    given = parser.parse_args()
    harvests = [read(path) for path in given.harvests]
    check_complete(harvests)
    entries = {symbol(each): each for harvest in harvests for each in harvest.entries}
    ordered = sorted(entries.values(), key=lambda each: (each.name, each.types))
    with ProcessPoolExecutor(1) as pool:
        wide = None
        if TARGETS[given.platform].newer is not None:
            wide = pool.submit(compile_entries, ordered, given.platform, wide=True)
        (given.folder / "kernels.o").write_bytes(compile_entries(ordered, given.platform))
        (given.folder / "wide.o").write_bytes(wide.result() if wide else b"")
    table = table_of(ordered, given.platform)
    (given.folder / "kernels.json").write_text(json.dumps(table), encoding="utf-8")


if __name__ == "__main__":
    main()
