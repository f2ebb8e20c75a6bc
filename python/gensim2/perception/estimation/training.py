"""Train an estimator on generated objects (``gensim2 perceive train``)."""

from __future__ import annotations

import copy
import hashlib
from collections.abc import Mapping, Sequence
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
from gensim2.objects import ArticulatedObject, Library, open_library
from gensim2.perception.cloud import from_steps
from gensim2.perception.estimation.classes import ClassConstants
from gensim2.perception.estimation.deformation import deformed
from gensim2.perception.estimation.estimator import SceneEstimator
from gensim2.perception.estimation.examples import Example, example, object_looks, stacked, training_instances
from gensim2.perception.estimation.measuring import calibrated
from gensim2.perception.estimation.network import TARGET, WEIGHTS, SceneNetwork, features_of, losses
from gensim2.perception.estimation.presence import connected_extent
from gensim2.policy.array_file import Arrays, read_arrays, write_arrays
from gensim2.policy.config import TrainConfig
from gensim2.policy.train import optimizer_of, take_steps
from gensim2.policy.train_state import STATE_JSON, Identity, TrainState
from gensim2.robots import DEFAULT_ROBOT, RobotProfile, robot

MARKER = "perceive.json"
EXAMPLES, TRAINING = "examples", "training"
OBJECTS_A_FILE = 4
CALIBRATION = 3
"""Number of additional objects of each class with which the predicted deviations are calibrated."""
LEAST_QUANTILE = 0.02
"""Quantile of the visible extents of a class's training objects that counts as the smallest one."""
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
    looks: int
    steps: int
    batch: int
    seed: int
    start: str | None = None


def train_estimator(
    out: Path,
    *,
    classes: Sequence[str] = (),
    assets: Path | str | None = "builtin",
    robot_name: str = DEFAULT_ROBOT,
    objects: int = 60,
    objects_of: Mapping[str, int] | None = None,
    looks: int = 12,
    steps: int = 4000,
    batch: int = 24,
    seed: int = 0,
    start: Path | str | None = None,
    resume: bool = False,
    progress: Progress = NULL_PROGRESS,
) -> dict[str, Any]:
    """Generate labelled clouds, train an estimator, and calibrate the standard deviations that it predicts.

    Args:
        out: folder for the examples, the state of the training run and the estimator (``config.json`` and
            ``weights.safetensors``).
        classes: classes of articulated objects; empty: all classes of the library.
        assets: library of the objects, as for :func:`~gensim2.objects.open_library`.
        robot_name: name of the robot in the scenes.
        objects: number of training objects of each class; a class with fewer objects uses all of them.
        objects_of: number of training objects of single classes, by class, instead of ``objects``.
        looks: number of clouds of each object.
        steps: number of gradient steps.
        batch: number of clouds in a gradient step.
        seed: seed of all random values.
        start: estimator with the initial weights, as for :meth:`SceneEstimator.load`; None: random initial weights.
        resume: whether to continue the training run in ``out``.
        progress: listener.

    Returns:
        Plain data: folder, number of clouds, loss, CPU time of the gradient steps (s), and calibration.

    Raises:
        InputError: a class is unknown or rigid, ``objects_of`` names a class that is not trained, ``out`` contains a
            different training run, or the estimator ``start`` has other classes.
    """
    library, profile = open_library(assets), robot(robot_name)
    names = tuple(classes) or tuple(name for name in library.classes() if library.kind(name) == "articulated")
    for name in names:
        library.check_kind(name, "articulated")
    counts = dict.fromkeys(names, objects) | dict(objects_of or {})
    for name in counts:
        if name not in names:
            remedy = f"choose from {', '.join(names)}"
            raise InputError(f"the class {name!r} is not trained", field="objects_of", remedy=remedy)
    if sum(counts.values()) * looks > ROOM:
        message = f"the training set would have {sum(counts.values()) * looks} clouds; the maximum is {ROOM}"
        raise InputError(message, field="objects", remedy="reduce objects or looks")
    settings = PerceiveSettings(
        classes=names,
        assets=str(library.location),
        robot=robot_name,
        objects=objects,
        objects_of=dict(objects_of or {}),
        looks=looks,
        steps=steps,
        batch=batch,
        seed=seed,
        start=None if start is None else str(start),
    )
    with ResumableFolder(out, MARKER, settings, holds="a training of an estimator", resume=resume):
        constants, arrays, held_out = _examples(library, profile, settings, out / EXAMPLES, progress)
        training = TrainConfig(steps=steps, batch=batch, seed=seed, ema=0.99, learning_rate=1.5e-3)
        torch.set_num_threads(training.threads)
        torch.manual_seed(seed)
        network = SceneNetwork(len(names))
        initial: dict[str, str] = {}
        if start is not None:
            weights = _initial(start, names, profile).state_dict()
            network.load_state_dict(weights)
            initial["start"] = hashlib.sha256(b"".join(each.numpy().tobytes() for each in weights.values())).hexdigest()
        state = TrainState(network, copy.deepcopy(network).eval(), optimizer_of(network, training))
        digest = hashlib.sha256(b"".join(arrays[name].tobytes() for name in sorted(arrays))).hexdigest()
        identity = Identity(
            {"policy": {"classes": list(names)}, "training": training.to_dict(), "data": {"digest": digest}} | initial
        )
        if (out / TRAINING / STATE_JSON).exists():
            state.load(out / TRAINING, identity)
        source = Examples(arrays)

        def gradients(step: int) -> float:
            found = losses(network, source.batch(rng(seed, "perception/step", step), batch))
            total = sum((WEIGHTS[name] * value for name, value in found.items()), torch.zeros(()))
            network.zero_grad(set_to_none=True)
            total.backward()
            return float(total.detach())

        loss = take_steps(state, gradients, training, out / TRAINING, identity, progress)
        estimator = SceneEstimator(copy.deepcopy(state.average).eval(), constants, profile)
        changed = [
            deformed(_example_of(held_out, row), rng(seed, "perception/calibration", row))
            for row in range(len(held_out["class"]))
        ]
        calibration = calibrated(estimator, stacked(changed))
        estimator.save(out)
    return {
        "schema_version": 1,
        "folder": str(out),
        "classes": list(names),
        "clouds": len(arrays["class"]),
        "steps": state.step,
        "cpu_s": round(state.cpu_s, 1),
        "loss": loss,
        "parameters": sum(each.numel() for each in network.parameters()),
        "calibration": calibration,
    }


