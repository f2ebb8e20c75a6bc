"""A listener that keeps what it is told."""

from __future__ import annotations

from gensim2.core.progress import NullProgress


class Messages(NullProgress):
    """Keeps messages, in order."""

    def __init__(self) -> None:
        self.messages: list[str] = []

    def message(self, text: str) -> None:
        self.messages.append(text)
