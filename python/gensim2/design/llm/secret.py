"""Keys: what counts as one, and text without it."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterator
from functools import cached_property
from urllib.parse import quote

_WORDS = """
anything api-key changeme dummy dummy-key empty fake fake-key key lm-studio local local-key my-api-key no-key
no-key-needed no-key-required none not-needed not-required nothing null ollama openai placeholder secret sk-dummy
sk-fake sk-local sk-no-key-needed sk-no-key-required sk-none sk-xxx test test-key token unused x your-api-key
your-api-key-here your_api_key
"""

DUMMIES = frozenset(_WORDS.split())
"""Words that stand for a key where an endpoint wants none, in lower case."""

SHORTEST = 12
"""Characters of the shortest secret; with three kinds of characters (``Pa55word!``) ``SHORTEST_MIXED``."""

SHORTEST_MIXED = 8

SHORTEST_WORD = 20
"""Letters of the shortest secret made of letters of one case alone: shorter ones are words of a language."""

LEAST_BITS = 24.0
"""Entropy of the least varied secret, of its own characters: ``xxxxxxxxxxxxxxxx`` has none."""

SHORTEST_PIECE = 12
"""Characters of a part of a secret that tells too much; half of a shorter secret."""

LEAST_BITS_OF_PIECE = 16.0
"""Entropy of a part of a secret that is looked for: a row of zeros may stand in any text."""

HIDDEN = "***"


class Secret:
    """A key. It shows itself as ``***``; :meth:`reveal` is for the client alone.

    Args:
        value: as it is sent.
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
        """Whether it fits into a header."""
        return self._value.isascii() and self._value.isprintable() and " " not in self._value

    @cached_property
    def is_secret(self) -> bool:
        """Whether it tells anything: a dummy (``x``, ``EMPTY``) does not, and text may hold it."""
        value = self._value
        if value.lower() in DUMMIES or _bits(value) < LEAST_BITS:
            return False
        kinds = sum(any(test(c) for c in value) for test in (str.islower, str.isupper, str.isdigit, _is_sign))
        if kinds >= 3:
            return len(value) >= SHORTEST_MIXED
        if value.isalpha() and (value[1:].islower() or value.isupper()):
            return len(value) >= SHORTEST_WORD
        return len(value) >= SHORTEST

    def hidden_in(self, text: str) -> str:
        """Return ``text`` with ``***`` for the key and for longer parts of it, in any case or percent-encoded."""
        if not self.is_secret:
            return text
        folded = text.lower()
        if len(folded) != len(text):  # a few letters get longer: then the case has to be right
            folded = text
        spans = [span for value in self._spellings for span in _spans(value, folded)]
        if not spans:
            return text
        parts, at = [], 0
        for start, end in sorted(spans):
            if start >= at:
                parts += [text[at:start], HIDDEN]
            at = max(at, end)
        return "".join([*parts, text[at:]])

    @cached_property
    def _spellings(self) -> tuple[str, ...]:
        value = self._value
        return tuple(dict.fromkeys(each for one in (value, quote(value, safe="")) for each in (one, one.lower())))


def _is_sign(character: str) -> bool:
    return not character.isalnum()


def _bits(value: str) -> float:
    counts = Counter(value).values()
    return -sum(count * math.log2(count / len(value)) for count in counts)


def _spans(secret: str, text: str) -> Iterator[tuple[int, int]]:
    """Yield where ``secret`` or a telling piece of it stands in ``text``; those of longer pieces overlap."""
    size = min(SHORTEST_PIECE, max(SHORTEST_MIXED, (len(secret) + 1) // 2), len(secret))
    yield from (match.span() for match in re.finditer(re.escape(secret), text))
    for start in range(len(secret) - size + 1):
        piece = secret[start : start + size]
        if piece in text and _bits(piece) >= LEAST_BITS_OF_PIECE:
            yield from (match.span() for match in re.finditer(re.escape(piece), text))
