# SPDX-License-Identifier: GPL-3.0-or-later
"""What scripts, keys, files and presets rely on: names and defaults stay as they are.

Run as a program, this file writes down what is there now.
"""

import json
from pathlib import Path

import bpy

STORED = Path(__file__).parent / "stable_names.json"


def default_of(known):
    if known.type == "ENUM":
        return [known.default, *known.enum_items.keys()]
    if known.type == "FLOAT":
        return [float(f"{value:.6g}") for value in (known.default, known.hard_min, known.hard_max)]
    if known.type == "INT":
        return [known.default, known.hard_min, known.hard_max]
    if known.type == "POINTER":
        return known.fixed_type.identifier
    return getattr(known, "default", None)


def properties_of(rna):
    return {
        known.identifier: default_of(known)
        for known in rna.properties
        if known.identifier not in ("rna_type", "name") or known.type == "STRING"
        if known.identifier not in ("rna_type", "filter_folder")
    }


def operators():
    found = {}
    for name in sorted(dir(bpy.ops.shock_filter)):
        rna = getattr(bpy.ops.shock_filter, name).get_rna_type()
        cls = getattr(bpy.types, rna.identifier)
        found[name] = {
            "label": rna.name,
            "tooltip": rna.description,
            "options": sorted(getattr(cls, "bl_options", ())),
            "properties": properties_of(rna),
        }
    return found


def groups():
    scene = bpy.context.scene.shock_filter
    found = {"scene": properties_of(scene.bl_rna)}
    for name, known in scene.bl_rna.properties.items():
        if known.type == "POINTER" and name != "rna_type":
            found[name] = properties_of(known.fixed_type)
    return found


def presets():
    """List all that a mode's settings are after each shipped preset."""
    scene = bpy.context.scene.shock_filter
    found = {}
    for mode, panel in modes_and_panels():
        settings = getattr(scene, mode)
        found[mode] = {}
        for name in names_of_presets(mode):
            assert bpy.ops.shock_filter.use_preset(mode=mode, name=name) == {"FINISHED"}
            found[mode][name] = {
                known: default_like(settings, known)
                for known in stored(settings)
                if settings.is_property_set(known)
                if known not in ("rna_type", "name")
            }
        adds = getattr(bpy.types, f"SHOCK_FILTER_OT_{mode}_preset_add")
        found[mode]["kept"] = [panel.preset_subdir, *sorted(adds.preset_values.fget(adds))]
    return found


def stored(settings):
    """Name what files store; the hidden ones show others in another way."""
    return [each.identifier for each in settings.bl_rna.properties if not each.is_hidden]


def default_like(settings, name):
    value = getattr(settings, name)
    return float(f"{value:.6g}") if isinstance(value, float) else value


def modes_and_panels():
    for name in sorted(dir(bpy.types)):
        if name.startswith("SHOCK_FILTER_PT_") and name.endswith("_presets"):
            mode = name.removeprefix("SHOCK_FILTER_PT_").removesuffix("_presets")
            yield mode, getattr(bpy.types, name)


def names_of_presets(mode):
    """Blender's error lists them."""
    try:
        bpy.ops.shock_filter.use_preset(mode=mode, name="")
    except RuntimeError as error:
        return str(error).strip().rpartition("choose one of: ")[2].rstrip(".").split(", ")
    raise AssertionError


def inventory():
    """Gather all of it, as JSON would hold it."""
    classes = sorted(name for name in dir(bpy.types) if name.startswith("SHOCK_FILTER_"))
    found = {"operators": operators(), "groups": groups(), "presets": presets(), "types": classes}
    return json.loads(json.dumps(found))


def test_names_defaults_and_presets_are_what_they_were():
    old, new = json.loads(STORED.read_text(encoding="utf-8")), inventory()
    assert new["types"] == old["types"]
    for part in ("operators", "groups", "presets"):
        for name, values in old[part].items():
            assert new[part][name] == values, (part, name)
        assert new[part].keys() == old[part].keys()


if __name__ == "__main__":
    import shock_filter

    bpy.ops.wm.read_homefile(use_empty=True)
    shock_filter.register()
    STORED.write_text(json.dumps(inventory(), indent=1, sort_keys=True), encoding="utf-8")
    shock_filter.unregister()
