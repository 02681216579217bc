# SPDX-License-Identifier: GPL-3.0-or-later
"""Networks are trained, on a few examples, and the shipped ones come from these scripts."""

from functools import partial

import adam
import crease_examples
import denoise_examples
import exports
import image_examples
import image_spoiling
import made
import mesh_pictures
import numpy as np
import pytest
import train_creases
import train_denoising
import train_enlarging
import train_images
import train_meshes
from distances import box, truths
from meshings import EXTENT, sampled, surface_nets
from shock_filter import core
from shock_filter.core.color import vertices_learned
from shock_filter.core.color.learned import enlarging, recipe
from shock_filter.core.mixture.choice import mixture
from shock_filter.core.mixture.network import load
from shock_filter.core.shape import learned, smoothings
from shock_filter.core.shape.candidates import DEFINITION
from shock_filter.core.shape.creases import WEIGHTS


def test_the_shipped_networks_come_from_these_scripts():
    for network in load(WEIGHTS, DEFINITION).values():
        assert network.made_of == train_creases.made_of()
        assert network.version == train_creases.VERSION


def test_the_shipped_denoisers_come_from_these_scripts():
    found = load(learned.WEIGHTS, smoothings.DEFINITION)
    for name in learned.STAGES:
        assert found[name].made_of == train_denoising.made_of()
        assert found[name].version == train_denoising.VERSION


def test_the_shipped_networks_for_images_come_from_these_scripts():
    found = load(recipe.WEIGHTS, recipe.DEFINITION)
    for name in recipe.STAGES:
        assert found[name].made_of == train_images.made_of()
        assert found[name].version == train_images.VERSION


def test_the_shipped_networks_for_enlarging_come_from_these_scripts():
    found = load(enlarging.WEIGHTS, enlarging.DEFINITION)
    for times in enlarging.FACTORS:
        network = found[enlarging.name_of(times)]
        assert network.made_of == train_enlarging.made_of()
        assert network.version == train_enlarging.VERSION


def test_the_shipped_networks_for_vertices_come_from_these_scripts():
    found = load(vertices_learned.WEIGHTS, vertices_learned.DEFINITION)
    for name in recipe.STAGES:
        assert found[name].made_of == train_meshes.made_of()
        assert found[name].version == train_meshes.VERSION


@pytest.mark.slow
def test_networks_of_images_learn_on_on_meshes(tmp_path, monkeypatch):
    monkeypatch.setattr(image_examples, "SIZE", 48)
    monkeypatch.setattr(image_examples, "bank", lambda: [np.eye(768, dtype=np.float32)])
    monkeypatch.setattr(mesh_pictures, "SIDE", 40)
    monkeypatch.setattr(mesh_pictures, "MESHES", (mesh_pictures.jittered,))
    monkeypatch.setattr(train_meshes, "EPOCHS", 3)
    paths = [train_meshes.made(seed, tmp_path) for seed in range(64, 81)]
    assert train_meshes.made(64, tmp_path) == paths[0]  # made once
    said = []
    networks = train_meshes.train(paths, 1, log=said.append)
    told = train_meshes.table(paths[0], [])[0]["told"]
    assert networks["first"].weights[0].shape[0] == told.shape[1]
    assert told[:, -1].min() > 0.01  # how uneven the mesh is
    assert any("learned on" in line for line in said)


@pytest.mark.slow
def test_a_tiny_network_learns_to_enlarge(monkeypatch):
    monkeypatch.setattr(image_examples, "SIZE", 48)
    monkeypatch.setattr(image_examples, "bank", lambda: [np.eye(768, dtype=np.float32)])
    tables = [train_enlarging.table(seed) for seed in range(64, 96)]
    parts = [part for each in tables for part in each[2]]
    said = []
    network = train_enlarging.train(parts, 2, epochs=8, hidden=(16,), log=said.append)
    assert network.definition == enlarging.DEFINITION
    seen = [part for part in parts if not part["aside"][0]]
    assert len(parts) - len(seen) == 2 * train_enlarging.COPIES
    assert train_enlarging.gains(network, train_enlarging.joined(seen)).mean() > 0.2
    assert "mean gain" in said[-1]


