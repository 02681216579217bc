# SPDX-License-Identifier: GPL-3.0-or-later
"""Build the documentation: the site in ``site/`` and the extension's manual in ``manual/``.

Both are made from ``docs/`` by mkdocs, where any broken link stops the build. The manual is read as
files: it has no search, which browsers allow on web sites only, and nothing that only serves it.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
SITE = ROOT / "site"
MANUAL = ROOT / "manual"

_ONLY_ON_THE_WEB = ("404.html", "sitemap.xml*", "assets/**/*.map", "assets/javascripts/lunr")


def build(target: Path, search: bool) -> None:
    """Build all pages into a folder, and stop if a link is broken."""
    command = [sys.executable, "-m", "mkdocs", "build", "--strict"]  # --quiet would hide warnings
    command += ["--config-file", str(ROOT / "mkdocs.yml"), "--site-dir", str(target)]
    environment = {**os.environ, "SHOCK_FILTER_SEARCH": str(search).lower()}
    # The theme's makers announce their other software in each build.
    environment["NO_MKDOCS_2_WARNING"] = "true"
    code = subprocess.run(command, cwd=ROOT, env=environment).returncode
    if code:
        raise SystemExit(
            f"The documentation was not built: exit status {code} of `{' '.join(command)}`. Its"
            " output above says why; `python3 -m nox -s docs` installs mkdocs."
        )


def build_manual(target: Path = MANUAL) -> None:
    """Build the manual that travels with the extension."""
    build(target, search=False)
    for pattern in _ONLY_ON_THE_WEB:
        for path in target.glob(pattern):
            shutil.rmtree(path) if path.is_dir() else path.unlink()


def main() -> None:
    """Build both, or what the command line asks for."""
    parser = argparse.ArgumentParser(description="Build the documentation.")
    parser.add_argument("--manual", action="store_true", help="only the extension's manual")
    if not parser.parse_args().manual:
        build(SITE, search=True)
        print(f"Site: {SITE / 'index.html'}")
    build_manual()
    print(f"Manual: {MANUAL / 'index.html'}")


if __name__ == "__main__":
    main()
