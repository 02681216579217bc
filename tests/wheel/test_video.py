# SPDX-License-Identifier: GPL-3.0-or-later
"""The extra ``video`` writes MP4."""

import numpy as np


def test_frames_become_a_video(shock_filter, tmp_path):
    np.save(tmp_path / "flow.npy", np.ones((32, 48, 2), np.float32))
    shock_filter("visualize-flow", "flow.npy", "flow.mp4", "--frames", "3")
    assert b"ftyp" in (tmp_path / "flow.mp4").read_bytes()[:16]