def test_turned_pictures_have_turned_answers():
    random = np.random.default_rng(3)
    told = random.normal(size=(5, enlarging.TOLD)).astype(np.float32)
    network = enlarging.Network(
        (random.normal(size=(enlarging.TOLD, 9)).astype(np.float32),), (np.zeros(9, np.float32),)
    )
    rows = {"told": told, "missing": np.zeros((5, 9), np.float32), "error": np.ones(1)}
    mean = train_enlarging.PictureLoss(rows).mean_of(
        network.scores(train_enlarging.Turned(told)[np.arange(5)])
    )
    views = [net.scores(told) for net in enlarging.views_of(network)]
    np.testing.assert_allclose(mean, sum(views) / enlarging.VIEWS, atol=1e-5)


def test_digests_are_of_the_scripts_that_are_named_and_no_others():
    here = train_denoising.HERE
    for module in (train_creases, train_denoising, train_images):
        assert all((here / name).exists() for name in module.MADE_OF)
    assert "image_examples.py" not in train_creases.MADE_OF
    assert train_creases.made_of() != train_denoising.made_of()


@pytest.mark.slow
def test_a_tiny_denoiser_learns_to_come_nearer_on_a_mesh_it_has_not_seen(tmp_path, monkeypatch):
    tiny = partial(denoise_examples.example, kind="white")
    monkeypatch.setattr(train_denoising, "MAKERS", {"solid": tiny})
    paths = train_denoising.make_all({"solid": 10}, tmp_path, 1)
    assert train_denoising.make_all({"solid": 10}, tmp_path, 1) == paths  # made once
    said = []
    networks = train_denoising.train(paths, epochs=(8, 8, 8), hidden=(32,), log=said.append)
    unseen = train_denoising.table(paths[0], [])
    assert unseen["aside"].all()
    own, new = train_denoising.errors(networks["first"], unseen)
    assert new.mean() < 0.75 * own.mean()
    after = train_denoising.table(paths[0], [networks["first"]])
    assert train_denoising.errors(networks["next"], after)[1].mean() < 1.05 * new.mean()
    assert any(line.startswith("white") for line in said)


def test_shares_are_learned_that_make_up_for_what_is_missing():
    rng = np.random.default_rng(4)
    n = 8 * train_images.PIXELS
    d = rng.normal(0, 10, (n, 2, 3)).astype(np.float32)
    rows = {
        "told": rng.normal(size=(n, 3)).astype(np.float32), "differences": d,
        "missing": 0.5 * d[:, 0], "low": np.full((n, 3), -99, np.float32),
        "high": np.full((n, 3), 99, np.float32), "weights": np.ones(n, np.float32),
        "error": np.full(8, 25.0), "same": np.zeros(8, bool),
    }  # fmt: skip
    loss = train_images.PictureLoss(rows)
    network = adam._trained(rows["told"], loss, (8, 2), 200, 0, lambda _: None)
    assert train_images.gains(network, rows).min() > 5.0


def test_pictures_come_from_their_seed():
    firsts = image_spoiling.WIDELY, image_spoiling.SOFTLY, image_spoiling.PLAINLY
    for seed in (10003, *(first + 3 for first in firsts)):
        truth, spoiled = image_spoiling.example(seed)
        again, _ = image_spoiling.example(seed)
        assert truth.shape == (image_examples.SIZE, image_examples.SIZE, 3)
        np.testing.assert_array_equal(truth, again)
        assert len(spoiled) == 3
        for image, same, _ in spoiled:
            assert (image.dtype, image.shape) == (np.uint8, truth.shape)
            assert not same or (image == truth).all()
    steepest = lambda image: np.abs(np.diff(image.astype(float), axis=1)).max()  # noqa: E731
    for first in (image_spoiling.WIDELY, image_spoiling.PLAINLY):
        truth, spoiled = image_spoiling.example(first + 3)
        assert steepest(spoiled[0].given) < steepest(truth)


