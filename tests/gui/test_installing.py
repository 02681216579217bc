# SPDX-License-Identifier: GPL-3.0-or-later
"""From a release to a sharpened image, in a window: a repository with an update, a dropped zip."""

import build_extension
from publishing import NEWER


def test_scenario_ran_to_its_end(fresh):
    assert fresh["code"] == 0, fresh["output"]
    assert fresh.get("ended"), fresh["said"]


def test_installed_updated_and_removed_it_works_twice(fresh):
    for seen in fresh["rounds"]:
        assert [seen[step][0] for step in ("installed", "updated")] == [
            build_extension.version(),
            NEWER,
        ]
        assert all(seen[step][1] > 0.05 for step in ("installed", "updated"))
    assert len(fresh["rounds"]) == 2


def test_settings_survive_the_update(fresh):
    assert [seen["time"] for seen in fresh["rounds"]] == [77.0, 77.0]


def test_the_dropped_zip_works(fresh):
    assert fresh["dropped"][0] == build_extension.version()
    assert fresh["dropped"][1] > 0.05


def test_a_mesh_is_sharpened_right_after_the_zip_was_dropped(fresh, capsys):
    blenders, ours = fresh["seconds"]
    with capsys.disabled():
        print(f"\ninstalling: {blenders:.1f} s; the first mesh after it: {ours:.2f} s")
    assert fresh["sharpened"] == ["FINISHED"]


def test_disabled_and_enabled_again_it_works(fresh):
    assert [version for version, _ in fresh["again"]] == [build_extension.version()] * 2
    assert all(change > 0.05 for _, change in fresh["again"])


def test_a_second_copy_is_refused_with_the_remedy(fresh):
    assert f"{build_extension.version()} is enabled already, as bl_ext." in fresh["refused"]


def test_two_copies_take_turns_and_each_works(fresh):
    old = build_extension.version()
    versions = [version for version, _ in fresh["both"]]
    assert versions == [old, NEWER, old, NEWER, old, old]
    assert all(change > 0.05 for _, change in fresh["both"])
