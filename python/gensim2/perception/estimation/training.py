"""Train an estimator on generated objects (``gensim2 perceive train``)."""

from __future__ import annotations

import copy
import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
import numpy.typing as npt
import torch
from pydantic import Field

from gensim2.core.errors import InputError
from gensim2.core.progress import NULL_PROGRESS, Progress
from gensim2.core.resumable import ResumableFolder, RunSettings
from gensim2.core.seeding import rng
from gensim2.objects import Library, open_library
from gensim2.perception.cloud import from_steps
from gensim2.perception.estimation.classes import ClassConstants, by_name
from gensim2.perception.estimation.deformation import deformed
from gensim2.perception.estimation.estimator import SceneEstimator
from gensim2.perception.estimation.examples import Example, example, object_looks, stacked, training_instances
from gensim2.perception.estimation.measuring import calibrated
from gensim2.perception.estimation.network import TARGET, WEIGHTS, SceneNetwork, features_of, grown, losses
from gensim2.perception.estimation.presence import connected_extent
from gensim2.policy.array_file import Arrays, read_arrays, write_arrays
from gensim2.policy.config import TrainConfig
from gensim2.policy.train import optimizer_of, take_steps
from gensim2.policy.train_state import STATE_JSON, Identity, TrainState
from gensim2.robots import DEFAULT_ROBOT, RobotProfile, robot

MARKER = "perceive.json"
EXAMPLES, TRAINING = "examples", "training"
OBJECTS_A_FILE = 4
COMPARED = 16
"""Number of clouds of a new class by which the most similar class is found."""
CALIBRATION = 3
"""Number of additional objects of each class with which the predicted deviations are calibrated."""
LEAST_QUANTILE = 0.02
"""Quantile of the visible extents of a class's training objects that counts as the smallest one."""
OTHER_LOOKS = 4
"""Maximum number of clouds of each object of the other classes, so that they have many different objects."""
TRAINED_SHARE = 0.5
"""Fraction of the clouds in a training step that show the trained classes, if a training adds classes to an
estimator."""
PRIOR = 0.5
"""Weight of the frequency of a class in the loss of the classes: with 1, a short training does not learn to recognize
the trained classes, and with 0, it takes similar objects of other classes for them.
"""
LEARNING_RATE, GENTLE_RATE = 1.5e-3, 5e-4
"""Maximum learning rate, and maximum learning rate of a training that should keep what the estimator knows."""
ROOM = 1_000_000
"""Maximum number of clouds of a training run; this number of clouds takes 14 GB of memory."""
VOTERS = 384
"""Number of points in each cloud whose votes are computed in a training step."""
MOST_TURN, MOST_SHIFT = 0.4, 0.06
"""Maximum random yaw (rad) about the robot's base and shift (m) along the table of training clouds."""


class PerceiveSettings(RunSettings):
    """Settings of a training run. These settings determine the weights of the trained estimator."""

    FREE: ClassVar[frozenset[str]] = frozenset()

    schema_version: Literal[1] = 1
    classes: tuple[str, ...]
    assets: str
    robot: str
    objects: int
    objects_of: dict[str, int] = Field(default_factory=dict)
    others: int | None = None
    looks: int
    steps: int
    batch: int
    seed: int
    start: str | None = None
    stand_ins: tuple[str, ...] = ()