def _examples(
    library: Library, profile: RobotProfile, settings: PerceiveSettings, folder: Path, progress: Progress
) -> tuple[tuple[ClassConstants, ...], Arrays, Arrays]:
    """Return class constants, training examples and calibration examples; generate examples that are missing."""
    counts = {name: settings.objects_of.get(name, settings.objects) + CALIBRATION for name in settings.classes}
    instances = training_instances(library, counts, settings.seed)
    constants: list[ClassConstants] = []
    training: list[Arrays] = []
    held_out: list[Arrays] = []
    progress.start("looking at objects", sum(-(-len(ids) // OBJECTS_A_FILE) for ids in instances.values()))
    for name, ids in instances.items():
        model = library.load(name, ids[0], "default")
        assert isinstance(model, ArticulatedObject)
        constants.append(ClassConstants.of(model))
        kept, ranges = max(len(ids) - CALIBRATION, 1), []
        extents: list[float] = []
        groups = [ids[first : min(first + OBJECTS_A_FILE, kept)] for first in range(0, kept, OBJECTS_A_FILE)]
        for number, group in enumerate([*groups, ids[kept:]]):
            found = _file_of(library, profile, settings, folder / f"{name}-{number}.npz", name, group)
            if found is not None:
                (held_out if number == len(groups) else training).append(found)
                ranges.append(np.ptp(found["limits"], axis=1))
                extents += _extents(found)
            progress.advance()
        if ranges:
            spans = np.concatenate(ranges).astype(np.float64)
            span, least = (float(spans.min()), float(spans.max())), float(np.quantile(extents, LEAST_QUANTILE))
            # A class whose objects the cameras hardly see has no smallest extent.
            constants[-1] = constants[-1].model_copy(update={"span": span, "least_extent": least or None})
    return tuple(constants), _joined(training), _joined(held_out or training[:1])


def _extents(examples: Arrays) -> list[float]:
    """Return the extent (m) of the visible part of the object in each example."""
    return [
        connected_extent(from_steps(points)[group == TARGET])
        for points, group in zip(examples["points"], examples["group"], strict=True)
    ]


def _file_of(
    library: Library, profile: RobotProfile, settings: PerceiveSettings, path: Path, name: str, ids: Sequence[str]
) -> Arrays | None:
    """Return the examples of the objects ``ids``. Read them from the file ``path`` if it exists; otherwise generate
    them and write the file. Return None if the cameras see none of the objects.
    """
    if path.exists():
        return read_arrays(path)
    found: list[Example] = []
    for each in ids:
        generator = rng(settings.seed, f"perception/{name}/{each}")
        for look in object_looks(library, profile, name, each, settings.looks, generator):
            arrays = example(look, settings.classes, profile)
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


def _initial(start: Path | str, names: Sequence[str], profile: RobotProfile) -> SceneNetwork:
    """Return the network of the estimator ``start``, which must know exactly the classes ``names``."""
    found = SceneEstimator.load(start, profile)
    known = [each.name for each in found.classes]
    if known != list(names):
        message = f"{start}: the classes of the estimator differ from the classes of the training"
        raise InputError(message, field="start", remedy=f"train exactly the classes {', '.join(known)}")
    return found.network


class Examples:
    """Samples batches of labelled clouds.

    Args:
        arrays: arrays with one row for each labelled cloud: the arrays that
            :func:`~gensim2.perception.estimation.examples.example` returns, and the array ``features`` (..., N, 5).
            This array contains the points' features times 127 as int8.
    """

    def __init__(self, arrays: Arrays) -> None:
        self._arrays = arrays
        _, number, counts = np.unique(arrays["class"], return_inverse=True, return_counts=True)
        self._chance = 1.0 / np.sqrt(counts[number])
        self._chance /= self._chance.sum()

    def batch(self, generator: np.random.Generator, size: int) -> dict[str, torch.Tensor]:
        """Sample a batch, and deform, rotate and shift each cloud at random.

        The probability of a class is proportional to the square root of its number of clouds.
        """
        rows = generator.choice(len(self._chance), size, p=self._chance)
        turn = generator.uniform(-MOST_TURN, MOST_TURN, size)
        shift = np.concatenate([generator.uniform(-MOST_SHIFT, MOST_SHIFT, (size, 2)), np.zeros((size, 1))], axis=1)
        arrays = stacked([deformed(_example_of(self._arrays, row), generator) for row in rows])
        # Select the points in random order, but favour points of the object, so that every selection contains
        # object points.
        order = generator.random(arrays["group"].shape) - 0.5 * (arrays["group"] == TARGET)
        chosen = torch.from_numpy(np.argsort(order, axis=1)[:, :VOTERS])
        return {**tensors(arrays, turn, shift), "rows": chosen}


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
