"""Recognize the parts of a sentence that ask for nothing: statements, reasons, questions and polite words.

The words of an aside need not be known. Its form shows that it is no task: it has a subject with a finite verb
("there's a draught"), or a word that begins a reason ("because"). Demands ("the box should be painted") are no asides.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from gensim2.instructions.steps import Refusal, SentenceError
from gensim2.instructions.vocabulary import (
    GERUNDS,
    PARTICIPLES,
    PHRASES,
    STATES,
    VERBS,
    WORDS,
    Words,
    named_noun,
    parts,
    statement_verbs,
)

#: Punctuation marks that end a sentence or a main part of it.
MARKS = frozenset(".!?;:")
_STOPS = MARKS | {","}
_OBLIGATIONS = frozenset(("must", "should", "ought", "shall", "better"))
_WISHES = frozenset(("want", "wants", "need", "needs", "like", "love", "prefer", "wish", "require", "requires"))
#: Words that can follow the object of a wish such as "I need the box for my books".
_BEHIND_NAME = frozenset(
    ("to", "for", "because", "now", "today", "too", "please", "so", "and", "in", "on", "from", "back")
)
#: First words of fragments that may name an object, as in "done with the box".
_ABOUT_OBJECTS = frozenset(("no", "enough", "plenty", "done", "finished", "ready"))
_NO_SUBJECTS = ("auxiliaries", "negations", "function", "continues")
_POSSIBLE = frozenset(("can", "could", "may", "might", "to", "will", "would", "must", "shall", "should"))


@dataclass(frozen=True)
class Asides:
    """Finder of the asides of one sentence.

    Args:
        words: the sentence.
        asks: whether an instruction that the parser understands begins at a word.
    """

    words: Words
    asks: Callable[[int], bool]

    def end(self, at: int, *, follows: bool) -> int:
        """Return the end of the aside that begins at word ``at``, or ``at`` if no aside begins there.

        Args:
            at: index of a word.
            follows: whether an instruction comes directly before. "So you can close it" is then a reason.

        Raises:
            SentenceError: it is not clear whether words belong to the aside, or are an instruction.
        """
        if (length := PHRASES["headings"].length(at, self.words)) and self._word(at + length) == ":":
            return at + length
        polite = self._polite(at)
        if polite > at:
            return polite
        cared = at + (self._word(at) in ("but", "and"))
        if self._asks_for_care(cared):
            return self._closing(at, cared)
        length = PHRASES["lets"].length(at, self.words)
        if length and self._word(at + length) in statement_verbs().base | {
            "in",
            "out",
            "through",
            "get",
            "have",
            "take",
        }:
            return self._closing(at, at + length)
        if self._word(at) == "let" and self._stop(at) > at + 2 and self._word(self._stop(at) - 1) in ("in", "out"):
            return at if any(self._names(n) for n in range(at, self._stop(at))) else self._stop(at)
        if (length := PHRASES["reasons"].length(at, self.words)) > 0 or self._is_purpose(at):
            return self._closing(at, at + length) if not self._orders_in_time(at) else at
        length = PHRASES["reasons_of_statement"].length(at, self.words)
        if length and (self.words[at] != "so" or follows) and self._finite(at + length) is not None:
            return self._closing(at, at + length) if not self._orders_in_time(at) else at
        if length and self.words[at] == "before" and self._word(at + length).endswith("ing"):
            return self._closing(at, at + length) if not self._orders_in_time(at) else at
        finite = self._finite(at)
        if finite is not None:
            closing = self._closing(at, at)
            return at if self._demands(at, closing, finite) else closing
        if self._is_question(at):
            return next(n for n in range(at, len(self.words)) if self.words[n] in MARKS)
        if self._is_fragment(at) or self.words[at : at + 2] in (("what", "a"), ("what", "an")):
            return self._closing(at, at)
        return at

    def _names(self, at: int) -> bool:
        """Return whether the name of an articulated object begins at a word."""
        noun, _ = named_noun(at, self.words)
        return noun is not None and not noun.rigid

    def _word(self, at: int) -> str:
        return self.words[at] if 0 <= at < len(self.words) else ""

    def _stop(self, at: int) -> int:
        """Return the index of the next punctuation mark."""
        return next((n for n in range(at, len(self.words)) if self.words[n] in _STOPS), len(self.words))

    def _polite(self, at: int) -> int:
        """Return the end of polite words that begin at ``at`` and fill the part of the sentence up to its end."""
        stop = self._stop(at)
        if stop == at:
            return at
        begun = self.words[at - 1] in _STOPS if at else True
        addressed = PHRASES["polite"].length(at, self.words) or self._word(at) in WORDS["conditions"]
        length = PHRASES["courtesies"].length(at, self.words)
        if length and (at + length == stop or self._word(at + length) in ("and", "please", "then")):
            return at + length
        known = WORDS["polite"]
        if self._word(at) in WORDS["conditions"]:
            known |= WORDS["polite_condition"]
        if self._word(at) == "so":
            return at
        return stop if (begun or addressed) and all(word in known for word in self.words[at:stop]) else at

    def _asks_for_care(self, at: int) -> bool:
        """Return whether a request such as "do not slam it" begins, which every careful motion meets."""
        return self.words[at : at + 2] == ("do", "not") and self._word(at + 2) in WORDS["careful"]

    def _is_purpose(self, at: int) -> bool:
        """Return whether a purpose begins, such as "to see the cake"."""
        verb = self._word(at + 1)
        own = verb in ("get", "take", "let", "make", "have", "keep", "start", "put", "grab", "fetch")
        if self._word(at) == "time":
            return self._is_purpose(at + 1)
        if self._word(at) != "to" or (verb not in statement_verbs().base and not own):
            return False
        return self._word(at + 2) not in _STOPS | {""} or verb not in VERBS

    def _orders_in_time(self, at: int) -> bool:
        """Return whether a reason that begins with "before" or "while" names an action of the robot."""
        if self._word(at) not in ("before", "while", "as"):
            return False
        rest = self.words[at + 1 : self._stop(at)]
        asked = rest[:1] in (("you",), ("opening",), ("closing",)) or any(word in GERUNDS for word in rest[:1])
        return asked and any(self._names(n) for n in range(at, self._stop(at)))

    def _finite(self, at: int) -> int | None:
        """Return the index of the finite verb of a statement that begins at ``at``; None if no statement begins."""
        first, stop = self._word(at), self._stop(at)
        if at >= stop:
            return None
        verbs = statement_verbs()
        if first in WORDS["pronouns"]:
            verb = at + 1
            while self._word(verb) in WORDS["adverbs"]:
                verb += 1
            word = self._word(verb)
            agrees = first in ("i", "we", "they", "who", "which") and (word in verbs.base or word in VERBS)
            acted = word in PARTICIPLES and first not in ("this", "that", "there", "here", "you")
            if self._is_finite(verb) or agrees or acted:
                return verb
            if first == "you" and word in ("left", "forgot", "know", "see", "put", "opened", "closed"):
                return verb
        indefinite = first.endswith(("thing", "body", "one"))
        if first in WORDS["determiners_of_statements"] or first.isdigit() or indefinite:
            n = at + 1
            while n < min(at + 8, stop):
                if n > at + 1 and (self._is_finite(n) or self._is_plural(n)):
                    return n
                # The last word of "trash can" is not a verb.
                n += max(named_noun(n, self.words)[1], 1)
            return None
        if first in verbs.base and self._word(at + 1) in ("is", "was", "keeps", "gets", "goes", "comes", "has"):
            return at + 1
        if first in VERBS or first in verbs.base or any(first in WORDS[each] for each in _NO_SUBJECTS):
            return None
        behind = at + 3 if self._word(at + 1) == "and" else at + 1
        while self._word(behind) in WORDS["adverbs"]:
            behind += 1
        return behind if behind < stop and (self._is_finite(behind) or self._is_plural(behind)) else None

    def _is_plural(self, at: int) -> bool:
        """Return whether a verb in base form comes behind a noun in the plural, as in "the plants need"."""
        before = self._word(at - 1)
        return (before.endswith("s") or before in ("people", "children")) and (
            self._word(at) in statement_verbs().base or self._word(at) in VERBS
        )

    def _is_finite(self, at: int) -> bool:
        word = self._word(at)
        if word == "'s":
            behind = self._word(at + 1)
            described = behind in WORDS["auxiliaries"] | WORDS["adverbs"] | WORDS["fragments"] | WORDS["continues"]
            described |= (
                behind in WORDS["determiners_of_statements"] or behind.endswith(("ing", "ed")) or behind in STATES
            )
            described |= at + 2 == self._stop(at) and behind not in parts()
            pronoun = self._word(at - 1) in WORDS["pronouns"]
            return (described or pronoun) and not self._names(at + 1)
        # "Put" is rather an instruction than a past tense.
        return word in WORDS["auxiliaries"] or (word in statement_verbs().finite and word not in VERBS)

    def _demands(self, at: int, end: int, finite: int) -> bool:
        """Return whether a statement asks for something to be done with an object that the robot can move."""
        words, named = self.words[at:end], [n for n in range(at, end) if self._names(n)]
        about = bool(named) or any(word in parts() for word in words)
        subject = self.words[at]
        concerns = subject in ("it", "they", "you", "this", "that", "these", "those") or any(n < finite for n in named)
        concerns |= any(word in parts() for word in self.words[at:finite])
        verb = self.words[finite]
        if subject == "you" and (verb in _POSSIBLE or verb in VERBS or self._obliges(at, end)):
            return verb != "put"
        if concerns and self._obliges(at, end):
            return True
        behind = self.words[finite + 1 : end]
        if concerns and verb in _POSSIBLE and behind[:1] == ("be",) and any(word in PARTICIPLES for word in behind):
            return True
        for n in range(finite, end):
            if self.words[n] in _WISHES and self._word(n + 1) == "you":
                return True
            if self.words[n] in _WISHES and about and self._word(n + 1) != "to":
                wanted = [m for m in named if m > n]
                if wanted and not self._ends_with_name(wanted[-1], end):
                    return True
                if self._word(n + 1) in ("it", "this", "that", "them") and self._word(n + 2) in PARTICIPLES:
                    return True
            if (
                self.words[n] in _WISHES
                and self.words[n + 1 : n + 2] == ("to",)
                and self._word(n + 2) in WORDS["demanded"]
                and named
            ):
                return True
        return False

    def _obliges(self, at: int, end: int) -> bool:
        for n in range(at, end):
            word = self.words[n]
            if word in _OBLIGATIONS or (
                word in ("has", "have", "needs", "need", "is", "are", "got") and self._word(n + 1) == "to"
            ):
                return True
            if word in ("needs", "wants", "requires") and self._word(n + 1) != ",":
                return True
        return False

    def _ends_with_name(self, at: int, end: int) -> bool:
        """Return whether a statement ends with the name that begins at ``at``, or with a reason behind it."""
        behind = at + named_noun(at, self.words)[1]
        behind += self._word(behind) in parts()
        return behind == end or self._word(behind) in _BEHIND_NAME

    def _is_question(self, at: int) -> bool:
        """Return whether a question about a state begins, such as "why is the box open?" or "is it late?"."""
        stop = next((n for n in range(at, len(self.words)) if self.words[n] in MARKS), len(self.words))
        word = self._word(at)
        if word == "how" and self._word(at + 1) in ("about", "come"):
            return False
        asked = word in ("why", "who", "what", "where", "how", "when", "which")
        asked |= word in ("is", "are", "was", "were", "has", "have", "had", "did", "does", "am")
        return asked and self._word(stop) == "?"

    def _is_fragment(self, at: int) -> bool:
        """Return whether a statement without a verb begins, such as "too cold in here"."""
        stop = self._stop(at)
        words = self.words[at:stop]
        if at and self.words[at - 1] not in _STOPS:
            return False
        if words[-1:] == ("time",) and stop - at <= 3 and not any(word in VERBS for word in words):
            return True
        if self._word(at) not in WORDS["fragments"] or stop - at > 6 or words in (("no",), ("not",), ("no", "more")):
            return False
        verbs = statement_verbs().base
        if self._word(at) in verbs and self._word(at + 1) in WORDS["determiners_of_statements"] | WORDS["pronouns"]:
            return False
        if self._word(at) == "nothing":
            return True
        if any(word in VERBS for word in words) or any(word in verbs for word in words[1:]):
            return False
        return self._word(at) in _ABOUT_OBJECTS or not any(self._names(n) for n in range(at, stop))

    def _closing(self, start: int, at: int) -> int:
        """Return the end of an aside: the next punctuation mark or conjunction behind which something new begins.

        Args:
            start: first word of the aside.
            at: first word that can belong to a statement.

        Raises:
            SentenceError: behind "and" comes an instruction that can also be a part of the aside.
        """
        n = max(at, start + 1)
        while n < len(self.words):
            word = self.words[n]
            if word in MARKS:
                return n
            if word == "," and not self._continues(n + 1):
                return n
            if word in ("and", "so", "then", "but", "or"):
                behind = n + 1
                while self._word(behind) in WORDS["adverbs"] | {"please"}:
                    behind += 1
                fresh = self.words[n + 1 : behind].count("please") > 0 or word in ("so", "but", "or")
                if self.asks(behind):
                    if not fresh and any(each in _POSSIBLE for each in self.words[start:n]):
                        text = " ".join(self.words[n : self._stop(n)])
                        raise SentenceError(Refusal.AMBIGUOUS, text, "write the instruction as a sentence of its own")
                    return n
                if self._word(behind) in ("do", "never", "not", "leave", "keep") or self._finite(behind) is not None:
                    return n
                imperative = self._word(behind) in statement_verbs().base or self._word(behind) in VERBS
                if imperative and (fresh or self._is_third_person(start, n)):
                    return n
            if word == "please" and self.asks(n + 1):
                return n
            if word in ("could", "can", "would", "will") and self._word(n + 1) == "you" and self.asks(n):
                return n
            n += 1
        return n

    def _is_third_person(self, start: int, end: int) -> bool:
        """Return whether the first statement of an aside has a subject with which a base form cannot agree."""
        plural = ("i", "we", "you", "they", "to", "can", "could", "will", "would", "may", "might", "must")
        return not any(word in plural for word in self.words[start:end])

    def _continues(self, at: int) -> bool:
        """Return whether the words behind a comma belong to the statement before it."""
        word = self._word(at)
        if word in WORDS["continues"]:
            return True
        if word in WORDS["determiners_of_statements"]:
            return self._finite(at) is None and not self._names(at)
        return False
