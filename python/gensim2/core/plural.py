"""Write counts in messages and on pages."""

from __future__ import annotations


def plural(count: int, noun: str) -> str:
    """Return a count with its noun, which is singular only for the count 1.

    Args:
        count: the number.
        noun: English noun in the singular, whose plural ends with an additional ``s``.

    Example:
        ```python
        plural(1, "task"), plural(0, "task")  # ("1 task", "0 tasks")
        ```
    """
    return f"{count} {noun}{'' if count == 1 else 's'}"