def train_estimator(
    out: Path,
    *,
    classes: Sequence[str] = (),
    assets: Path | str | None = "builtin",
    robot_name: str = DEFAULT_ROBOT,
    objects: int = 60,
    objects_of: Mapping[str, int] | None = None,
    others: int = 4,
    looks: int = 12,
    steps: int = 4000,
    batch: int = 24,
    seed: int = 0,
    start: Path | str | None = None,
    stand_ins: Sequence[str] = (),
    resume: bool = False,
    progress: Progress = NULL_PROGRESS,
) -> dict[str, Any]:
    """Generate labelled clouds, train an estimator, and calibrate the standard deviations that it predicts.

    Args:
        out: folder for the examples, the state of the training run and the estimator (``estimator.json`` and
            ``weights-*.safetensors``).
        classes: classes of articulated objects; empty: all classes of the library.
        assets: library of the objects, as for :func:`~gensim2.objects.open_library`.
        robot_name: name of the robot in the scenes.
        objects: number of training objects of each class; a class with fewer objects uses all of them.
        objects_of: number of training objects of single classes, by class, instead of ``objects``.
        others: number of training objects of each class that the estimator ``start`` knows and ``classes`` does not
            contain. These objects are generated objects if the package has the class; otherwise they come from
            ``assets``.
        looks: number of clouds of each object.
        steps: number of gradient steps.
        batch: number of clouds in a gradient step.
        seed: seed of all random values.
        start: estimator with the initial weights, as for :meth:`SceneEstimator.load`; None: random initial weights.
            The trained estimator knows the classes of this estimator and ``classes``. A class that is new starts with
            the weights of the most similar class.
        stand_ins: classes whose estimates are used for objects of unknown classes, in addition to those of ``start``.
        resume: whether to continue the training run in ``out``.
        progress: listener.

    Returns:
        Plain data: folder, number of clouds, loss, CPU time of the gradient steps (s), and calibration.

    Raises:
        InputError: a class is unknown or rigid, the objects of a class have different keypoints, ``objects_of`` or
            ``stand_ins`` names a class that is not trained, ``out`` contains a different training run, there are no
            objects of a class of the estimator ``start``, or the cameras see no training object of a class.
    """
    library, profile = open_library(assets), robot(robot_name)
    names = tuple(classes) or tuple(name for name in library.classes() if library.kind(name) == "articulated")
    for name in names:
        library.check_kind(name, "articulated")
    first = None if start is None else SceneEstimator.load(start, profile)
    known = {} if first is None else {each.name: each for each in first.classes}
    others_of = tuple(name for name in known if name not in names)
    counts = dict.fromkeys(names, objects) | dict(objects_of or {})
    for name in counts:
        if name not in names:
            remedy = f"choose from {', '.join(names)}"
            raise InputError(f"the class {name!r} is not trained", field="objects_of", remedy=remedy)
    clouds = sum(counts.values()) * looks + len(others_of) * others * min(looks, OTHER_LOOKS)
    if clouds > ROOM:
        message = f"the training set would have {clouds} clouds; the maximum is {ROOM}"
        raise InputError(message, field="objects", remedy="reduce objects or looks")
    work = [_Class(name, library, counts[name], CALIBRATION, looks, known.get(name)) for name in names]
    work += [_other(known[name], library, others, looks) for name in others_of]
    order = [*known, *(name for name in names if name not in known)]
    work.sort(key=lambda each: order.index(each.name))
    constants = [each.constants(seed) for each in work]
    for name in stand_ins:
        by_name(constants, name)
    inherited = [] if first is None else [each.name for each in first.stand_ins]
    settings = PerceiveSettings(
        classes=names,
        assets=str(library.location),
        robot=robot_name,
        objects=objects,
        objects_of=dict(objects_of or {}),
        others=others if others_of else None,
        looks=looks,
        steps=steps,
        batch=batch,
        seed=seed,
        start=None if start is None else str(start),
        stand_ins=tuple(stand_ins),
    )
    with ResumableFolder(out, MARKER, settings, holds="a training of an estimator", resume=resume):
        learned, arrays, held_out = _examples(work, constants, profile, seed, out / EXAMPLES, progress)
        rate = LEARNING_RATE if set(names) == set(known) or not known else GENTLE_RATE
        training = TrainConfig(steps=steps, batch=batch, seed=seed, ema=0.99, learning_rate=rate)
        torch.set_num_threads(training.threads)
        torch.manual_seed(seed)
        network = SceneNetwork(len(work))
        initial: dict[str, str] = {}
        if first is not None:
            weights = first.network.state_dict()
            similar = [_most_similar(first, arrays, row, learned[row]) for row in range(len(known), len(work))]
            network.load_state_dict(grown(weights, similar))
            initial["start"] = hashlib.sha256(b"".join(each.numpy().tobytes() for each in weights.values())).hexdigest()
        state = TrainState(network, copy.deepcopy(network).eval(), optimizer_of(network, training))
        digest = hashlib.sha256(b"".join(arrays[name].tobytes() for name in sorted(arrays))).hexdigest()
        identity = Identity(
            {"policy": {"classes": order}, "training": training.to_dict(), "data": {"digest": digest}} | initial
        )
        if (out / TRAINING / STATE_JSON).exists():
            state.load(out / TRAINING, identity)
        source = Examples(arrays, [name in names for name in order] if others_of else None)

        def gradients(step: int) -> float:
            found = losses(network, source.batch(rng(seed, "perception/step", step), batch))
            total = sum((WEIGHTS[name] * value for name, value in found.items()), torch.zeros(()))
            network.zero_grad(set_to_none=True)
            total.backward()
            return float(total.detach())

        loss = take_steps(state, gradients, training, out / TRAINING, identity, progress)
        estimator = SceneEstimator(copy.deepcopy(state.average).eval(), learned, profile)
        estimator.stand_ins = tuple(each for each in learned if each.name in {*inherited, *stand_ins})
        changed = [
            deformed(_example_of(held_out, row), rng(seed, "perception/calibration", row))
            for row in range(len(held_out["class"]))
        ]
        calibration = calibrated(estimator, stacked(changed))
        estimator.save(out)
    return {
        "schema_version": 1,
        "folder": str(out),
        "classes": order,
        "clouds": len(arrays["class"]),
        "steps": state.step,
        "cpu_s": round(state.cpu_s, 1),
        "loss": loss,
        "parameters": sum(each.numel() for each in network.parameters()),
        "calibration": calibration,
    }


