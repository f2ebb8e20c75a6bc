"""Convert rotations to the continuous 6-D form for networks: the matrix's first two columns (Zhou et al. 2019)."""

from __future__ import annotations

import torch


def matrix_of_quaternion(quaternion: torch.Tensor) -> torch.Tensor:
    """Return the rotation matrices (..., 3, 3) of unit quaternions (..., 4) in the order (w, x, y, z)."""
    w, x, y, z = quaternion.unbind(-1)
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
    return torch.stack([torch.stack(row, -1) for row in rows], -2)


def six_of_matrix(matrix: torch.Tensor) -> torch.Tensor:
    """Return an array (..., 6) with the first two columns of rotation matrices (..., 3, 3)."""
    return torch.cat([matrix[..., :, 0], matrix[..., :, 1]], -1)


def matrix_of_six(six: torch.Tensor) -> torch.Tensor:
    """Return the rotations (..., 3, 3) that Gram-Schmidt makes of pairs of non-parallel vectors (..., 6)."""
    a, b = six[..., :3], six[..., 3:]
    x = torch.nn.functional.normalize(a, dim=-1, eps=1e-8)
    y = torch.nn.functional.normalize(b - (x * b).sum(-1, keepdim=True) * x, dim=-1, eps=1e-8)
    return torch.stack([x, y, torch.linalg.cross(x, y, dim=-1)], -1)
