"""Hide API keys in text."""

from __future__ import annotations

import re
from functools import cached_property

_WORDS = """
anything api-key changeme dummy dummy-key empty fake fake-key key lm-studio local local-key my-api-key no-key
no-key-needed no-key-required none not-needed not-required nothing null ollama openai placeholder secret sk-dummy
sk-fake sk-local sk-no-key-needed sk-no-key-required sk-none sk-xxx test test-key token unused x your-api-key
your-api-key-here your_api_key
"""

DUMMIES = frozenset(_WORDS.split())
"""Words that stand for a key where an endpoint wants none, in lower case."""

SHORTEST = 8
"""Characters of the shortest secret."""

HIDDEN = "***"


class Secret:
    """A key. It shows itself as ``***``; :meth:`reveal` is for the client alone.

    Args:
        value: the key as it is sent.
    """

    def __init__(self, value: str) -> None:
        self._value = value

    def __repr__(self) -> str:
        return HIDDEN

    __str__ = __repr__

    def __bool__(self) -> bool:
        return bool(self._value)

    def reveal(self) -> str:
        """Return the key itself."""
        return self._value

    @property
    def can_be_sent(self) -> bool:
        """Whether the key fits into a header."""
        return self._value.isascii() and self._value.isprintable() and " " not in self._value

    @property
    def is_secret(self) -> bool:
        """Whether the key must be hidden; a placeholder may stand in any text."""
        return len(self._value) >= SHORTEST and self._value.lower() not in DUMMIES

    def hidden_in(self, text: str) -> str:
        """Return ``text`` with ``***`` for the whole key, in any case, percent-encoded or with JSON escapes."""
        return self._spelled.sub(HIDDEN, text) if self.is_secret else text

    @cached_property
    def _spelled(self) -> re.Pattern[str]:
        spellings = (rf"(?:\\{re.escape(c)}|{re.escape(c)}|%{ord(c):02x}|\\u{ord(c):04x})" for c in self._value)
        return re.compile("".join(spellings), re.IGNORECASE)
