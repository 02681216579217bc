# SPDX-License-Identifier: GPL-3.0-or-later
"""What is refused of a zip, and that two of the same files have the same bytes."""

import hashlib
import os
import zipfile

import build_extension
import bundled
import check_zip
import pytest

ELF = b"\x7fELF" + bytes(14) + b"\x3e\0"
MAC_ARM, MAC_X64 = b"\xcf\xfa\xed\xfe\x0c\0\0\x01", b"\xcf\xfa\xed\xfe\x07\0\0\x01"
PE = b"MZ" + bytes(58) + (64).to_bytes(4, "little") + b"PE\0\0\x64\x86"
KERNELS = "shock_filter_kernels_1/__init__.py"
COMPILED = {"linux-x64": ELF, "macos-arm64": MAC_ARM, "macos-x64": MAC_X64, "windows-x64": PE}


def write(path, files):
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return path


def zip_of(folder, files=(), wheel=None, manifest='wheels = ["./wheels/w.whl"]'):
    """Make a zip with one wheel that holds a library, and further files."""
    inner = write(folder / "w.whl", wheel or {KERNELS: "", "more/a.so": ELF})
    content = {"blender_manifest.toml": manifest, "wheels/w.whl": inner.read_bytes()}
    return write(folder / "z.zip", content | dict(files))


def problems(path, platform="linux-x64"):
    return list(check_zip.problems_of(path, platform))


def test_a_sound_zip_has_no_problem(tmp_path):
    text = "import os, bpy, numba\nfrom . import b\nfrom .b import c\nfrom ..core import b"
    files = {"core/a.py": text, "core/b.py": "import trimesh", "core/__init__.py": ""}
    assert problems(zip_of(tmp_path, files)) == []


@pytest.mark.parametrize("built_for", COMPILED)
@pytest.mark.parametrize("platform", COMPILED)
def test_compiled_files_of_other_platforms_are_found(tmp_path, built_for, platform):
    path = zip_of(tmp_path, wheel={KERNELS: "", "more/a.bin": COMPILED[built_for]})
    found = problems(path, platform)
    assert bool(found) == (built_for != platform)
    assert all("more/a.bin is compiled for" in problem for problem in found)


@pytest.mark.parametrize(
    ("place", "text", "lost"),
    [
        ("core/a.py", "import pandas", "pandas"),
        ("shock_addon/a.py", "def f():\n    import trimesh", "trimesh"),
        ("core/a.py", "from .b import c", "core/b"),
        ("core/a.py", "from ..shock_addon import c", "shock_addon"),
    ],
)
def test_imports_that_nothing_satisfies_are_found(tmp_path, place, text, lost):
    (problem,) = problems(zip_of(tmp_path, {place: text}))
    assert f" imports {lost}, which is neither" in problem


@pytest.mark.parametrize(
    ("names", "said"),
    [
        (["a/B.txt", "a/b.txt"], "differs in case only"),
        (["a/con.txt"], "no name of a file on Windows"),
        (["LPT1"], "no name of a file on Windows"),
        (["a/what?"], "no name of a file on Windows"),
        (["a./b"], "no name of a file on Windows"),
        (["a" * 136], "136 characters"),
    ],
)
def test_names_that_other_systems_cannot_hold_are_found(names, said):
    found = list(check_zip.names_that_fail(names))
    assert len(found) == len(names)
    assert all(said in problem for problem in found)


def test_names_that_look_like_these_are_let_through():
    assert list(check_zip.names_that_fail(["a/console.py", "a/com.py", ".b/c.d", "a" * 135])) == []


def test_a_wheel_that_the_manifest_forgets_is_found(tmp_path):
    assert problems(zip_of(tmp_path, manifest="wheels = []")) == [
        "The manifest does not list the wheels that are there."
    ]


def test_all_problems_are_told_at_once(tmp_path):
    path = zip_of(tmp_path, {"core/a.py": "import pandas", "core/b.py": "import torch"})
    with pytest.raises(SystemExit, match=r"(?s)z.zip cannot be released:.*pandas.*torch"):
        check_zip.check(path, "linux-x64")


