# SPDX-License-Identifier: GPL-3.0-or-later
"""From nothing to a used, updated, downgraded and removed extension, by a repository of files."""

import json
from pathlib import Path

import build_extension
import pytest
from publishing import NEWER, publish, publish_newer

SCRIPT = Path(__file__).with_name("update_process.py")


@pytest.fixture(scope="module")
def reports(extension_zip, run, tmp_path_factory) -> dict[str, dict]:
    """Return what each step saw."""
    folder = tmp_path_factory.mktemp("Blender für 三角形 & co")
    resources, releases = folder / "resources", folder / "releases"
    resources.mkdir()
    releases.mkdir()
    zips = list(extension_zip.parent.glob(f"shock_filter-{build_extension.version()}-*.zip"))
    publish(zips, releases)  # for other systems and series, too, if they are there
    url = (releases / "index.json").as_uri()
    found = {}
    for what in ("install", "update", "downgrade"):
        if what == "update":
            publish_newer(extension_zip, releases)
        if what == "downgrade":
            publish(zips, releases)
        run(SCRIPT, resources, folder / "report.json", what, url)
        found[what] = json.loads((folder / "report.json").read_text(encoding="utf-8"))
    return found


def test_each_step_brings_its_version(reports):
    old = build_extension.version()
    assert [reports[step]["version"] for step in ("install", "update", "downgrade")] == [
        old,
        NEWER,
        old,
    ]
    assert [reports[step]["before"] for step in ("update", "downgrade")] == [old, NEWER]


def test_results_are_the_same_in_all_versions(reports):
    used = [reports[step]["used"] for step in ("install", "update", "downgrade")]
    assert [one["result"] for one in used] == [["FINISHED"]] * 3
    assert len({one["pixels"] for one in used}) == 1


@pytest.mark.parametrize("step", ["install", "update", "downgrade"])
def test_settings_presets_and_preferences_survive(reports, step):
    assert reports[step]["stored"] == {
        "mode": "COLORS",
        "time": 77.0,
        "mark": "kept",
        "presets": ["Mine.py"],
        "enabled": True,
    }


def test_uninstalling_leaves_the_persons_own_only(reports):
    ours = [name for name in reports["downgrade"]["left"] if "shock_" in name]
    assert ours == [
        "extensions/shock_releases/.blender_ext/index.json",  # Blender's list of the repository
        "scripts/presets/shock_filter/image/Mine.py",
    ]
