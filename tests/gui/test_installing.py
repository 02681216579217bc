# SPDX-License-Identifier: GPL-3.0-or-later
"""From a release to a sharpened image, in a window: a repository with an update, a dropped zip."""

import build_extension
from publishing import NEWER


def test_scenario_ran_to_its_end(fresh):
    assert fresh["code"] == 0, fresh["output"]
    assert fresh.get("ended"), fresh["said"]


def test_each_way_brings_a_version_that_works(fresh):
    versions = [fresh[way][0] for way in ("installed", "updated", "dropped")]
    assert versions == [build_extension.version(), NEWER, build_extension.version()]
    assert all(fresh[way][1] > 0.05 for way in ("installed", "updated", "dropped"))


def test_settings_survive_the_update(fresh):
    assert fresh["time"] == 77.0


def test_a_mesh_is_sharpened_right_after_the_zip_was_dropped(fresh, capsys):
    blenders, ours = fresh["seconds"]
    with capsys.disabled():
        print(f"\ninstalling: {blenders:.1f} s; the first mesh after it: {ours:.2f} s")
    assert fresh["sharpened"] == ["FINISHED"]


def test_disabled_and_enabled_again_it_works(fresh):
    assert [version for version, _ in fresh["again"]] == [build_extension.version()] * 2
    assert all(change > 0.05 for _, change in fresh["again"])
