# SPDX-License-Identifier: GPL-3.0-or-later
"""From voxels to a low poly whose maps look like what they were baked of, in a window."""

import pytest

pytestmark = pytest.mark.slow


@pytest.fixture
def report(play):
    return play("baking")


def test_scenario_ran_to_its_end(report):
    assert report["code"] == 0, report["output"]
    assert report.get("ended"), report["traceback"]
    assert "Traceback" not in report["output"]


def test_selected_to_active_is_pressed_and_makes_the_maps(report):
    assert report["is_hidden"]  # the low poly stood in its place
    assert report["buttons"] == 2
    low = report["images"][0].rsplit("_", 1)[0]
    for suffix in ("ao", "curvature", "height", "normal", "thickness"):
        assert f"{low}_{suffix}" in report["images"]
    assert report["told"].startswith("Baked 5 maps of ")
    assert "In the map of heights, white is" in report["details"]


def test_the_low_poly_looks_like_the_detailed_one(report, capsys):
    with capsys.disabled():
        print(f"\nfaces: {report['faces']}, bare {report['bare']:.2f}, maps {report['baked']:.2f}")
    many, few = report["faces"]
    assert few < 0.1 * many
    assert report["baked"] < report["bare"]
    assert report["baked"] < 2
