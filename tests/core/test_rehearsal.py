# SPDX-License-Identifier: GPL-3.0-or-later
"""The runs of all filters on tiny examples."""

import pytest
from shock_filter.core.linear import cg
from shock_filter.core.rehearsal import arrays
from shock_filter.core.rehearsal import rehearse as rehearsal
from shock_filter.core.shape import learned


def test_it_ends_when_it_is_told_to():
    asked = []

    def progress(fraction, message):
        asked.append(fraction)
        return len(asked) < 3

    rehearsal.rehearse(progress)
    assert len(asked) == 3


@pytest.mark.parametrize("kind", ["geometry", "colors", "image", "texture"])
def test_examples_are_changed_by_the_filters(kind):
    # Else some kernels are not called.
    row = next(row for row in rehearsal.FILTERS if row.kind.name == kind and not row.then)
    plain, *_ = rehearsal._examples(kind)
    result = plain(row.name, row.settings())
    if kind == "geometry":
        assert result.largest_move > 0.1
    elif kind == "texture":
        old = rehearsal._textured(len(result.recolored.colors))[0].picture.pixels
        assert (result.recolored.colors != old).any(axis=2).sum() > 100
    else:
        assert result.changed > 100


def test_noise_takes_denoising_through_all_its_stages(monkeypatch):
    seen = []

    def mixed(network, *others):
        seen.append(network)
        return learned_mixed(network, *others)

    learned_mixed = learned.mixed
    monkeypatch.setattr(learned, "mixed", mixed)
    rehearsal._denoise()
    assert seen == learned.networks()
    assert rehearsal._denoise in list(rehearsal._runs({"colors"}))


def test_solves_of_small_and_of_large_meshes_are_both_rehearsed(monkeypatch):
    # Else large meshes find no kernels in the extension.
    assert arrays._large_solves in list(rehearsal._runs({"colors"}))
    seen = set()
    run = cg.run

    def noted(function, count, *arguments, **chunk):
        for array in arguments:
            if getattr(array, "ndim", 0) == 2:  # the search direction
                seen.add((function.__name__, array.dtype.char))
        return run(function, count, *arguments, **chunk)

    monkeypatch.setattr(cg, "run", noted)
    monkeypatch.setattr(cg, "_iterate_alone", None)
    arrays._large_solves()
    applied = {each for each in seen if each[0].startswith("_apply")}
    assert applied == {(name, char) for name in ("_apply", "_apply_three") for char in "fd"}
