"""The allowed collision matrix of a planning scene."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from .refusals import ErrorCode, RefusedError


@dataclass(frozen=True)
class AllowedCollisions:
    """Pairs of bodies that may touch. Entries of a pair take precedence over defaults of a body."""

    entries: Mapping[tuple[str, str], bool] = field(default_factory=dict)
    defaults: Mapping[str, bool] = field(default_factory=dict)

    @staticmethod
    def from_message(message: Any, where: str) -> AllowedCollisions:
        """Read a ``moveit_msgs/msg/AllowedCollisionMatrix``.

        Raises:
            RefusedError: the numbers of names and values differ, or the matrix is not symmetric.
        """
        names = list(message.entry_names)
        rows = [[bool(each) for each in row.enabled] for row in message.entry_values]
        if len(rows) != len(names) or any(len(row) != len(names) for row in rows):
            raise _refused(f"{where}.entry_values", f"is no square matrix of the {len(names)} entry names")
        for i, row in enumerate(rows):
            for j, allowed in enumerate(row):
                if allowed != rows[j][i]:
                    raise _refused(f"{where}.entry_values[{i}][{j}]", f"differs from entry [{j}][{i}]")
        defaults, values = list(message.default_entry_names), list(message.default_entry_values)
        if len(defaults) != len(values):
            raise _refused(f"{where}.default_entry_values", f"has {len(values)} values for {len(defaults)} names")
        entries = {(a, b): rows[i][j] for i, a in enumerate(names) for j, b in enumerate(names)}
        return AllowedCollisions(entries, {name: bool(each) for name, each in zip(defaults, values, strict=True)})

    def allows(self, first: str, second: str) -> bool | None:
        """Return whether two bodies may touch; None if the matrix has no entry for them."""
        if (first, second) in self.entries:
            return self.entries[first, second]
        found = [self.defaults[name] for name in (first, second) if name in self.defaults]
        return all(found) if found else None

    def allows_all(self, name: str, others: Iterable[str]) -> bool:
        """Return whether a body may touch all others."""
        return all(self.allows(name, other) for other in others)

    def check(self, unchecked: Iterable[tuple[str, str]]) -> None:
        """Refuse a matrix that forbids contacts which the solver does not check.

        Args:
            unchecked: pairs of links that the solver does not check.

        Raises:
            RefusedError: names the first such pair.
        """
        for first, second in unchecked:
            if self.entries.get((first, second)) is False:
                raise _refused(
                    "allowed_collision_matrix",
                    f"forbids contacts of {first!r} and {second!r}, which the solver does not check; remove the pair "
                    "from the SRDF, or pass the SRDF to the planner",
                )


def _refused(where: str, message: str) -> RefusedError:
    return RefusedError(ErrorCode.COLLISION_CHECKING_UNAVAILABLE, where, message)
