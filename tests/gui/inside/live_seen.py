# SPDX-License-Identifier: GPL-3.0-or-later
"""Tell what is seen of a file, and save it: ``--python live_seen.py -- FILE REPORT NEW``.

Nothing here needs the extension; where it is enabled, the states of live results are told too.
"""

import hashlib
import json
import sys

import bpy
import numpy as np

FRAMES = (1, 6, 11)
KINDS = {  # how values are read: property, count, type
    "position": ("vector", 3, np.float32),
    ".corner_vert": ("value", 1, np.int32),
    ".edge_verts": ("value", 2, np.int32),
    "sharp_edge": ("value", 1, bool),
    "sharp_face": ("value", 1, bool),
    "Paint": ("color_srgb", 4, np.float32),
}


def seen(obj: bpy.types.Object) -> dict[str, str]:
    """Return the digests of what is seen of an object."""
    return digests(obj.evaluated_get(bpy.context.evaluated_depsgraph_get()).data)


def digests(mesh: bpy.types.Mesh) -> dict[str, str]:
    """Return a word for each attribute, which tells one bit."""
    found = {}
    for name, (key, count, kind) in KINDS.items():
        attribute = mesh.attributes.get(name)
        if attribute is not None:
            values = np.empty(count * len(attribute.data), kind)
            attribute.data.foreach_get(key, values)
            is_set = kind is not bool or values.any()  # none and an attribute without any are one
            if is_set:
                found[name] = hashlib.sha256(values.tobytes()).hexdigest()
    return found


path, target, new = sys.argv[sys.argv.index("--") + 1 :]
bpy.ops.wm.open_mainfile(filepath=path)
report = {"version": bpy.app.version_string, "seen": {}}
objects = sorted((obj for obj in bpy.data.objects if obj.type == "MESH"), key=lambda obj: obj.name)
for frame in FRAMES:
    bpy.context.scene.frame_set(frame)
    report["seen"][str(frame)] = {obj.name: seen(obj) for obj in objects}
report["below"] = {obj.name: digests(obj.data) for obj in objects}
live = sys.modules.get("bl_ext.user_default.shock_filter")
report["states"] = {} if live is None else {obj.name: live.live.state(obj) for obj in objects}
with open(target, "w", encoding="utf-8") as file:
    json.dump(report, file)
bpy.ops.wm.save_as_mainfile(filepath=new)
