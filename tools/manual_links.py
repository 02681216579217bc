# SPDX-License-Identifier: GPL-3.0-or-later
"""A hook of mkdocs: small pages that lead to the headings of others.

Blender opens the manual as files, and the programs that hand a file's address to the browser
(xdg-open, and their likes on Windows and macOS) drop what stands after ``#``. So each heading gets
a file of its own, ``go/PAGE.HEADING.html``, which leads there.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

FOLDER = "go"
_PAGE = """\
<!doctype html>
<meta charset="utf-8">
<title>{title}</title>
<meta http-equiv="refresh" content="0; url=../{page}.html#{anchor}">
<a href="../{page}.html#{anchor}">{title}</a>
"""

_links: dict[str, str] = {}


def on_pre_build(**_: Any) -> None:
    """Forget the links of an earlier build."""
    _links.clear()


def on_page_content(html: str, page: Any, **_: Any) -> None:
    """Note the headings of a page."""
    stem = page.file.url.removesuffix(".html")
    for heading in _headings(page.toc):
        _links[f"{stem}.{heading.id}.html"] = _PAGE.format(
            title=heading.title, page=stem, anchor=heading.id
        )


def on_post_build(config: Any, **_: Any) -> None:
    """Write the files."""
    folder = Path(config["site_dir"], FOLDER)
    folder.mkdir(exist_ok=True)
    for name, text in _links.items():
        (folder / name).write_text(text, encoding="utf-8")


def _headings(items: Any) -> Iterator[Any]:
    for item in items:
        yield item
        yield from _headings(item.children)
