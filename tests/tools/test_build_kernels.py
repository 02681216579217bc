# SPDX-License-Identifier: GPL-3.0-or-later
"""The wheel of compiled kernels, and what is compiled for platforms that are not at hand."""

import subprocess
import sys

import build_kernels
import pytest
from shock_filter.core.base import compiled

sys.path.insert(0, str(build_kernels.ROOT / "tools" / "kernels"))
import compiler
from records import Entry, Harvest

ABOUT = {"sources": "1", "library": "kernels.so", "kernels": {}}

IR = """define i32 @kernel(ptr %result, ptr %error, i64 %a, double %b, i1 %c) {
  %sum = call double @sin(double %b)
  store double %sum, ptr %result
  ret i32 0
}
declare double @sin(double)
"""

WRAPPER = "define ptr @_ZN7cpython6kernel(ptr %a) {\n  ret ptr %a\n}\n"


def entry(ir=IR):
    return Entry("a:kernel", "i,f,b", "d", "kernel", [ir, WRAPPER])


def test_package_and_digest_are_those_that_the_core_looks_for():
    assert build_kernels.package_name(build_kernels.version()) == compiled.PACKAGE
    assert build_kernels.sources_digest() == compiled.sources_digest()


def test_any_edit_of_the_core_changes_the_digest(tmp_path):
    (tmp_path / "a.py").write_text("1")
    first = build_kernels.sources_digest(tmp_path)
    (tmp_path / "b.txt").write_text("1")
    assert build_kernels.sources_digest(tmp_path) == first
    (tmp_path / "a.py").write_text("2")
    second = build_kernels.sources_digest(tmp_path)
    (tmp_path / "a.py").rename(tmp_path / "b.py")
    assert len({first, second, build_kernels.sources_digest(tmp_path)}) == 3


def test_pip_installs_the_wheel_and_two_have_the_same_bytes(tmp_path):
    name = build_kernels.wheel_name("linux-x64", "1.2.3")
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        build_kernels.write_wheel(tmp_path / folder / name, "1.2.3", ABOUT, b"code")
    assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()
    pip = [sys.executable, "-m", "pip", "install", "--no-index", "--no-deps", "--quiet"]
    subprocess.run([*pip, f"--target={tmp_path / 'to'}", tmp_path / "a" / name], check=True)
    assert (tmp_path / "to" / "shock_filter_kernels_1_2_3" / "kernels.so").read_bytes() == b"code"


def test_a_library_that_lacks_a_function_is_refused(tmp_path):
    path = tmp_path / "kernels.so"
    path.write_bytes(b"..sf_1..")
    build_kernels.check_exports(path, {"a:f": {"i": ["sf_1", None]}})
    with pytest.raises(SystemExit, match="lacks a:f for i"):
        build_kernels.check_exports(path, {"a:f": {"i": ["sf_2", None]}})


@pytest.mark.parametrize(
    ("platform", "start"),
    [
        ("linux-x64", b"\x7fELF"),
        ("linux-arm64", b"\x7fELF"),
        ("windows-x64", b"\x64\x86"),
        ("macos-arm64", b"\xcf\xfa\xed\xfe\x0c"),
        ("macos-x64", b"\xcf\xfa\xed\xfe\x07"),
    ],
)
def test_kernels_are_compiled_for_each_platform(platform, start):
    code = compiler.compile_entries([entry()], platform)
    assert code.startswith(start)
    assert compiler.symbol(entry()).encode() in code
    assert code == compiler.compile_entries([entry()], platform)


def test_addresses_of_the_process_that_made_the_ir_are_refused():
    ir = """@numba.dynamic.globals.1 = internal global ptr inttoptr (i64 4711 to ptr)
define i32 @kernel(ptr %result, ptr %error, i64 %a, double %b, i1 %c) {
  %p = load ptr, ptr @numba.dynamic.globals.1
  store ptr @numba.dynamic.globals.1, ptr %result
  ret i32 0
}
"""
    with pytest.raises(SystemExit, match=r"a:kernel for i,f,b needs an address"):
        compiler.compile_entries([entry(ir)], "linux-x64")


def test_arguments_without_a_slot_are_refused():
    ir = "define i32 @kernel(ptr %result, ptr %error, [2 x i8] %a) {\n  ret i32 0\n}\n"
    with pytest.raises(SystemExit, match="for which there is no slot"):
        compiler.compile_entries([entry(ir)], "linux-x64")


def test_kernels_are_compiled_for_newer_processors_too():
    oldest, _, newer = compiler.table_of([entry()], "linux-x64")["a:kernel"]["i,f,b"]
    assert oldest != newer
    assert newer.encode() in compiler.compile_entries([entry()], "linux-x64", wide=True)
    assert len(compiler.table_of([entry()], "macos-arm64")["a:kernel"]["i,f,b"]) == 2


def test_kernels_that_the_rehearsal_does_not_reach_are_named():
    reached = Harvest([], [], {"a:one", "a:two", "color.pde:rows"}, {"a:one"})
    with pytest.raises(SystemExit, match=r"calls none of these kernels: a:two\. Add"):
        compiler.check_complete([reached])
    compiler.check_complete([reached, Harvest([], [], {"a:two"}, {"a:two"})])
