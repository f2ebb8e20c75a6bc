r"""Keypose head. It predicts a strategy, a place in the scene, and hand poses near this place, which the planner
executes.

The network has two stages. The first stage sees a subset of the cloud's points. It classifies what to do next: every
strategy of every task step is a class, and the last class means "done". For a given class, it also predicts a weight
:math:`w_i` (a heatmap) and an offset :math:`o_i` for each point :math:`x_i`. The place where the hand acts is the
weighted mean :math:`p = \sum_i w_i (x_i + o_i)`.

The second stage sees the points near this place, in coordinates with :math:`p` as the origin and with Fourier features.
It corrects :math:`p` and predicts a program: positions relative to the place, rotations as six numbers, gripper
commands, and times.

Each strategy has its own heatmap and program, so the network never averages over different strategies. Both stages are
trained at the same time. In training, the second stage does not get the prediction of the first stage but the true
place with noise.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import torch
from torch import nn

from gensim2.policy.encoders.mlp import MlpEncoder
from gensim2.policy.heatmap import fourier_features, heat_loss, places_of
from gensim2.policy.keypose.program import ACTUATION, KEYPOSES
from gensim2.policy.rotations import matrix_of_six

if TYPE_CHECKING:
    from gensim2.policy.config import PolicyConfig
    from gensim2.policy.heads.protocol import Context

WAY, POSITIONS, ROTATIONS = "keypose_way", "keypose_positions", "keypose_rotations"
GRIPPER, SECONDS, FORCE = "keypose_gripper", "keypose_seconds", "keypose_force"
"""Names of targets: class (B,), positions (B, K, 3) in m, rotations (B, K, 3, 3), gripper commands (B, K + 1), times
(B, K) in s, force (B,) in N. Samples of the class "done" use only the class.
"""

ANSWERS = 8
"""Number of the most probable classes whose programs ``act`` returns."""
BANDS = (2.0, 8.0)
"""Frequencies of the Fourier features, 1/m."""
NEAR, FAR = 128, 64
"""Number of points that the second stage sees: nearest points to the place, and points sampled from the whole cloud."""
NOISE = (0.01, 0.03)
"""Noise (m) on the origin of the second stage in training: the error after one refinement, and the error of the first
stage.
"""
ROUNDS = 2
"""Number of times that the second stage runs; each run is centred on the place predicted by the previous run."""
METRE, CENTIMETRES = 0.05, 0.1
"""Lengths (m) by which positions are divided to normalize them."""
FORCE_SCALE = 2.0
"""Gripping force (N) by which forces are divided to normalize them."""
SOONEST = 0.02
"""Time (s) that is added to the time of a keypose before its logarithm is taken, so that a time of 0 is possible."""

GROWING = ("way.2.weight", "way.2.bias", "hears.weight", "hears.bias", "of_way.weight")
"""Names of weights with one row for each class."""

_SIZES = (3, 3 * (KEYPOSES - 1), 6 * KEYPOSES, KEYPOSES + 1, KEYPOSES, 1)


@dataclass(frozen=True)
class Programs:
    """Predictions of the second stage. Each attribute has the same shape as the target with the same name."""

    positions: torch.Tensor
    rotations: torch.Tensor
    gripper: torch.Tensor
    seconds: torch.Tensor
    force: torch.Tensor


class KeyposeHead(nn.Module):  # type: ignore[misc]
    """Head that predicts keypose programs.

    Args:
        arm: number of the arm's joints; unused, because hand poses do not depend on the arm.
        features: G, size of a point's feature.
    """

    wants_features = True
    noise: tuple[int, ...] = ()

    def __init__(self, config: PolicyConfig, arm: int, features: int) -> None:
        super().__init__()
        width, hidden, of_way = config.width, config.hidden, 32
        self.ways = config.ways
        self.way = nn.Sequential(nn.Linear(width, 128), nn.GELU(), nn.Linear(128, config.ways))
        self.hears = nn.Linear(width, config.ways) if config.hears and config.text != "none" else None
        self.of_way = nn.Embedding(config.ways, of_way)
        self.of_point, self.of_cloud = nn.Linear(features, 64), nn.Linear(width + of_way, 64)
        self.heat = nn.Linear(64, 4)
        self.near = MlpEncoder(3 + 6 * len(BANDS))
        self.register_buffer("center", torch.zeros(3))
        self.program = nn.Sequential(
            nn.Linear(self.near.width + of_way + 3 + width, hidden),
            nn.GELU(),
            nn.Linear(hidden, hidden),
            nn.GELU(),
            nn.Linear(hidden, sum(_SIZES)),
        )
        self.center: torch.Tensor

    def fit(self, batch: Mapping[str, torch.Tensor]) -> None:
        """Compute the mean actuation position from a batch of targets; network inputs are relative to this position."""
        live = batch[WAY] < self.ways - 1
        if live.any():
            self.center.copy_(batch[POSITIONS][live, ACTUATION].mean(0))

    def grown(self, theirs: Mapping[str, torch.Tensor]) -> dict[str, torch.Tensor]:
        """Return the weights of this head, with the weights of a trained head with fewer classes copied into them.

        Classes are added to a trained head with its weights ``theirs``. The trained classes keep their indices, except
        for "done", which stays the last class. The added classes keep the weights of this head.
        """
        mine = {name: value.clone() for name, value in self.state_dict().items()}
        for name, value in theirs.items():
            if name in GROWING:
                mine[name][: len(value) - 1], mine[name][-1] = value[:-1], value[-1]
            else:
                mine[name] = value
        return mine

    def loss(self, context: Context, batch: Mapping[str, torch.Tensor], generator: torch.Generator) -> torch.Tensor:
        way, true = batch[WAY], batch[POSITIONS]
        place = true[:, ACTUATION]
        live = (way < self.ways - 1).to(place.dtype)
        share = live / live.sum().clamp(min=1.0)
        summary = context.tokens[:, 0]
        logits = self.way(summary)
        chosen = logits.new_zeros(())
        if self.hears is not None and context.sentence is not None:
            said = self.hears(context.sentence)
            logits, chosen = logits + said, nn.functional.cross_entropy(said, way)
        chosen = chosen + nn.functional.cross_entropy(logits, way)
        points = context.points
        logits, found = self._first(points, context, way)
        heat = heat_loss(points, logits[..., None], place[:, None])[:, 0]
        coarse = (found - place).abs().sum(-1) / METRE
        made = {"generator": generator, "device": place.device}
        spread = torch.where(torch.rand(len(place), 1, **made) < 0.5, *NOISE)
        origin = place + spread * torch.randn(place.shape, **made)
        given = self._second(context.cloud, origin, way, summary, generator)
        away = (given.positions - true).abs().sum(-1) / METRE
        others = away.sum(-1) - away[:, ACTUATION]
        turned = _turned(given.rotations, batch[ROTATIONS])
        fingers = (given.gripper - batch[GRIPPER]).abs().mean(-1)
        times = ((given.seconds + SOONEST).log() - (batch[SECONDS] + SOONEST).log()).abs().mean(-1)
        force = (given.force - batch[FORCE]).abs() / FORCE_SCALE
        each = 0.3 * heat + 0.5 * coarse + 2.0 * away[:, ACTUATION] + others / (KEYPOSES - 1) + 2.0 * turned
        each = each + fingers + 0.3 * times + 0.3 * force
        return chosen + (each * share).sum()

    def act(self, context: Context, noise: torch.Tensor) -> torch.Tensor:
        """Return the most probable classes with their programs. The shape is (B, ``ANSWERS``, 2 + length of a program).

        Each of the ``ANSWERS`` rows contains the probability of a class, the index of the class, and its program
        (:mod:`gensim2.policy.keypose.answers`).
        """
        summary = context.tokens[:, 0]
        logits = self.way(summary)
        if self.hears is not None and context.sentence is not None:
            logits = logits + self.hears(context.sentence)
        chances = logits.softmax(-1)
        best = chances.topk(min(ANSWERS, self.ways), -1)
        found = []
        for rank in range(best.indices.shape[1]):
            way = best.indices[:, rank]
            _, place = self._first(context.points, context, way)
            for _ in range(ROUNDS):
                given = self._second(context.cloud, place, way, summary, None)
                place = given.positions[:, ACTUATION]
            parts = (
                best.values[:, rank, None],
                way[:, None].to(place.dtype),
                given.positions.flatten(1),
                given.rotations.flatten(1),
                given.gripper,
                given.seconds,
                given.force[:, None],
            )
            found.append(torch.cat(parts, -1))
        return torch.stack(found, 1)

    def _first(self, points: torch.Tensor, context: Context, way: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Run the first stage of the network for one strategy class of each sample.

        ``way`` (B,) has the classes. Return heatmap logits (B, N) over the points, and the positions of the hand (B,
        3), metres.
        """
        assert context.features is not None
        told = torch.cat([context.tokens[:, 0], self.of_way(way)], -1)
        inner = nn.functional.gelu(self.of_point(context.features) + self.of_cloud(told)[:, None])
        logits, offsets = self.heat(inner).split((1, 3), -1)
        return logits[..., 0], places_of(points, logits, offsets[:, :, None])[:, 0]

    def _second(
        self,
        cloud: torch.Tensor,
        origin: torch.Tensor,
        way: torch.Tensor,
        summary: torch.Tensor,
        generator: torch.Generator | None,
    ) -> Programs:
        """Run the second stage for classes ``way``: predict programs from the points around ``origin`` (B, 3), m."""
        about = cloud - origin[:, None]
        count = about.shape[1]
        near = about.square().sum(-1).topk(min(NEAR, count), largest=False).indices
        if generator is None:
            far = torch.linspace(0, count - 1, min(FAR, count), device=cloud.device).long().expand(len(cloud), -1)
        else:
            far = torch.randint(count, (len(cloud), min(FAR, count)), generator=generator, device=cloud.device)
        rows = torch.cat([near, far], 1)
        about = torch.gather(about, 1, rows[..., None].expand(-1, -1, 3))
        seen = self.near(torch.cat([about, *fourier_features(about, BANDS)], -1))[:, 0]
        out = self.program(torch.cat([seen, self.of_way(way), origin - self.center, summary], -1))
        moved, relative, six, gripper, seconds, force = out.split(_SIZES, -1)
        place = (origin + METRE * moved)[:, None]
        others = place + CENTIMETRES * relative.unflatten(-1, (KEYPOSES - 1, 3))
        down = torch.tensor([1.0, 0.0, 0.0, 0.0, -1.0, 0.0], device=out.device)
        return Programs(
            positions=torch.cat([others[:, :ACTUATION], place, others[:, ACTUATION:]], 1),
            rotations=matrix_of_six(six.unflatten(-1, (KEYPOSES, 6)) + down),
            gripper=gripper,
            seconds=(seconds.clamp(-6.0, 4.0).exp() - SOONEST).clamp(min=0.0),
            force=FORCE_SCALE * force[:, 0],
        )


def _turned(found: torch.Tensor, true: torch.Tensor) -> torch.Tensor:
    """Return mean squared errors (B,) of rotations (B, K, 3, 3); fingers may be swapped in a whole program."""
    one = (found - true).square().sum((-2, -1)).mean(-1)
    swapped = true * torch.tensor([-1.0, -1.0, 1.0], device=true.device)
    return torch.minimum(one, (found - swapped).square().sum((-2, -1)).mean(-1))
