# SPDX-License-Identifier: GPL-3.0-or-later
"""Textures are previewed on the model, and new images give way to the old ones for a look."""

import pytest

pytestmark = pytest.mark.slow


@pytest.fixture
def report(play):
    return play("on_the_model")


def test_scenario_ran_to_its_end(report):
    assert report["code"] == 0, report["output"]
    assert report.get("ended"), report["said"]
    assert "Traceback" not in report["output"]


def test_a_texture_is_previewed_on_the_model(report):
    seen = report["preview"]
    assert not seen["offered_without_textures"]
    assert seen["shown"] > 2000
    assert seen["pixels"] == seen["start"]["pixels"]
    assert seen["before"] == "Coat"
    assert seen["dropped"] == seen["start"]
    assert seen["left"] < 500


def test_new_images_give_way_to_the_old_ones_where_they_are_seen(report):
    seen = report["new_images"]
    assert seen["texture"] == ["Coat sharpened", "Coat", "Coat sharpened"]
    assert seen["image"] == ["Photo sharpened", "Photo", "Photo sharpened"]
