"""Compute neighbourhoods of points in pure PyTorch: farthest point sampling, ball queries, interpolation."""

from __future__ import annotations

import torch


@torch.no_grad()  # type: ignore[untyped-decorator]
def farthest_points(points: torch.Tensor, count: int) -> torch.Tensor:
    """Sample ``count`` points by farthest point sampling.

    Sampling starts at the point farthest from the mean, so the result does not depend on the order of the points.

    Args:
        points: (B, N, 3).
        count: number of points to sample.

    Returns:
        (B, count) int64 indices.
    """
    last = (points - points.mean(1, keepdim=True)).square().sum(-1).argmax(1)
    found, nearest = [last], torch.full_like(points[..., 0], torch.inf)
    # Process the three axes one by one. Summing over a last dimension of length three would take ten times as long.
    x, y, z = (each.contiguous() for each in points.unbind(-1))
    for _ in range(count - 1):
        at = last[:, None]
        distance = (x - x.gather(1, at)).square_()
        distance += (y - y.gather(1, at)).square_()
        distance += (z - z.gather(1, at)).square_()
        nearest = torch.minimum(nearest, distance)
        found.append(last := nearest.argmax(1))
    return torch.stack(found, 1)


def squared_distances(a: torch.Tensor, b: torch.Tensor) -> torch.Tensor:
    """Return squared distances (B, M, N).

    The distances are computed from differences, because a² - 2ab + b² would lose precision.
    """
    return (a[:, :, None] - b[:, None]).square().sum(-1)


def ball_query(points: torch.Tensor, centers: torch.Tensor, radius: float, count: int) -> torch.Tensor:
    """Return the nearest points within a radius of each centre, independently of the order of the points.

    Args:
        points: (B, N, 3).
        centers: (B, M, 3).
        radius: radius of a group, in the unit of the points.
        count: number of points in a group; a group with fewer points repeats the nearest point.

    Returns:
        (B, M, count) int64 indices.
    """
    count = min(count, points.shape[1])
    distance, rows = squared_distances(centers, points).topk(count, dim=-1, largest=False, sorted=True)
    return torch.where(distance <= radius * radius, rows, rows[..., :1])


def gathered(values: torch.Tensor, rows: torch.Tensor) -> torch.Tensor:
    """Return the entries (B, ..., C) of ``values`` (B, N, C) at the indices ``rows`` (B, ...)."""
    flat = rows.flatten(1)
    found = torch.gather(values, 1, flat[..., None].expand(-1, -1, values.shape[-1]))
    return found.unflatten(1, rows.shape[1:])


def interpolated(points: torch.Tensor, known: torch.Tensor, values: torch.Tensor) -> torch.Tensor:
    """Interpolate values from the three nearest known points, weighted by inverse squared distance.

    Args:
        points: (B, N, 3) points to interpolate at.
        known: (B, M, 3) points with known values.
        values: (B, M, C) values at the known points.

    Returns:
        (B, N, C) interpolated values.
    """
    distance, rows = squared_distances(points, known).topk(min(3, known.shape[1]), dim=-1, largest=False)
    weights = 1 / distance.clamp(min=1e-10)
    weights = weights / weights.sum(-1, keepdim=True)
    return (gathered(values, rows) * weights[..., None]).sum(2)
