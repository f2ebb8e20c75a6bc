"""Classes whose estimates are used for objects of classes that an estimator does not know."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import torch
from random_boxes import hinged, sliding

from gensim2.core.errors import InputError
from gensim2.core.seeding import rng
from gensim2.objects import ArticulatedObject, open_library
from gensim2.objects.library.importer import import_object
from gensim2.perception.estimation import PerceivingChain, SceneEstimator
from gensim2.perception.estimation.classes import ClassConstants
from gensim2.perception.estimation.estimator import ESTIMATOR_JSON
from gensim2.perception.estimation.examples import object_looks
from gensim2.perception.estimation.goal import GoalTracker
from gensim2.perception.estimation.network import TARGET, SceneNetwork
from gensim2.perception.estimation.training import train_estimator
from gensim2.robots import robot
from gensim2.scenes.footprint import keypoint_in_root

PANDA = robot("panda")
LIBRARY = open_library("builtin")
CLASSES = ("door", "oven", "window_push")


def untrained(stand_ins: tuple[str, ...], likely: str) -> SceneEstimator:
    """Return an estimator that takes every point for a part of an object, and prefers one class."""
    torch.manual_seed(0)
    network = SceneNetwork(len(CLASSES)).eval()
    models = [LIBRARY.load_articulated(name, "0") for name in CLASSES]
    with torch.no_grad():
        network.groups.bias[TARGET] = 100.0
        network.classify.bias[CLASSES.index(likely)] = 100.0
    return SceneEstimator(network, [ClassConstants.of(model) for model in models], PANDA, stand_ins=stand_ins)


def cloud_of(asset_class: str) -> np.ndarray:
    """Return the points of a generated object."""
    [look] = object_looks(LIBRARY, PANDA, asset_class, "7", 1, rng(0, "test"), noisy=0.0, accompanied=0.0)
    return look.cloud.xyz


@pytest.mark.parametrize(
    ("asset_class", "stand_ins", "likely", "expected"),
    [
        ("microwave", CLASSES, "oven", "oven"),
        # A microwave has a hinge, and so has a door.
        ("microwave", ("door", "window_push"), "window_push", "door"),
        ("drawer", CLASSES, "oven", "window_push"),
        # The package does not know which joint a gadget has.
        ("gadget", CLASSES, "oven", "oven"),
        ("gadget", CLASSES, "window_push", "window_push"),
    ],
)
def test_an_unknown_class_gets_the_likeliest_stand_in_with_its_joint(
    asset_class: str, stand_ins: tuple[str, ...], likely: str, expected: str
) -> None:
    tracker = GoalTracker(untrained(stand_ins, likely), {"thing": asset_class}, ())
    xyz = cloud_of("microwave")
    tracker.take_in(xyz)
    assert tracker.mismatch is None
    track = tracker.articulated["thing"].track
    assert track is not None
    assert track.found.asset_class == expected
    # The stand-in of the first cloud is kept in the episode.
    tracker.estimator.network.classify.bias.data[:] = torch.tensor([100.0, 0.0, 0.0])
    tracker.begin_motion()
    tracker.take_in(xyz)
    assert tracker.looks[-1].objects[0].asset_class == expected
    tracker.reset()
    tracker.take_in(xyz)
    assert tracker.looks[-1].objects[0].asset_class == ("window_push" if asset_class == "drawer" else "door")


def test_known_classes_have_no_stand_in_and_are_still_refused() -> None:
    """The network considers the cloud an oven, so it shows no door."""
    tracker = GoalTracker(untrained(("oven",), "oven"), {"thing": "door"}, ())
    tracker.take_in(cloud_of("microwave"))
    assert tracker.mismatch is not None
    assert tracker.mismatch["likeliest"] == "oven"
    with pytest.raises(InputError, match="does not know the class 'microwave'"):
        GoalTracker(untrained((), "oven"), {"thing": "microwave"}, ())


@pytest.mark.parametrize("moving", [[], [True, False]])
def test_a_class_with_too_few_or_too_many_moving_flags_is_refused(tmp_path: Path, moving: list[bool]) -> None:
    untrained((), "oven").save(tmp_path)
    file = tmp_path / ESTIMATOR_JSON
    record = json.loads(file.read_text())
    assert len(record["classes"][1]["keypoints"]) == 1
    record["classes"][1]["moving"] = moving
    file.write_text(json.dumps(record))
    message = rf"estimator.json: classes\.1\.moving: needs 1 value, one for each keypoint, not {len(moving)} "
    with pytest.raises(InputError, match=message):
        SceneEstimator.load(tmp_path, PANDA)


def test_unknown_stand_ins_in_a_file_are_refused(tmp_path: Path) -> None:
    untrained(("oven",), "oven").save(tmp_path)
    file = tmp_path / ESTIMATOR_JSON
    file.write_text(file.read_text().replace('"stand_ins": [\n    "oven"', '"stand_ins": [\n    "drawer"'))
    with pytest.raises(InputError, match=r"estimator.json: stand_ins: the estimator has no class 'drawer'"):
        SceneEstimator.load(tmp_path, PANDA)


def test_stand_ins_are_saved_and_inherited(tmp_path: Path) -> None:
    untrained(("oven",), "oven").save(tmp_path / "first")
    assert [each.name for each in SceneEstimator.load(tmp_path / "first", PANDA).stand_ins] == ["oven"]
    few = {"classes": ["window_push"], "others": 1, "objects": 1, "looks": 1, "batch": 2, "steps": 1}
    with pytest.raises(InputError, match="does not know the class 'drawer'"):
        train_estimator(tmp_path / "none", start=tmp_path / "first", stand_ins=["drawer"], **few)  # type: ignore
    train_estimator(tmp_path / "next", start=tmp_path / "first", stand_ins=["window_push"], **few)  # type: ignore
    assert [each.name for each in SceneEstimator.load(tmp_path / "next", PANDA).stand_ins] == ["oven", "window_push"]
    PerceivingChain("CloseMicrowave", str(tmp_path / "next"))


def test_random_boxes_are_objects_whose_head_moves(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GENSIM2_CACHE", str(tmp_path / "cache"))
    generator = np.random.default_rng(3)
    for name, make, kind in (("any_hinged", hinged, "revolute"), ("any_sliding", sliding, "prismatic")):
        for number in range(3):
            thing = make(generator)
            file = tmp_path / f"{name}_{number}.urdf"
            file.write_text(thing.urdf())
            head = np.subtract(thing.head, thing.origin).tolist()
            import_object(file, tmp_path / "library", name, str(number), scale=1.0, keypoints={"head": head})
            model: ArticulatedObject = open_library(tmp_path / "library").load_articulated(name, str(number))
            assert model.joint.type == kind
            first, last = (
                keypoint_in_root(model, "articulated_object_head", value)
                for value in (model.joint.lower, model.joint.upper)
            )
            np.testing.assert_allclose(first, thing.head, atol=1e-3)
            # Doors and drawers open towards the robot, and lids upwards.
            assert max(first[0] - last[0], last[2] - first[2]) > 0.04
