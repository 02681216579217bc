# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs survive what may happen meanwhile: no crash, nothing half-written, nothing left behind."""

import pytest

ENDS = {
    "undo_and_redo_keys": {"kept": True, "written": True, "undone": True, "redone": True},
    "undo_by_script": {"written": True, "undone": True},
    "undo_of_what_was_read": {"unchanged": True},
    "object_deleted": {"objects": []},
    "mesh_deleted": {"objects": []},
    "mesh_edited": {"unchanged": True},
    "mode_changed": {
        "modes": {m: [m, True] for m in ("EDIT", "SCULPT", "VERTEX_PAINT", "WEIGHT_PAINT")}
    },
    "scene_changed": {"written": True},
    "workspace_changed": {"written": True},
    "area_maximized": {"written": True},
    "second_window_closed": {"cancelled": True, "unchanged": True},
    "filter_fails": {"unchanged": True},
    "animation_plays": {"played": True, "written": True},
    "image_removed_or_scaled": {"removed": "gone", "renamed": True, "scaled": False},
    "extension_disabled": {"unchanged": True, "works_again": True},
    "extension_disabled_and_enabled_at_once": {"works_again": True},
    "rendering": {"rendered": True, "early": False, "written": True},
    "file_opened": {"unchanged": True},
    "new_file": {"objects": ["Camera", "Cube", "Light"]},
}


@pytest.fixture
def report(play):
    return play("interrupted")


def test_scenario_ran_to_its_end(report):
    assert report["code"] == 0, report["output"]
    assert report.get("ended"), report["said"]


@pytest.mark.parametrize("mischief", ENDS)
def test_run_survives(report, mischief):
    assert report[mischief] == {**ENDS[mischief], "left": {"running": False, "operators": []}}


def test_failing_filter_is_logged_with_its_traceback(report):
    assert "ZeroDivisionError: on purpose" in report["output"]


def test_blender_quits_during_a_run(play):
    report = play("quitting")
    assert report["started"] == ["RUNNING_MODAL"]
    assert report["running"]
    assert report["code"] == 0, report["output"]
