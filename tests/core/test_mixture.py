# SPDX-License-Identifier: GPL-3.0-or-later
"""Networks that weigh candidates, their mixtures, and means over what lies around."""

from itertools import pairwise

import numpy as np
import pytest
from shapes import rotation
from shock_filter.core.base import parallel
from shock_filter.core.mixture.cells import MeansAround
from shock_filter.core.mixture.choice import FAINT, mixture, pair_count, tell_pairs
from shock_filter.core.mixture.network import Network, load, save


def some_network(rng, sizes=(13, 10, 6, 4)):
    pairs = list(pairwise(sizes))
    return Network(
        tuple(rng.normal(size=pair).astype(np.float16).astype(np.float32) for pair in pairs),
        tuple(rng.normal(size=b).astype(np.float32) for _, b in pairs),
        "meaning", "scripts", 3,
    )  # fmt: skip


def unit(rng, *shape):
    x = rng.normal(size=(*shape, 3)).astype(np.float32)
    return x / np.linalg.norm(x, axis=-1, keepdims=True)


def test_scores_are_those_of_the_layers_one_after_the_other():
    rng = np.random.default_rng(0)
    network, told = some_network(rng), rng.normal(size=(50, 13)).astype(np.float32)
    rows = told.astype(np.float64)
    for weights, shift in zip(network.weights[:-1], network.shifts[:-1], strict=True):
        rows = np.maximum(rows @ weights + shift, 0)
    expected = rows @ network.weights[-1] + network.shifts[-1]
    assert network.scores(told) == pytest.approx(expected, abs=1e-4)


def test_a_row_has_the_same_bits_among_others_and_on_any_number_of_threads(monkeypatch):
    rng = np.random.default_rng(1)
    network, told = some_network(rng), rng.normal(size=(9000, 13)).astype(np.float32)
    scores = network.scores(told)
    order = rng.permutation(len(told))[:4321]
    assert (network.scores(told[order]) == scores[order]).all()
    monkeypatch.setattr(parallel, "most_threads", 1)
    assert (network.scores(told) == scores).all()


@pytest.mark.parametrize("sizes", [(13, 10, 6, 4), (55, 56, 40, 8), (4, 5), (3, 2, 7)])
def test_columns_have_the_scores_of_rows_and_the_same_bits_among_others(sizes):
    rng = np.random.default_rng(7)
    network, told = some_network(rng, sizes), rng.normal(size=(333, sizes[0])).astype(np.float32)
    columns = network.of_columns(np.ascontiguousarray(told.T))
    np.testing.assert_allclose(columns.T, network.scores(told), rtol=1e-4, atol=1e-3)
    order = rng.permutation(333)[:57]
    some = network.of_columns(np.ascontiguousarray(told[order].T))
    assert (some == columns[:, order]).all()


def test_networks_come_back_from_disk_and_only_for_their_own_meaning(tmp_path):
    rng = np.random.default_rng(2)
    networks = {"one": some_network(rng), "two": some_network(rng, (3, 2))}
    save(tmp_path / "n.npz", networks)
    found = load(tmp_path / "n.npz", "meaning")
    for name, network in networks.items():
        again = found[name]
        assert (again.definition, again.made_of, again.version) == ("meaning", "scripts", 3)
        for old, new in zip((*network.weights, *network.shifts),
                            (*again.weights, *again.shifts), strict=True):  # fmt: skip
            assert (old == new).all()
    with pytest.raises(ValueError, match="train it again"):
        load(tmp_path / "n.npz", "other")


def test_a_mixture_lies_between_its_candidates_as_the_scores_say():
    candidates = np.array([[[1, 0, 0], [0, 1, 0], [0, 0, 1]]], dtype=np.float32)
    even, shares = mixture(candidates, np.zeros((1, 3), dtype=np.float32))
    assert even[0] == pytest.approx(np.full(3, 3**-0.5))
    assert shares[0] == pytest.approx(np.full(3, 1 / 3))
    sure, _ = mixture(candidates, np.array([[0, 60, 0]], dtype=np.float32))
    assert sure[0] == pytest.approx([0, 1, 0])
    last, shares = mixture(candidates, np.array([[60, 0, 0]], dtype=np.float32), 1)
    assert last[0] == pytest.approx([0, 0.5**0.5, 0.5**0.5])
    assert shares[0, 0] == 0


def test_candidates_that_cancel_each_other_leave_the_first():
    candidates = np.array([[[1, 0, 0], [-1, 0, 0]]], dtype=np.float32)
    mixed, _ = mixture(candidates, np.zeros((1, 2), dtype=np.float32))
    assert (mixed[0] == [1, 0, 0]).all()


def test_pairs_are_told_the_same_however_candidates_are_turned():
    rng = np.random.default_rng(3)
    candidates = unit(rng, 20, 4)
    told, turned = (np.zeros((20, pair_count(4) + 2), dtype=np.float32) for _ in range(2))
    tell_pairs(candidates, told)
    tell_pairs((candidates @ rotation(4)).astype(np.float32), turned)
    assert turned == pytest.approx(told, abs=1e-4)
    assert (told[:, pair_count(4) :] == 0).all()
    distance = np.linalg.norm(candidates[:, 0] - candidates[:, 1], axis=1)
    assert (np.argsort(told[:, 0]) == np.argsort(distance)).all()


def test_means_of_one_value_are_that_value_and_others_lie_between():
    rng = np.random.default_rng(4)
    places, rows = rng.normal(size=(500, 3)) * 20, np.arange(0, 500, 7)
    values = np.stack([np.full(500, 2.5), rng.uniform(size=500)], axis=1)
    means = MeansAround(places, values, 5.0).at(rows)
    assert means[:, 0] == pytest.approx(np.full(len(rows), 2.5))
    assert values[:, 1].min() < means[:, 1].min() < means[:, 1].max() < values[:, 1].max()


def test_means_hardly_depend_on_how_the_cells_lie_and_not_on_the_order():
    rng = np.random.default_rng(5)
    sheet = np.stack([*np.meshgrid(np.arange(60.0), np.arange(60.0)), np.zeros((60, 60))], -1)
    places, rows = sheet.reshape(-1, 3) - 30, np.arange(0, 3600, 11)
    values = (places[:, :1] > 0) + 0.1 * rng.normal(size=(3600, 1))
    means = MeansAround(places, values, 5.0).at(rows)
    assert np.ptp(means) > 0.9
    for seed in (1, 2):
        turned = MeansAround(places @ rotation(seed) + seed / 3, values, 5.0).at(rows)
        assert abs(turned - means).max() < 0.06
    order = rng.permutation(3600)
    back = np.argsort(order)[rows]
    shuffled = MeansAround(places[order], values[order], 5.0).at(back)
    assert shuffled == pytest.approx(means, abs=1e-12)


def test_a_few_places_very_far_apart_take_neither_memory_nor_time():
    places = np.array([[0.0, 0, 0], [1e12, 0, 0], [0, 1e12, 1e12]])
    means = MeansAround(places, np.array([[1.0], [2.0], [3.0]]), 5.0).at(np.arange(3))
    assert means[:, 0] == pytest.approx([1, 2, 3])


def test_logarithms_of_distances_are_those_of_numpy():
    far = np.concatenate([[0.0], np.geomspace(1e-6, 19.0, 5000)]).astype(np.float32)
    told = np.empty((len(far), 1), dtype=np.float32)
    tell_pairs(np.stack([np.zeros_like(far), far], axis=1)[..., None], told)
    wanted = np.log((far + np.float32(FAINT)).astype(float)) + 2.0
    assert np.abs(told[:, 0] - wanted).max() < 2e-6