def test_the_truth_is_what_a_told_blur_leaves():
    image = np.zeros((48, 48, 3), np.uint8)
    image[:, 24:] = 255
    copy = image_spoiling.Copy(image, square=16.0)
    partly = 0
    for seed in range(60):
        square, truth = image_spoiling.told(np.random.default_rng(seed), image, copy, 20.0)
        if 0 < square < 12.8:  # the rest is 0, not told, or all of it
            steepest = np.diff(truth[24, :, 0].astype(float)).max()
            assert abs(steepest * np.sqrt(2 * np.pi * (16 - square)) / 255 - 1) < 0.06
            partly += 1
        else:
            assert truth is image
    assert 0 < partly < 30
    unknown = image_spoiling.Copy(image)
    assert all(
        image_spoiling.told(np.random.default_rng(seed), image, unknown, 20.0) == (0.0, image)
        for seed in range(9)
    )


def test_slopes_of_shares_are_those_of_the_loss():
    rng = np.random.default_rng(3)
    n = train_images.PIXELS
    rows = {
        "told": np.zeros((n, 1)), "differences": rng.normal(size=(n, 4, 3)),
        "missing": rng.normal(size=(n, 3)), "low": np.full((n, 3), -1.5),
        "high": np.full((n, 3), 1.5), "weights": rng.uniform(0.5, 1, n),
        "error": np.array([2.0]), "same": np.array([False]),
    }  # fmt: skip
    loss, chosen = (
        train_images.PictureLoss({**rows, "told": np.zeros((99 * 1024, 1))}),
        np.arange(6),
    )
    shares = rng.normal(size=(6, 4)) * 0.3
    held = train_images.HELD * shares / 6
    _, slopes = loss(shares, chosen)
    for at in ((0, 1), (3, 2), (5, 0)):
        shares[at] += 1e-6
        above = loss(shares, chosen)[0]
        shares[at] -= 2e-6
        below = loss(shares, chosen)[0]
        shares[at] += 1e-6
        slope = (above - below) / 2e-6 / 6
        assert slopes[at] - held[at] == pytest.approx(slope, rel=1e-3, abs=1e-6)


@pytest.mark.parametrize(
    "kind",
    [*denoise_examples.KINDS, "figure", "displaced", "drawn", "cage", "divided", "rough", "steep",
     "short", "export", "scan"],
)  # fmt: skip
def test_examples_of_noise_come_from_their_seed(kind):
    def make(seed):
        if kind in denoise_examples.KINDS:
            return denoise_examples.example(seed, kind)
        return getattr(denoise_examples, kind)(seed)

    one, two = make(5), make(5)
    assert np.array_equal(one.mesh.vertices, two.mesh.vertices)
    assert len(one.truth) == one.mesh.face_count
    lengths = np.linalg.norm(one.truth, axis=1)[one.mesh.areas > 0]
    assert lengths == pytest.approx(np.ones(len(lengths)), abs=1e-6)
    assert not np.array_equal(make(6).mesh.vertices[:9], one.mesh.vertices[:9])


@pytest.mark.parametrize("kind, borders", [("raised", 4), ("coiled", 0), ("toothed", 0)])
def test_exports_are_closed_but_for_the_outline_of_plates(kind, borders, monkeypatch):
    monkeypatch.setattr(exports, "SHARES", {kind: 1.0})
    mesh = core.TriangleMesh(*exports.exported(np.random.default_rng(2)))
    assert mesh.face_count > 50 and (mesh.areas > 0).all()
    assert np.count_nonzero(mesh.twins < 0) == borders


