"""Rotations, neighbourhoods and samplers compared with SciPy, brute force and closed forms."""

from __future__ import annotations

import made_up
import numpy as np
import pytest
import torch
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from gensim2.policy.encoders.grouping import ball_query, farthest_points, interpolated
from gensim2.policy.heads.diffusion import DiffusionHead, FlowHead, ddim_levels, signal_shares
from gensim2.policy.heads.protocol import Context
from gensim2.policy.rotations import matrix_of_quaternion, matrix_of_six, six_of_matrix


def test_rotations_are_scipys() -> None:
    rotation = Rotation.random(50, random_state=0)
    matrix = torch.from_numpy(rotation.as_matrix())
    quaternion = torch.from_numpy(rotation.as_quat(scalar_first=True))
    assert torch.allclose(matrix_of_quaternion(quaternion), matrix, atol=1e-12)
    assert torch.allclose(matrix_of_six(six_of_matrix(matrix)), matrix, atol=1e-12)


def test_any_six_numbers_become_a_rotation() -> None:
    six = torch.randn(100, 6, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    matrix = matrix_of_six(six)
    assert torch.allclose(matrix @ matrix.transpose(-1, -2), torch.eye(3, dtype=torch.float64), atol=1e-9)
    assert torch.allclose(torch.linalg.det(matrix), torch.ones(100, dtype=torch.float64))
    first = six[:, :3] / six[:, :3].norm(dim=-1, keepdim=True)
    assert torch.allclose(matrix[..., 0], first)


def _cloud(count: int = 60) -> torch.Tensor:
    return torch.from_numpy(np.random.default_rng(0).uniform(-1, 1, (3, count, 3)))


def test_farthest_points_are_those_of_brute_force() -> None:
    points = _cloud()
    found = farthest_points(points, 10)
    for cloud, rows in zip(points.numpy(), found.numpy(), strict=True):
        chosen = [int(np.argmax(np.linalg.norm(cloud - cloud.mean(0), axis=1)))]
        while len(chosen) < 10:
            distances = np.linalg.norm(cloud[:, None] - cloud[chosen][None], axis=-1).min(1)
            chosen.append(int(np.argmax(distances)))
        assert rows.tolist() == chosen


def test_balls_hold_the_nearest_points_within_their_radius() -> None:
    points = _cloud()
    centers, radius = points[:, :7], 0.6
    found = ball_query(points, centers, radius, 8).numpy()
    for cloud, own, rows in zip(points.numpy(), centers.numpy(), found, strict=True):
        tree = cKDTree(cloud)
        for center, row in zip(own, rows, strict=True):
            inside = tree.query_ball_point(center, radius)
            near = sorted(inside, key=lambda i: float(np.linalg.norm(cloud[i] - center)))[:8]
            assert row.tolist()[: len(near)] == near
            assert set(row.tolist()[len(near) :]) <= {near[0]}


def test_interpolation_weighs_the_three_nearest() -> None:
    points, values = _cloud(), torch.randn(3, 60, 5, dtype=torch.float64)
    known = points[:, :20]
    found = interpolated(points, known, values[:, :20]).numpy()
    assert np.allclose(found[:, :20], values[:, :20].numpy(), atol=1e-6)  # exact at known points
    for cloud, own, value, result in zip(points.numpy(), known.numpy(), values[:, :20].numpy(), found, strict=True):
        distance, rows = cKDTree(own).query(cloud[30], k=3)
        weights = distance**-2.0 / (distance**-2.0).sum()
        assert np.allclose(result[30], weights @ value[rows])


def test_the_signal_fades_from_one_to_nothing() -> None:
    shares = signal_shares(100)
    assert shares[0] > 0.999
    assert shares[-1] < 1e-4
    assert (shares.diff() < 0).all()
    assert ddim_levels(100, 4) == [99, 74, 49, 24]
    assert ddim_levels(100, 100) == list(range(99, -1, -1))


@pytest.mark.parametrize("spread", [0.3, 1.5])
def test_ddim_turns_noise_into_the_data(spread: float) -> None:
    """For data of N(0, s^2) the denoiser is x0 = a s^2 / (a^2 s^2 + 1 - a^2) xt, where a^2 is the signal's share. With
    it, a quantile of the noise becomes the same quantile of the data.
    """
    head = DiffusionHead(made_up.policy(noise_levels=400, denoise_steps=400), 7)

    def clean(noisy: torch.Tensor, level: torch.Tensor, tokens: torch.Tensor) -> torch.Tensor:
        share = head.shares[(level * head.levels).round().long() - 1][:, None, None]
        return share.sqrt() * spread**2 / (share * spread**2 + 1 - share) * noisy

    head.decoder.forward = clean
    noise = torch.linspace(-2, 2, 36).reshape(1, 4, 9)
    context = Context(torch.zeros(1, 1, 16), torch.zeros(1, 1, 3), torch.zeros(1, 1, 3), None)
    assert torch.allclose(head.act(context, noise), spread * noise, atol=0.03)


@pytest.mark.parametrize("spread", [0.3, 1.5])
def test_the_flow_turns_noise_into_the_data(spread: float) -> None:
    """For N(0, s^2) the velocity is (t s^2 - (1 - t)) / (t^2 s^2 + (1 - t)^2) x."""
    head = FlowHead(made_up.policy(noise_levels=400, denoise_steps=400), 7)

    def velocity(chunk: torch.Tensor, level: torch.Tensor, tokens: torch.Tensor) -> torch.Tensor:
        t = 1 - level[:, None, None]
        return (t * spread**2 - (1 - t)) / (t**2 * spread**2 + (1 - t) ** 2) * chunk

    head.decoder.forward = velocity
    noise = torch.linspace(-2, 2, 36).reshape(1, 4, 9)
    context = Context(torch.zeros(1, 1, 16), torch.zeros(1, 1, 3), torch.zeros(1, 1, 3), None)
    assert torch.allclose(head.act(context, noise), spread * noise, atol=0.03)
