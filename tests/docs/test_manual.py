# SPDX-License-Identifier: GPL-3.0-or-later
"""The built manual: complete, without other hosts, and where Blender's right click leads."""

import html.parser
import json
import re
import shutil
import subprocess
import sys
from pathlib import Path
from urllib.parse import unquote, urldefrag, urlparse

import pytest
from shock_filter import core
from shock_filter.core import cli

ROOT = Path(__file__).resolve().parents[2]

# Asks as Blender's user interface does, for each button and each setting.
LOOKUP = """
import json, pathlib, sys
import bpy
import shock_filter
bpy.ops.wm.read_homefile(use_empty=True)
shock_filter.register()
from bl_operators import wm
from shock_filter.shock_addon.ui import manual
manual.FOLDER = pathlib.Path(sys.argv[1])
names = [f"shock_filter.{name}" for name in dir(bpy.ops.shock_filter)]
groups = bpy.types.PropertyGroup.__subclasses__()
for group in [each for each in groups if each.__name__.startswith("SHOCK_FILTER_")]:
    names += [f"{group.__name__}.{value.identifier}" for value in group.bl_rna.properties
              if value.identifier not in {"rna_type", "name"} and value.type != "POINTER"]
found = {}
for name in names:
    rna_id = wm._wm_doc_get_id(name, do_url=False)
    found[name] = wm.WM_OT_doc_view_manual._lookup_rna_url(rna_id, verbose=False)
found["home"] = manual.address()
shock_filter.unregister()
print(json.dumps(found))
"""


class Page(html.parser.HTMLParser):
    """The ids of a page, and what it loads."""

    def __init__(self, path):
        super().__init__()
        self.ids, self.loads, self.leads_to = set(), [], None
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag, attributes):
        values = dict(attributes)
        self.ids.add(values.get("id"))
        if tag in {"script", "img", "iframe", "source"} and values.get("src"):
            self.loads.append(values["src"])
        if tag == "link" and values.get("href"):
            self.loads.append(values["href"])
        if values.get("http-equiv") == "refresh":
            self.leads_to = values["content"].partition("url=")[2]


def looked_up(folder):
    process = subprocess.run(
        [sys.executable, "-c", LOOKUP, str(folder)], capture_output=True, text=True, timeout=120
    )
    assert process.returncode == 0, process.stderr
    return json.loads(process.stdout.splitlines()[-1])


@pytest.fixture(scope="module")
def manual(build_docs, tmp_path_factory):
    folder = tmp_path_factory.mktemp("docs") / "Grüße vom Handbuch"
    build_docs.build_manual(folder)
    return folder


@pytest.fixture(scope="module")
def links(manual):
    return looked_up(manual)


def test_every_button_and_setting_leads_to_its_place(manual, links):
    assert len(links) > 100
    for name, url in links.items():
        assert url is not None, f"{name} leads nowhere; add it to shock_addon/ui/manual.py"
        assert url.isascii() and " " not in url
        path = Path(unquote(urlparse(url).path))
        assert path.is_file(), f"{name} leads to {path.name}, which is missing; add the heading"
        if name == "home":
            continue
        assert path.name != "index.html", f"{name} has no page; see shock_addon/ui/manual.py"
        page = Page(path)
        if page.leads_to is not None:
            place, anchor = urldefrag(page.leads_to)
            assert anchor in Page(path.parent / place).ids, f"{name} leads to no heading"


def test_settings_lead_to_headings_of_their_own_mode(links):
    assert links["SHOCK_FILTER_PG_geometry.time"].endswith("/go/geometry.time.html")
    assert links["SHOCK_FILTER_PG_denoise.color_time"].endswith("/go/denoising.time.html")
    assert links["SHOCK_FILTER_PG_texture.vertex_group"].endswith("/go/masks.vertex-group.html")
    assert links["shock_filter.sharpen_colors"].endswith("/colors.html")


def test_the_reference_is_made_from_docstrings(manual):
    page = manual / "api.html"
    assert {"core.sharpen_geometry", "core.TriangleMesh", "core.InvalidSettings"} <= Page(page).ids
    text = re.sub(r"<[^>]+>", "", page.read_text(encoding="utf-8"))
    sentence = core.sharpen_geometry.__doc__.splitlines()[0]
    assert sentence in text


def test_without_a_manual_nothing_is_promised(tmp_path):
    links = looked_up(tmp_path / "nothing")
    assert set(links.values()) == {None}


def test_nothing_comes_from_other_hosts(manual):
    pages = [path for path in manual.rglob("*.html") if path.parent.name != "go"]
    assert len(pages) > 20
    for path in pages:
        for address in Page(path).loads:
            assert not urlparse(address).netloc, f"{path.name} loads {address}"
            assert (path.parent / urldefrag(address).url).is_file(), f"{path.name}: {address}"
    for path in manual.rglob("*.css"):
        assert not re.search(r"(url\(|@import)\s*['\"]?(https?:)?//", path.read_text("utf-8"))


def test_manual_is_small(manual):
    assert sum(path.stat().st_size for path in manual.rglob("*") if path.is_file()) < 12e6


@pytest.mark.slow
def test_a_broken_link_stops_the_build(build_docs, tmp_path, monkeypatch, capfd):
    for name in ("docs", "tools"):
        shutil.copytree(ROOT / name, tmp_path / name)
    for name in ("mkdocs.yml", "CHANGELOG.md"):
        shutil.copy(ROOT / name, tmp_path)
    (tmp_path / "core").symlink_to(ROOT / "core", target_is_directory=True)
    page = tmp_path / "docs" / "panel.md"
    page.write_text(page.read_text("utf-8") + "\n[lost](geometry.md#nowhere)\n", "utf-8")
    monkeypatch.setattr(build_docs, "ROOT", tmp_path)
    with pytest.raises(SystemExit, match="was not built"):
        build_docs.build(tmp_path / "site", search=False)
    assert "nowhere" in capfd.readouterr().err


def test_tables_say_what_the_code_says():
    process = subprocess.run(
        [sys.executable, str(ROOT / "tools" / "write_tables.py"), "--check"],
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert process.returncode == 0, process.stdout + process.stderr


@pytest.mark.parametrize(
    ("page", "folder"),
    [("README.md", "."), ("docs/developing.md", "."), ("docs/method.md", "core")],
)
def test_files_that_pages_name_are_there(page, folder):
    text = (ROOT / page).read_text(encoding="utf-8")
    named = set(re.findall(r"[`(= ]((?:\w+/)+\w+\.(?:py|svg))\b", text))
    assert len(named) > 5
    bases = [ROOT / folder, ROOT / "shock_addon", ROOT / "core", ROOT / "docs"]
    lost = [name for name in named if not any((base / name).is_file() for base in bases)]
    assert lost == []


def test_every_public_name_and_every_command_is_explained():
    reference = (ROOT / "docs" / "api.md").read_text(encoding="utf-8")
    for name in core.__all__:
        entries = f"::: core.{name}\n", f"`{name}`"  # settings have tables on other pages
        assert any(entry in reference for entry in entries), f"core.{name} is not in docs/api.md"
    batch = (ROOT / "docs" / "batch.md").read_text(encoding="utf-8")
    for command in cli.COMMANDS:
        assert f"`{command.command}`" in batch