def test_fine_relief_with_noise_is_left_out(tmp_path):
    kinds = [denoise_examples.short(seed).kind for seed in range(6)]
    found = [train_denoising.made(("short", seed), tmp_path) for seed in range(6)]
    assert {"displaced", "noisy displaced"} <= set(kinds)
    assert [path is None for path in found] == [kind == "noisy displaced" for kind in kinds]


def test_a_tiny_network_learns_to_come_nearer_on_solids_it_has_not_seen(tmp_path, monkeypatch):
    tiny = partial(crease_examples.remeshed, kinds=("part",), meshings=("nets",), cells=26, noise=0)
    monkeypatch.setattr(made, "MAKERS", {"remeshed": tiny})
    paths = made.make_all({"remeshed": 14}, tmp_path, 1)
    assert made.make_all({"remeshed": 14}, tmp_path, 1) == paths  # made once
    rows = train_creases.gathered(paths, 1)
    said = []
    networks = train_creases.train(rows, epochs=10, log=said.append)
    aside = train_creases.chosen(rows, rows["aside"])
    assert len(aside["kind"]) > 100
    own, new = train_creases.errors(networks["mixture"], aside)
    assert new.mean() < 0.85 * own.mean()
    losses = [float(line.split()[2]) for line in said if line.startswith("epoch")]
    assert losses[9] < losses[0]
    passed = networks["gate"].scores(np.ascontiguousarray(
        rows["told"][:, train_creases.TOLD_FIRST]))[:, 0] > 0  # fmt: skip
    turns = train_creases.turns_of(networks["mixture"], rows)
    assert turns[passed].mean() > 2 * turns[~passed].mean()


def test_training_gives_the_same_network_from_the_same_seed():
    rng = np.random.default_rng(0)
    told = rng.normal(size=(4096, 6)).astype(np.float32)
    wanted = (told[:, 0] > 0.5).astype(np.float32)
    one, two = (adam.trained_gate(told, wanted, (8,), 150, log=lambda _: None) for _ in range(2))
    assert all((a == b).all() for a, b in zip(one.weights, two.weights, strict=True))
    assert ((one.scores(told)[:, 0] > 0) == (wanted > 0)).mean() > 0.9


@pytest.mark.parametrize("harm", [0.0, 1.5])
def test_slopes_are_those_of_the_loss(harm):
    rng = np.random.default_rng(1)
    layers = [[rng.normal(size=(4, 5)), rng.normal(size=5)],
              [rng.normal(size=(5, 3)), rng.normal(size=3)]]  # fmt: skip
    told, weights = rng.normal(size=(7, 4)), rng.uniform(0.5, 1, 7)
    components, targets = rng.normal(size=(7, 3, 3)), rng.normal(size=(7, 2, 3))
    components /= np.linalg.norm(components, axis=1, keepdims=True)
    targets /= np.linalg.norm(targets, axis=2, keepdims=True)

    def back(y):
        return adam._mixture_back(y, components, targets, weights, harm)

    loss, slopes = adam._slopes(layers, told, back)
    for n, j in ((0, 0), (0, 1), (1, 0), (1, 1)):
        at = (0,) * layers[n][j].ndim
        layers[n][j][at] += 1e-6
        change = (adam._slopes(layers, told, back)[0] - loss) / 1e-6
        layers[n][j][at] -= 1e-6
        assert slopes[n][j][at] * len(told) == pytest.approx(change, rel=1e-3, abs=1e-5)


def test_with_harm_a_mixture_in_doubt_keeps_the_input():
    told = np.ones((4096, 1), np.float32)  # nothing tells the rows apart
    candidates = np.tile(np.eye(3, dtype=np.float32)[:2], (4096, 1, 1))
    wanted = (np.arange(4096) % 10 < 6).astype(int)  # of six in ten rows the other one is right
    targets = np.repeat(candidates[0, wanted][:, None], 2, axis=1)
    shares = []
    for harm in (0.0, 1.0):
        network = adam.trained_mixture(told, candidates, targets, np.ones(4096, np.float32), (4,),
                                       400, log=lambda _: None, harm=harm)  # fmt: skip
        shares.append(mixture(candidates[:1], network.scores(told[:1]))[0][0])
    assert shares[0] @ candidates[0, 1] > 0.9
    assert shares[1] @ candidates[0, 0] > 0.9


