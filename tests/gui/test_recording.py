# SPDX-License-Identifier: GPL-3.0-or-later
"""The loop that the README shows: Preview in use."""

import pytest

pytestmark = pytest.mark.slow


def test_it_shows_a_part_that_becomes_sharp(play):
    report = play("recording")
    assert report["code"] == 0, report["output"]
    assert report.get("ended"), report["said"]
    assert report["changed"]
    assert report["frames"] == 29
    assert report["differ"] > 5000