@dataclass(frozen=True)
class _Class:
    """Class of which clouds are made.

    Attributes:
        name: name of the class.
        library: library of its objects.
        objects, calibration: number of training objects and of calibration objects.
        looks: number of clouds of each object.
        known: constants of the class in the estimator with which the training starts; None if it is new.
        is_other: whether the class is only kept, so that its constants do not change.
    """

    name: str
    library: Library
    objects: int
    calibration: int
    looks: int
    known: ClassConstants | None
    is_other: bool = False

    def instances(self, seed: int) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Return the ids of the training objects and of the calibration objects."""
        count = self.objects + self.calibration
        ids = training_instances(self.library, {self.name: count}, seed)[self.name]
        # If the library has too few objects, most of them are training objects.
        kept = self.objects if len(ids) == count else max(len(ids) - min(self.calibration, len(ids) // 4), 1)
        return ids[:kept], ids[kept:]

    def constants(self, seed: int) -> ClassConstants:
        """Return the constants of the class, without those that follow from the clouds.

        Raises:
            InputError: two objects of the class have different keypoints, or the known class has other keypoints.
        """
        training, calibration = self.instances(seed)
        # All generated objects of a class have the same keypoints.
        ids = (*training, *calibration) if self.library.source(self.name) == "real" else training[:1]
        models = [self.library.load_articulated(self.name, each) for each in ids]
        found = ClassConstants.of(max(models, key=lambda model: len(model.keypoints)))
        for model in models:
            names = tuple(model.keypoints)
            if names != found.keypoints[: len(names)]:
                message = f"the object {model.id} has the keypoints {', '.join(names)}, but another object has"
                remedy = (
                    f"state the keypoints of one object, and import the others: gensim2 assets import --like {ids[0]}"
                )
                raise InputError(f"{message} {', '.join(found.keypoints)}", field=f"class {self.name}", remedy=remedy)
        if self.known is not None and (found.keypoints, found.joint_type) != (
            self.known.keypoints,
            self.known.joint_type,
        ):
            message = f"its objects have a {found.joint_type} joint and the keypoints {', '.join(found.keypoints)}, but"
            message += f" the estimator has a {self.known.joint_type} joint and {', '.join(self.known.keypoints)}"
            raise InputError(message, field=f"class {self.name}", remedy="give the class of your objects another name")
        return found if self.known is None else self.known


def _other(known: ClassConstants, library: Library, objects: int, looks: int) -> _Class:
    """Return a class that the estimator knows and that is not to be forgotten."""
    generated = open_library("builtin")
    source = generated if known.name in generated.classes() else library
    if known.name not in source.classes():
        message = f"the estimator knows the class {known.name!r}, of which there are no objects"
        raise InputError(message, field="assets", remedy="add the folder of its objects to the folder of --assets")
    return _Class(known.name, source, objects, 1, min(looks, OTHER_LOOKS), known, is_other=True)


def _examples(
    classes: Sequence[_Class],
    before: Sequence[ClassConstants],
    profile: RobotProfile,
    seed: int,
    folder: Path,
    progress: Progress,
) -> tuple[tuple[ClassConstants, ...], Arrays, Arrays]:
    """Return class constants, training examples and calibration examples; generate examples that are missing. The
    constants ``before`` are completed with the joint ranges and extents of the examples.

    Raises:
        InputError: the cameras see none of the training objects of a class.
    """
    names = [each.name for each in classes]
    instances = [each.instances(seed) for each in classes]
    constants = list(before)
    training: list[Arrays] = []
    held_out: list[Arrays] = []
    progress.start("looking at objects", sum(-(-len(ids) // OBJECTS_A_FILE) + 1 for ids, _ in instances))
    for row, (each, (kept, last)) in enumerate(zip(classes, instances, strict=True)):
        ranges, extents = [], []
        groups = [kept[first : first + OBJECTS_A_FILE] for first in range(0, len(kept), OBJECTS_A_FILE)]
        for number, group in enumerate([*groups, last]):
            found = _file_of(each, profile, seed, folder / f"{each.name}-{number}.npz", names, group)
            if found is not None:
                (held_out if number == len(groups) else training).append(found)
                ranges.append(np.ptp(found["limits"], axis=1))
                extents += _extents(found)
            progress.advance()
        if not training or row not in training[-1]["class"]:
            remedy = f"check the size of its objects: gensim2 assets show {each.name}/{kept[0]}"
            raise InputError("the cameras see none of its training objects", field=f"class {each.name}", remedy=remedy)
        if not each.is_other:
            constants[row] = constants[row].over(np.concatenate(ranges), float(np.quantile(extents, LEAST_QUANTILE)))
    return tuple(constants), _joined(training), _joined(held_out or training[:1])


def _extents(examples: Arrays) -> list[float]:
    """Return the extent (m) of the visible part of the object in each example."""
    return [
        connected_extent(from_steps(points)[group == TARGET])
        for points, group in zip(examples["points"], examples["group"], strict=True)
    ]


def _file_of(
    kind: _Class, profile: RobotProfile, seed: int, path: Path, classes: Sequence[str], ids: Sequence[str]
) -> Arrays | None:
    """Return the examples of the objects ``ids``. Read them from the file ``path`` if it exists; otherwise generate
    them and write the file. Return None if the cameras see none of the objects.
    """
    if path.exists():
        return read_arrays(path)
    found: list[Example] = []
    for each in ids:
        generator = rng(seed, f"perception/{kind.name}/{each}")
        for look in object_looks(kind.library, profile, kind.name, each, kind.looks, generator):
            arrays = example(look, classes, profile)
            arrays["features"] = np.rint(127 * features_of(look.cloud.xyz)).astype(np.int8)
            found.append(arrays)
    if not found:
        return None
    write_arrays(path, stacked(found))
    return read_arrays(path)


def _joined(parts: Sequence[Arrays]) -> Arrays:
    if not parts:
        raise InputError("the cameras see none of the objects", field="classes", remedy="give other classes")
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def _example_of(arrays: Arrays, row: int) -> Example:
    return {name: values[row] for name, values in arrays.items()}


def _most_similar(estimator: SceneEstimator, arrays: Arrays, number: int, kind: ClassConstants) -> int:
    """Return the index of the class that the estimator considers most probable in the clouds of a new class, among the
    classes with the same type of joint. If the estimator knows no such class, consider all classes.

    Args:
        estimator: estimator that does not know the class.
        arrays: labelled clouds.
        number: index of the new class in ``arrays``.
        kind: constants of the new class.
    """
    rows = np.flatnonzero(arrays["class"] == number)
    total = np.zeros(len(estimator.classes))
    for row in rows[:: max(len(rows) // COMPARED, 1)]:
        for found in estimator.estimate(from_steps(arrays["points"][row])).objects:
            total += list(found.classes.values())
    alike = np.array([each.joint_type == kind.joint_type for each in estimator.classes])
    return int(np.argmax(np.where(alike, total, -1.0) if alike.any() else total))


class Examples:
    """Samples batches of labelled clouds.

    Args:
        arrays: arrays with one row for each labelled cloud: the arrays that
            :func:`~gensim2.perception.estimation.examples.example` returns, and the array ``features`` (..., N, 5).
            This array contains the points' features times 127 as int8.
        trained: for each class, whether the class is trained. The trained classes get the fraction ``TRAINED_SHARE`` of
            a batch, and the other classes share the rest. The loss of the classes then takes into account how often
            each class is sampled, so that the network prefers the trained classes less. None: no class is preferred.
    """

    def __init__(self, arrays: Arrays, trained: Sequence[bool] | None = None) -> None:
        self._arrays = arrays
        _, number, counts = np.unique(arrays["class"], return_inverse=True, return_counts=True)
        self._chance = 1.0 / np.sqrt(counts[number])
        self._chance /= self._chance.sum()
        self._prior: dict[str, torch.Tensor] = {}
        if trained is not None:
            preferred = np.array(trained)[arrays["class"]]
            for rows, share in ((preferred, TRAINED_SHARE), (~preferred, 1.0 - TRAINED_SHARE)):
                self._chance[rows] *= share / self._chance[rows].sum()
            shares = np.bincount(arrays["class"], self._chance, minlength=len(trained))
            self._prior["log_prior"] = PRIOR * torch.from_numpy(np.log(np.maximum(shares, 1e-9))).float()

    def batch(self, generator: np.random.Generator, size: int) -> dict[str, torch.Tensor]:
        """Sample a batch, and deform, rotate and shift each cloud at random.

        The probability of a class is proportional to the square root of its number of clouds, apart from the preferred
        classes.
        """
        rows = generator.choice(len(self._chance), size, p=self._chance)
        turn = generator.uniform(-MOST_TURN, MOST_TURN, size)
        shift = np.concatenate([generator.uniform(-MOST_SHIFT, MOST_SHIFT, (size, 2)), np.zeros((size, 1))], axis=1)
        arrays = stacked([deformed(_example_of(self._arrays, row), generator) for row in rows])
        # Select the points in random order, but favour points of the object, so that every selection contains
        # object points.
        order = generator.random(arrays["group"].shape) - 0.5 * (arrays["group"] == TARGET)
        chosen = torch.from_numpy(np.argsort(order, axis=1)[:, :VOTERS])
        return {**tensors(arrays, turn, shift), "rows": chosen, **self._prior}


def tensors(arrays: Arrays, turn: npt.NDArray[np.float64], shift: npt.NDArray[np.float64]) -> dict[str, torch.Tensor]:
    """Rotate and shift each cloud, and return the examples as tensors. ``turn`` (B,) contains the rotation angle of
    each cloud about the z axis of the base frame, rad. ``shift`` (B, 3) contains the shift (m) that follows the
    rotation.
    """
    cos, sin = np.cos(turn), np.sin(turn)
    R = np.zeros((len(turn), 3, 3))
    R[:, 0, 0], R[:, 0, 1], R[:, 1, 0], R[:, 1, 1], R[:, 2, 2] = cos, -sin, sin, cos, 1.0
    xyz, features = from_steps(arrays["points"]), arrays["features"].astype(np.float32) / 127
    normals = np.einsum("bij,bnj->bni", R, features[..., :3])
    yaw = arrays["yaw"]
    found = {
        "xyz": np.einsum("bij,bnj->bni", R, xyz) + shift[:, None],
        "features": np.concatenate([normals, features[..., 3:]], -1),
        "axis": np.einsum("bij,bj->bi", R, arrays["axis"]),
        "origin": np.einsum("bij,bj->bi", R, arrays["origin"]) + shift,
        "keypoints": np.einsum("bij,bnj->bni", R, arrays["keypoints"]) + shift[:, None],
        "yaw": np.einsum("bij,bj->bi", R[:, :2, :2], yaw),
        **{name: arrays[name] for name in ("openness", "limits", "size", "moving", "known", "revolute")},
    }
    return {name: torch.from_numpy(np.asarray(each, dtype=np.float32)) for name, each in found.items()} | {
        name: torch.from_numpy(arrays[name].astype(np.int64)) for name in ("group", "class", "direction")
    }