def test_slopes_of_free_mixtures_are_those_of_the_loss():
    rng = np.random.default_rng(2)
    y, weights = rng.normal(size=(5, 8)), rng.uniform(0.5, 1, 5)
    candidates, targets = rng.normal(size=(5, 4, 3)), rng.normal(size=(5, 3))
    candidates /= np.linalg.norm(candidates, axis=2, keepdims=True)
    targets /= np.linalg.norm(targets, axis=1, keepdims=True)
    components = candidates.transpose(0, 2, 1)
    loss, slopes = adam._free_back(y, components, targets, weights)
    for at in ((0, 1), (3, 2), (2, 5), (4, 7)):
        y[at] += 1e-6
        change = (adam._free_back(y, components, targets, weights)[0] - loss) / 1e-6
        y[at] -= 1e-6
        assert slopes[at] * len(y) == pytest.approx(change, rel=1e-2, abs=3e-4)


def test_samples_beside_the_surface_are_those_of_the_whole_grid():
    solid = box((0.1, 0, 0), (0.6, 0.4, 0.05))
    line = np.linspace(-EXTENT, EXTENT, 41)
    points = np.stack(np.meshgrid(line, line, line, indexing="ij"), -1).reshape(-1, 3)
    whole, found = solid(points).reshape(41, 41, 41), sampled(solid, 41)
    near = abs(whole) < 1.8 * (line[1] - line[0])
    assert (found[near] == whole[near]).all()
    assert ((found < 0) == (whole < 0)).all()


def test_truths_are_the_normals_of_both_sides_of_a_crease():
    solid = box((0, 0, 0), (0.5, 0.5, 0.5))
    up = np.tile([0.0, 0.0, 1.0], (2, 1))
    one, two = truths(solid, np.array([[0.499, 0.0, 0.51], [0.0, 0.0, 0.52]]), up, 0.1, 0.1)
    both = {tuple(np.abs(n[0]).round(2).tolist()) for n in (one, two)}
    assert both == {(1.0, 0.0, 0.0), (0.0, 0.0, 1.0)}
    assert one[1] == pytest.approx([0, 0, 1], abs=1e-6)
    assert (one[1] == two[1]).all()


def test_truths_of_slanted_faces_reach_farther_across_a_crease():
    solid = box((0, 0, 0), (0.5, 0.5, 0.5))
    beside = np.array([[0.47, 0.0, 0.5]])  # 0.3 edges
    slanted = np.array([[0.6, 0.0, 0.8]])
    one, two = truths(solid, beside, slanted, 0.1, 0.1)
    assert one[0] == pytest.approx([0, 0, 1], abs=1e-6)
    assert two[0] == pytest.approx([1, 0, 0], abs=0.01)
    one, two = truths(solid, beside, one, 0.1, 0.1)
    assert (one == two).all()
    one, two = truths(solid, beside - [0.03, 0, 0], slanted, 0.1, 0.1)
    assert (one == two).all()


def test_examples_have_as_many_normals_as_asked_for_and_unit_length():
    for make in (crease_examples.modelled, crease_examples.softened):
        example = make(3)
        one, two = example.targets(np.arange(0, example.mesh.face_count, 5))
        assert np.linalg.norm(one, axis=1) == pytest.approx(np.ones(len(one)))
        assert one.shape == two.shape
    mesh = crease_examples.modelled(3).mesh
    assert (crease_examples.modelled(3).mesh.vertices == mesh.vertices).all()


def test_surface_nets_close():
    _, faces = surface_nets(sampled(box((0, 0, 0), (0.5, 0.4, 0.3)), 24))
    ends = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), 1)
    _, times = np.unique(ends, axis=0, return_counts=True)
    assert (times == 2).all()
