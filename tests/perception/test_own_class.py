"""Estimators that learn the class of a user's objects in addition to the classes that they know."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from piano_lids import CLASS, write_pianos

from gensim2.core.errors import InputError
from gensim2.core.seeding import rng
from gensim2.objects import open_library
from gensim2.objects.library.importer import import_object
from gensim2.perception.cloud import from_steps
from gensim2.perception.estimation import SceneEstimator
from gensim2.perception.estimation.network import OF_CLASSES, SceneNetwork, grown, losses
from gensim2.perception.estimation.training import EXAMPLES, Examples, train_estimator
from gensim2.policy.array_file import Arrays, read_arrays
from gensim2.robots import robot

PANDA = robot("panda")
KNOWN = ("box_rotate", "window_push")
FEW: dict[str, Any] = {"objects": 1, "looks": 2, "batch": 4, "steps": 1, "seed": 3}


@pytest.fixture(scope="module")
def known(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of an estimator of two generated classes after one step."""
    out = tmp_path_factory.mktemp("known") / "estimator"
    train_estimator(out, classes=KNOWN, **FEW)
    return out


@pytest.fixture(scope="module")
def pianos(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of four pianos, which no class of the package resembles by name."""
    folder = tmp_path_factory.mktemp("own")
    for number, file in enumerate(write_pianos(folder / "urdf", 4)):
        like = None if number == 0 else "0"
        import_object(file, folder / "library", CLASS, str(number), scale=1.0, like=like)
    return folder / "library"


@pytest.fixture(scope="module")
def extended(known: Path, pianos: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of an estimator that knows the class of the user's objects as well, after one step."""
    out = tmp_path_factory.mktemp("extended") / "estimator"
    found = train_estimator(out, classes=[CLASS], assets=pianos, start=known, others=2, **{**FEW, "objects": 4})
    assert found["classes"] == [*KNOWN, CLASS]
    return out


def examples(folder: Path, name: str) -> Arrays:
    """Return all examples of a class in the folder of an estimator."""
    files = [read_arrays(path) for path in sorted((folder / EXAMPLES).glob(f"{name}-*.npz"))]
    return {key: np.concatenate([each[key] for each in files]) for key in files[0]}


def test_a_new_class_gets_a_copy_of_the_most_similar_one() -> None:
    network = SceneNetwork(3)
    weights = network.state_dict()
    larger = SceneNetwork(5)
    larger.load_state_dict(grown(weights, [2, 0]))
    for name, each in larger.state_dict().items():
        if name in OF_CLASSES:
            assert torch.equal(each, weights[name][[0, 1, 2, 2, 0]])
        else:
            assert torch.equal(each, weights[name])


def test_the_extended_estimator_knows_all_classes(known: Path, pianos: Path, extended: Path) -> None:
    before, after = (SceneEstimator.load(each, PANDA) for each in (known, extended))
    assert after.classes[:2] == before.classes, "constants of the classes that it knew"
    own = after.classes[2]
    assert (own.name, own.joint_type, own.keypoints) == (
        CLASS,
        "revolute",
        ("articulated_object_head", "articulated_object_tail"),
    )
    uppers = [open_library(pianos).load_articulated(CLASS, str(number)).joint.upper for number in range(4)]
    assert own.span == pytest.approx((min(uppers), max(uppers)), abs=1e-4)
    # One step at a small learning rate hardly changes the weights. The piano has a hinge, so it starts as a box.
    first, last = (each.network.state_dict() for each in (before, after))
    for name, each in last.items():
        start = first[name][[0, 1, 0]] if name in OF_CLASSES else first[name]
        np.testing.assert_allclose(each, start, atol=2e-3)
    [found] = after.estimate(from_steps(examples(extended, CLASS)["points"][0]), CLASS).objects
    assert found.joint.type == "revolute"
    assert set(found.classes) == {*KNOWN, CLASS}


def test_the_other_classes_are_learned_from_generated_objects(extended: Path) -> None:
    """The package has these classes: two training objects and one calibration object of each, two looks each."""
    for name in KNOWN:
        arrays = examples(extended, name)
        assert len(arrays["class"]) == 3 * FEW["looks"]
        assert set(arrays["class"]) == {KNOWN.index(name)}
    # Of four objects, one serves the calibration.
    assert len(read_arrays(extended / EXAMPLES / f"{CLASS}-0.npz")["class"]) == 3 * FEW["looks"]
    assert len(read_arrays(extended / EXAMPLES / f"{CLASS}-1.npz")["class"]) == FEW["looks"]


def test_half_of_a_batch_shows_the_new_class_and_the_classifier_is_told(extended: Path) -> None:
    parts = [examples(extended, name) for name in (*KNOWN, CLASS)]
    arrays = {key: np.concatenate([each[key] for each in parts]) for key in parts[0]}
    batch = Examples(arrays, [False, False, True]).batch(rng(0, "shares"), 300)
    shares = np.bincount(batch["class"].numpy()) / 300
    np.testing.assert_allclose(shares, [0.25, 0.25, 0.5], atol=0.08)
    # A classifier that knows nothing prefers the new class by the square root of its share.
    np.testing.assert_allclose(batch["log_prior"].exp(), np.sqrt([0.25, 0.25, 0.5]), atol=1e-6)
    network = SceneNetwork(3)
    for parameter in network.classify.parameters():
        torch.nn.init.zeros_(parameter)
    few = {name: each if name == "log_prior" else each[:8] for name, each in batch.items()}
    chances, truth = np.sqrt([0.25, 0.25, 0.5]), few["class"].numpy()
    chances /= chances.sum()
    smoothed = 0.95 * -np.log(chances[truth]).mean() + 0.05 * -np.log(chances).mean()
    assert losses(network, few)["class"].item() == pytest.approx(smoothed, rel=1e-5)


def test_a_class_without_clouds_has_a_prior_too() -> None:
    arrays = {"class": np.array([0, 0, 1]), "group": np.zeros((3, 4), dtype=np.uint8)}
    prior = Examples(arrays, [True, False, False])._prior["log_prior"]
    np.testing.assert_allclose(prior.exp(), np.sqrt([0.5, 0.5, 1e-9]), rtol=1e-5)


def test_a_class_that_no_camera_sees_is_refused(known: Path, pianos: Path) -> None:
    """The pianos are 3 mm high."""
    library = pianos.parent / "tiny"
    for number, file in enumerate(write_pianos(pianos.parent / "tiny_urdf", 3)):
        import_object(file, library, CLASS, str(number), scale=0.01, like=None if number == 0 else "0")
    with pytest.raises(InputError, match=f"class {CLASS}: the cameras see none of its training objects"):
        train_estimator(
            pianos.parent / "unseen", classes=[CLASS], assets=library, start=known, others=1, **{**FEW, "objects": 3}
        )


def test_objects_that_cannot_be_learned_together_are_refused(known: Path, extended: Path, pianos: Path) -> None:
    out = pianos.parent / "refused"
    with pytest.raises(InputError, match=f"knows the class '{CLASS}', of which there are no objects"):
        train_estimator(out, classes=["faucet"], start=extended, **FEW)
    library = pianos.parent / "mixed"
    [file] = write_pianos(pianos.parent / "one", 1, seed=1)
    for name in "ab":
        import_object(file, library, CLASS, name, scale=1.0, keypoints={"keys_base": (0.0, 0.0, 0.1)})
    info = library / "articulated_objs" / CLASS / "b" / "info.json"
    info.write_text(info.read_text().replace("articulated_object_tail", "articulated_object_hinge"))
    with pytest.raises(InputError, match=r"b has the keypoints .*import --like"):
        train_estimator(out, classes=[CLASS], assets=library, start=known, **{**FEW, "objects": 3})
    import_object(file, pianos.parent / "boxes", "box_rotate", "a", scale=1.0)
    with pytest.raises(InputError, match=r"class box_rotate: .*give the class of your objects another name"):
        train_estimator(out, classes=["box_rotate"], assets=pianos.parent / "boxes", start=known, **FEW)
    assert not out.exists()
