"""Neighbourhoods of points in pure PyTorch: farthest point sampling, ball queries, interpolation."""

from __future__ import annotations

import torch


@torch.no_grad()  # type: ignore[untyped-decorator]
def farthest_points(points: torch.Tensor, count: int) -> torch.Tensor:
    """(B, count) int64: farthest point sampling of points (B, N, 3), from the one farthest from the mean on.

    It starts where no order of the points has a say.
    """
    last = (points - points.mean(1, keepdim=True)).square().sum(-1).argmax(1)
    found, nearest = [last], torch.full_like(points[..., 0], torch.inf)
    # Axis by axis: sums over the last dimension of three cost ten times as much.
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
    """(B, M, N) between points (B, M, 3) and (B, N, 3), without cancellation."""
    return (a[:, :, None] - b[:, None]).square().sum(-1)


def ball_query(points: torch.Tensor, centers: torch.Tensor, radius: float, count: int) -> torch.Tensor:
    """(B, M, count) int64: the ``count`` nearest points (B, N, 3) within ``radius`` of centers (B, M, 3).

    Where there are fewer the nearest one is repeated. Taking the nearest, not the first, the order of the points has no
    say.
    """
    count = min(count, points.shape[1])
    distance, rows = squared_distances(centers, points).topk(count, dim=-1, largest=False, sorted=True)
    return torch.where(distance <= radius * radius, rows, rows[..., :1])


def gathered(values: torch.Tensor, rows: torch.Tensor) -> torch.Tensor:
    """(B, ..., C) of values (B, N, C) at rows (B, ...)."""
    flat = rows.flatten(1)
    found = torch.gather(values, 1, flat[..., None].expand(-1, -1, values.shape[-1]))
    return found.unflatten(1, rows.shape[1:])


def interpolated(points: torch.Tensor, known: torch.Tensor, values: torch.Tensor) -> torch.Tensor:
    """(B, N, C) of values (B, M, C) at known points (B, M, 3): the three nearest, by inverse squared distances."""
    distance, rows = squared_distances(points, known).topk(min(3, known.shape[1]), dim=-1, largest=False)
    weights = 1 / distance.clamp(min=1e-10)
    weights = weights / weights.sum(-1, keepdim=True)
    return (gathered(values, rows) * weights[..., None]).sum(2)
