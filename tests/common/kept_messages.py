"""A listener that keeps its messages."""

from __future__ import annotations

from gensim2.core.progress import Progress


class Messages(Progress):
    def __init__(self) -> None:
        self.messages: list[str] = []

    def message(self, text: str) -> None:
        self.messages.append(text)
