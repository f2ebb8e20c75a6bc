"""Define the neural network of the estimator. A transformer over local patches of the cloud computes a feature for each
point. Each point then predicts the positions of the keypoints, and a weighted mean combines the predictions.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import torch
from scipy.spatial import cKDTree
from torch import nn

from gensim2.perception.estimation.classes import DIRECTIONS, SLOTS
from gensim2.policy.encoders.grouping import farthest_points, gathered, interpolated, squared_distances
from gensim2.policy.trunk import Block

CHANNELS = 8
"""Number of input channels of a point: position, normal, and two eigenvalue ratios of its neighbourhood."""
NEIGHBORS = 16
"""Number of neighbours from which the normal of a point is computed."""
ANCHORS, PATCH = 96, 24
SCALE = 0.25
"""Length that the value 1 represents inside the network, m."""
WIDTH, LAYERS, HEADS = 96, 3, 4
POINT = 64
"""Width of a point's feature before the transformer."""
STRAY, OTHER, TARGET = GROUPS = 0, 1, 2
"""Groups of points: stray points, points on rigid objects, points on the articulated object."""
LEAST, MOST = -6.0, 1.0
"""Bounds of the logarithms of predicted standard deviations."""


def features_of(xyz: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """Return features (N, 5) of points (N, 3): a normal directed away from the cloud's centre, and two curvatures."""
    _, rows = cKDTree(xyz).query(xyz, k=min(NEIGHBORS, len(xyz)))
    near = xyz[rows] - xyz[rows].mean(1, keepdims=True)
    values, vectors = np.linalg.eigh(np.einsum("nki,nkj->nij", near, near) + 1e-12 * np.eye(3, dtype=np.float32))
    normals = vectors[:, :, 0]
    outward = xyz - np.median(xyz, axis=0)
    normals = normals * np.where((normals * outward).sum(1, keepdims=True) < 0, -1.0, 1.0)
    ratios = values[:, :2] / np.maximum(values[:, 2:], 1e-9)
    return np.concatenate([normals, ratios], axis=1).astype(np.float32)


@dataclass(frozen=True)
class EncodedCloud:
    """Output of the network for B clouds, before the points of an object are selected.

    Attributes:
        xyz: (B, N, 3) points in the base frame, m.
        features: (B, N, F) features of the points.
        context: (B, W) feature of the complete cloud.
        group: (B, N, 3) logits of each point's group (``STRAY``, ``OTHER`` or ``TARGET``).
        weight: (B, N) logits of each point's weight in the mean of the features over an object's points.
    """

    xyz: torch.Tensor
    features: torch.Tensor
    context: torch.Tensor
    group: torch.Tensor
    weight: torch.Tensor


class SceneNetwork(nn.Module):  # type: ignore[misc]
    """Network that segments a point cloud and estimates one object from the object's points and class.

    Args:
        classes: number of classes.
    """

    def __init__(self, classes: int) -> None:
        super().__init__()
        self.stem = _mlp(CHANNELS, POINT, POINT)
        self.patch = _mlp(3 + POINT, WIDTH, WIDTH)
        self.place = nn.Linear(3, WIDTH)
        self.readout = nn.Parameter(torch.randn(1, 1, WIDTH) * 0.02)
        self.blocks = nn.ModuleList(Block(WIDTH, HEADS) for _ in range(LAYERS))
        self.norm = nn.LayerNorm(WIDTH)
        self.point = _mlp(POINT + WIDTH, WIDTH, WIDTH)
        self.groups = nn.Linear(WIDTH, len(GROUPS))
        self.weight = nn.Linear(WIDTH, 1)
        self.object = _mlp(3 * WIDTH, 128, 128)
        self.classify = nn.Linear(128, classes)
        self.of_class = nn.Embedding(classes, 32)
        self.told = _mlp(128 + 32, 128, 128)
        # The outputs are, in this order: direction, yaw, openness, both limits, size, and the log standard deviations
        # of the yaw, the openness, the axis position and the keypoints.
        self.answer = nn.Linear(128, len(DIRECTIONS) + 2 + 1 + 2 + 3 + 2 + 1 + SLOTS)
        self.vote = nn.Sequential(_mlp(WIDTH + 128, WIDTH, WIDTH), nn.GELU(), nn.Linear(WIDTH, 1 + 4 * (1 + SLOTS)))

    def see(self, xyz: torch.Tensor, more: torch.Tensor, rows: torch.Tensor | None = None) -> EncodedCloud:
        """Encode clouds.

        Args:
            xyz: (B, N, 3) points in the base frame, m.
            more: (B, N, 5) features of the points, from :func:`features_of`.
            rows: (B, R) indices of the points whose features are returned; None: all points.
        """
        middle = torch.cat([xyz[..., :2].median(1, keepdim=True).values, torch.zeros_like(xyz[:, :1, :1])], -1)
        local = (xyz - middle) / SCALE
        points = self.stem(torch.cat([local, more], -1))
        centers = gathered(local, farthest_points(local, ANCHORS))
        patches = squared_distances(centers, local).topk(PATCH, dim=-1, largest=False, sorted=False).indices
        near = torch.cat([(gathered(local, patches) - centers[:, :, None]) * 4, gathered(points, patches)], -1)
        tokens = self.patch(near).amax(2) + self.place(centers)
        tokens = torch.cat([self.readout.expand(len(tokens), -1, -1), tokens], 1)
        for block in self.blocks:
            tokens = block(tokens)
        tokens = self.norm(tokens)
        if rows is not None:
            xyz, local, points = (gathered(each, rows) for each in (xyz, local, points))
        spread = interpolated(local, centers, tokens[:, 1:])
        features = self.point(torch.cat([points, spread], -1))
        return EncodedCloud(xyz, features, tokens[:, 0], self.groups(features), self.weight(features)[..., 0])

    def gather(self, seen: EncodedCloud, mask: torch.Tensor) -> torch.Tensor:
        """Return a feature (B, 128) of one object in each cloud. ``mask`` (B, N) selects the points of the object, and
        must select at least one point in each cloud.
        """
        share = seen.weight.masked_fill(~mask, -torch.inf).softmax(1)
        mean = (share[..., None] * seen.features).sum(1)
        most = seen.features.masked_fill(~mask[..., None], -torch.inf).amax(1)
        return self.object(torch.cat([mean, most, seen.context], -1))

    def estimate(
        self, seen: EncodedCloud, gathered: torch.Tensor, mask: torch.Tensor, classes: torch.Tensor
    ) -> dict[str, torch.Tensor]:
        """Estimate the state and geometry of one object of known class in each cloud.

        Args:
            seen: encoded clouds.
            gathered: (B, 128) features of the objects from :meth:`gather`.
            mask: (B, N) mask of the objects' points.
            classes: (B,) index of each object's class.

        Returns:
            A dict with these tensors:

            - ``direction`` (B, 6): logits of the direction of the joint axis.
            - ``yaw`` (B, 2): cosine and sine of the object's yaw.
            - ``openness`` (B,): openness of the joint.
            - ``limits`` (B, 2): joint limits.
            - ``size`` (B, 3): size of the object's bounding box, m.
            - ``moving`` (B, N): logits of whether a point belongs to the moving part.
            - ``votes`` (B, N, 1 + SLOTS, 3): positions of a point on the joint axis and of the keypoints, m, as each
              cloud point predicts them.
            - ``places`` (B, 1 + SLOTS, 3): weighted means of these predictions, m.
            - ``log_deviations`` (B, 3 + SLOTS): logarithms of the predicted standard deviations of the yaw (rad), the
              openness, the axis position (m) and the keypoints (m).
        """
        told = torch.nn.functional.gelu(self.told(torch.cat([gathered, self.of_class(classes)], -1)))
        answer = self.answer(told)
        direction, yaw, openness, limits, size, deviations = answer.split([6, 2, 1, 2, 3, 3 + SLOTS], -1)
        rows = torch.cat([seen.features, told[:, None].expand(-1, mask.shape[1], -1)], -1)
        raw = self.vote(rows)
        moving, weights, offsets = raw[..., 0], raw[..., 1 : 2 + SLOTS], raw[..., 2 + SLOTS :]
        votes = seen.xyz[:, :, None] + SCALE * offsets.unflatten(-1, (1 + SLOTS, 3))
        shares = weights.masked_fill(~mask[..., None], -torch.inf).softmax(1)
        return {
            "direction": direction,
            "yaw": torch.nn.functional.normalize(yaw, dim=-1),
            "openness": openness[:, 0],
            "limits": limits,
            "size": SCALE * torch.nn.functional.softplus(size),
            "moving": moving,
            "votes": votes,
            "places": (shares[..., None] * votes).sum(1),
            "log_deviations": deviations.clamp(LEAST, MOST),
        }


OF_CLASSES = ("classify.weight", "classify.bias", "of_class.weight")
"""Names of the weights that have a row for each class."""


def grown(weights: Mapping[str, torch.Tensor], similar: Sequence[int]) -> dict[str, torch.Tensor]:
    """Return the weights of a network with additional classes. Each new class gets a copy of the weights of a known
    class.

    Args:
        weights: weights of a :class:`SceneNetwork`, by name.
        similar: for each new class, the index of the known class whose weights it gets.
    """
    rows = torch.tensor(similar, dtype=torch.int64)
    return {name: torch.cat([each, each[rows]]) if name in OF_CLASSES else each for name, each in weights.items()}


def _mlp(inner: int, middle: int, outer: int) -> nn.Sequential:
    return nn.Sequential(nn.Linear(inner, middle), nn.LayerNorm(middle), nn.GELU(), nn.Linear(middle, outer))


WEIGHTS: Mapping[str, float] = {
    "group": 0.5,
    "class": 0.5,
    "direction": 0.5,
    "yaw": 0.3,
    "openness": 0.3,
    "limits": 1.0,
    "size": 1.0,
    "moving": 1.0,
    "votes": 5.0,
    "places": 0.3,
}
"""Weights of the losses; losses with predicted deviations are negative log likelihoods."""
SMOOTHING = 0.05
"""Label smoothing of the classes, so that an unfamiliar shape does not get a class with certainty."""


def losses(network: SceneNetwork, batch: Mapping[str, torch.Tensor]) -> dict[str, torch.Tensor]:
    """Return the losses of a batch, averaged over its clouds. The keys are the names of the losses in ``WEIGHTS``.

    Args:
        network: network to train.
        batch: batch from :meth:`~gensim2.perception.estimation.training.Examples.batch`.
    """
    cross, functional = nn.functional.cross_entropy, nn.functional
    seen = network.see(batch["xyz"], batch["features"], batch["rows"])
    group, moves = batch["group"].gather(1, batch["rows"]), batch["moving"].gather(1, batch["rows"])
    mask = group == TARGET
    gathered = network.gather(seen, mask)
    found = network.estimate(seen, gathered, mask, batch["class"])
    deviations, prior = found["log_deviations"], batch.get("log_prior", torch.zeros(()))
    truth = torch.cat([_on_axis(found["places"][:, 0], batch)[:, None], batch["keypoints"]], 1)
    known = torch.cat([torch.ones_like(batch["known"][:, :1]), batch["known"]], 1)
    aims = torch.cat(
        [_on_axis(seen.xyz, batch)[:, :, None], batch["keypoints"][:, None].expand(-1, mask.shape[1], -1, -1)], 2
    )
    # The axis of a prismatic joint has no position.
    known[:, 0] = batch["revolute"]
    error = (found["places"] - truth).norm(dim=-1)
    votes = (found["votes"] - aims).abs().sum(-1) * mask[..., None] * known[:, None]
    turned = (found["yaw"] * batch["yaw"]).sum(-1).clamp(-1, 1)
    angle = torch.atan2((found["yaw"][:, 0] * batch["yaw"][:, 1] - found["yaw"][:, 1] * batch["yaw"][:, 0]), turned)
    part = functional.binary_cross_entropy_with_logits(found["moving"], moves, reduction="none")
    # Weight the points of the body and of the moving part so that the part with fewer points also influences the loss.
    share = ((moves * mask).sum(1) / mask.sum(1)).clamp(0.03, 0.97)[:, None]
    balanced = torch.where(moves > 0, 0.5 / share.sqrt(), 0.5 / (1 - share).sqrt())
    return {
        "group": cross(seen.group.transpose(1, 2), group),
        "class": cross(network.classify(gathered) + prior, batch["class"], label_smoothing=SMOOTHING),
        "direction": cross(found["direction"], batch["direction"]),
        "yaw": _likelihood(angle.abs(), deviations[:, 0]).mean() + (1 - turned).mean(),
        "openness": _likelihood((found["openness"] - batch["openness"]).abs(), deviations[:, 1]).mean()
        + 2 * (found["openness"] - batch["openness"]).abs().mean(),
        "limits": (found["limits"] - batch["limits"]).abs().mean(),
        "size": (found["size"] - batch["size"]).abs().mean(),
        "moving": (part * balanced * mask).sum() / mask.sum(),
        "votes": votes.sum() / (mask.sum() * (1 + SLOTS)),
        "places": (_likelihood(error, deviations[:, 2:]) * known).sum() / known.sum(),
    }


def _likelihood(error: torch.Tensor, log_deviation: torch.Tensor) -> torch.Tensor:
    """Return the negative log density of a Laplace distribution, without the constant log 2."""
    return error * torch.exp(-log_deviation) + log_deviation


def _on_axis(points: torch.Tensor, batch: Mapping[str, torch.Tensor]) -> torch.Tensor:
    """Project points (B, ..., 3) onto the true joint axes."""
    shape = (len(points), *(1,) * (points.dim() - 2), 3)
    axis, origin = batch["axis"].view(shape), batch["origin"].view(shape)
    return origin + ((points - origin) * axis).sum(-1, keepdim=True) * axis
