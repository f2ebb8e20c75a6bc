"""Point encoders do not depend on the order of points, and the default one's shortcut is exact."""

from __future__ import annotations

import made_up
import pytest
import torch

from gensim2.policy.encoders import make_encoder
from gensim2.policy.encoders.mlp import MlpEncoder
from gensim2.policy.encoders.pointnext import PointNextEncoder
from gensim2.policy.frames import cloud_size


@pytest.mark.parametrize("name", ["mlp", "pointnet", "pointnext"])
def test_the_order_of_the_points_has_no_say(name: str) -> None:
    torch.manual_seed(0)
    config = made_up.policy(encoder=name, blocks=int(name == "pointnext"))
    encoder = make_encoder(config).eval()  # type: ignore[attr-defined]  # a module
    points = torch.randn(3, 40, cloud_size(config))
    order = torch.randperm(40)
    with torch.no_grad():
        pooled, features = encoder.with_features(points)
        again, turned = encoder.with_features(points[:, order])
        assert torch.allclose(encoder(points), pooled, atol=1e-6)
    assert pooled.shape == (3, encoder.tokens, encoder.width)
    assert features.shape == (3, 40, encoder.feature_width)
    assert torch.allclose(pooled, again, atol=1e-5)
    assert torch.allclose(features[:, order], turned, atol=1e-5)


def test_a_state_is_known_by_the_order_of_its_points() -> None:
    torch.manual_seed(0)
    config = made_up.policy(encoder="state", points=40)
    encoder = make_encoder(config).eval()  # type: ignore[attr-defined]  # a module
    points = torch.randn(3, 40, cloud_size(config))
    with torch.no_grad():
        pooled, features = encoder.with_features(points)
        assert torch.allclose(encoder(points), pooled, atol=1e-6)
        assert not torch.allclose(encoder(points.flip(1)), pooled, atol=1e-2)
    assert pooled.shape == (3, encoder.tokens, encoder.width)
    assert features.shape == (3, 40, encoder.feature_width)


def test_running_the_winners_alone_is_exact() -> None:
    torch.manual_seed(0)
    encoder, points = MlpEncoder(9), torch.randn(4, 100, 9)
    weights = torch.randn(4, 1, 192)
    found = encoder.train()(points)
    (found * weights).sum().backward()
    mine = [parameter.grad.clone() for parameter in encoder.parameters()]
    encoder.zero_grad()
    plain = encoder.layers(points).amax(1, keepdim=True)
    (plain * weights).sum().backward()
    assert torch.allclose(found, plain, atol=1e-6)
    for parameter, gradient in zip(encoder.parameters(), mine, strict=True):
        assert torch.allclose(parameter.grad, gradient, atol=1e-4)


def test_pointnext_s_has_the_size_of_the_papers() -> None:
    """1.37 million weights in the original's release, including its stem and head."""
    count = sum(parameter.numel() for parameter in PointNextEncoder(9).parameters())
    assert 1.1e6 < count < 1.4e6
    more = sum(parameter.numel() for parameter in PointNextEncoder(9, blocks=1).parameters())
    assert more > 2 * count