@pytest.mark.parametrize("name", ["numba", "llvmlite", "scipy"])
def test_what_compiles_at_the_users_is_refused(tmp_path, name):
    path = zip_of(tmp_path, wheel={KERNELS: "", f"{name}/__init__.py": ""})
    assert problems(path) == [f"It carries {name}: leave it out."]


def test_a_zip_without_kernels_is_refused(tmp_path):
    assert problems(zip_of(tmp_path, wheel={"more/a.so": ELF})) == [
        "It lacks the compiled kernels."
    ]


def test_large_zips_are_refused(tmp_path):
    path = tmp_path / "a.zip"
    path.touch()
    os.truncate(path, build_extension.SIZE_LIMIT - 1)
    build_extension.check_size(path)
    os.truncate(path, build_extension.SIZE_LIMIT)
    with pytest.raises(SystemExit, match=r"has 13\.0 MB; the limit is 13 MB"):
        build_extension.check_size(path)


def test_zips_have_the_same_bytes_whoever_packs_them(tmp_path):
    for name, order, date, mode in (("a", "xy", 1990, 0o600), ("b", "yx", 2020, 0o664)):
        with zipfile.ZipFile(tmp_path / name, "w") as archive:
            for entry in order:
                info = zipfile.ZipInfo(entry, (date, 1, 1, 0, 0, 0))
                info.external_attr = mode << 16
                archive.writestr(info, entry * 100)
        build_extension.make_reproducible(tmp_path / name)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()
    with zipfile.ZipFile(tmp_path / "a") as archive:
        assert archive.namelist() == ["x", "y"] and archive.read("y") == b"y" * 100


def wheel(folder, about):
    return write(folder / "w.whl", {"w-1.dist-info/METADATA": f"Name: w\nVersion: 1\n{about}\n"})


def test_wheels_are_listed_with_licence_and_hash(tmp_path):
    path = wheel(tmp_path, "License-Expression: MIT AND (BSD-3-Clause OR Foo)")
    text = bundled.listing([path], manual=False)
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    assert f"| w | 1 | MIT AND (BSD-3-Clause OR Foo) |  | wheels/w.whl | {digest} |" in text


@pytest.mark.parametrize(
    "licence", ["License-Expression: CC-BY-NC-4.0", "License-Expression: MIT AND Foo", ""]
)
def test_wheels_whose_licence_does_not_fit_are_refused(tmp_path, licence):
    with pytest.raises(SystemExit, match=r"w.whl has the licence .* cannot ship: replace it"):
        bundled.listing([wheel(tmp_path, licence)], manual=False)


ROW = '[[pictures]]\nfiles = ["a*.png"]\nscript = "s"\nshows = "t"\nlicence = "{}"\n'


@pytest.mark.parametrize(
    ("pictures", "licence", "said"),
    [
        (["a.png"], "CC-BY-NC-4.0", "docs/images/a.png has the licence 'CC-BY-NC-4.0'"),
        (["a.png"], "CC-BY-SA-3.0", "has the licence"),
        (["a.png"], "", r"has the licence '\(none\)'"),
        (["a.png", "b.png"], "MIT", "docs/images/b.png has 0 rows"),
        ([], "MIT", "which are not there"),
    ],
)
def test_pictures_without_source_or_fitting_licence_are_refused(tmp_path, pictures, licence, said):
    (tmp_path / "sources.toml").write_text(ROW.format(licence))
    for name in pictures:
        (tmp_path / name).touch()
    with pytest.raises(SystemExit, match=said):
        bundled.pictures(tmp_path)


def test_each_picture_of_the_manual_has_a_source():
    rows = bundled.pictures()
    scripts = {row["script"] for row in rows}
    assert all((bundled.ROOT / name).is_file() for name in scripts if name.endswith(".py"))
    assert "docs/images/sources.toml" not in bundled.listing([], manual=True)
    assert "paper/figure7.png" in bundled.listing([], manual=True)
