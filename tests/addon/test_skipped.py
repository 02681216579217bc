# SPDX-License-Identifier: GPL-3.0-or-later
"""Reasons and errors are said in the interface's language, with their names and numbers."""

import json
import pickle
from pathlib import Path

import bpy
import pytest
from shock_filter.core import InvalidMesh
from shock_filter.shock_addon.data import skipped
from shock_filter.shock_addon.data.skipped import Skipped, as_reason, explain, sentences
from shock_filter.shock_addon.ui import translations

sharpen = bpy.ops.shock_filter.sharpen_geometry


@pytest.fixture
def german(monkeypatch):
    """Translate as Blender with German does; the bpy module is built without languages."""
    path = Path(translations.__file__).parent / "locale" / "de_DE.json"
    table = json.loads(path.read_text(encoding="utf-8"))
    monkeypatch.setattr(skipped, "pgettext_rpt", table.__getitem__)


def test_fields_are_filled_after_the_translation(german):
    reason = Skipped(
        "its shape key {name!r} is locked; unlock it or choose New Shape Key", name="A"
    )
    assert str(reason).startswith("der Formschlüssel 'A' ist gesperrt; ")


def test_names_may_hold_braces():
    reason = Skipped("its mask {name} holds NaN; paint over it first", name="{0}")
    assert str(reason) == "its mask {0} holds NaN; paint over it first"
    assert str(InvalidMesh("Give {3}.")) == explain(InvalidMesh("Give {3}.")) == "Give {3}."


def test_objects_with_the_same_reason_share_a_sentence(german):
    reason = str(Skipped("it was removed meanwhile"))
    left = [*((name, reason) for name in "ABCDE"), ("F", str(Skipped("it is a movie; save the"
            " frame as an image and open that")))]  # fmt: skip
    both = sentences(left)
    assert len(both) == 2
    assert "A, B, C und 2 weitere" in both[0]
    assert both[0].endswith("inzwischen entfernt.")
    assert both[1].startswith("F übersprungen: ein Film; ")


def test_errors_of_the_core_become_reasons(german):
    error = InvalidMesh(
        "The mesh has {count} faces; at most {most} are supported.", count=9, most=5
    )
    assert str(error) == "The mesh has 9 faces; at most 5 are supported."
    assert as_reason(explain(error)) == "Die Masche hat 9 Flächen; höchstens 5 sind möglich"
    assert as_reason("面がありません。") == "面がありません"


def test_an_error_may_be_pickled():
    error = InvalidMesh(
        "The mesh has {count} faces; at most {most} are supported.", count=9, most=5
    )
    again = pickle.loads(pickle.dumps(error))
    assert str(again) == str(error)
    assert (again.sentence, again.values) == (error.sentence, error.values)


def test_operators_say_reasons_in_the_interfaces_language(german, rounded_box):
    rounded_box()
    with pytest.raises(RuntimeError, match="keine Punktgruppe namens 'Nobody' vorhanden"):
        sharpen(vertex_group="Nobody")


def test_operators_say_errors_in_the_interfaces_language(german, rounded_box):
    box = rounded_box()
    box.data.vertices[0].co.x = float("nan")
    with pytest.raises(RuntimeError, match="Der Punkt 0 hat keinen gültigen Ort"):
        sharpen()
