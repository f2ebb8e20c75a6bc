"""Parse a sentence into clauses: a verb with its modifiers, objects and prepositional phrases.

Every word of an instruction needs a role. Otherwise the parser refuses the sentence. Statements, reasons and polite
words (:mod:`~gensim2.instructions.asides`) only name objects for pronouns.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from gensim2.instructions import vocabulary
from gensim2.instructions.asides import MARKS, Asides
from gensim2.instructions.steps import Refusal, SentenceError
from gensim2.instructions.vocabulary import MODIFIERS, PHRASES, WORDS, Action, Noun, Phrases, Words

Pronoun = Literal["it", "them", "there"]


@dataclass(frozen=True)
class Mention:
    """A noun phrase.

    Attributes:
        text: the phrase as the user wrote it.
        noun: the noun; None for a pronoun, and for a part whose object is not named.
        part: part of the object, such as ``"lid"``.
        pronoun: the pronoun, if the phrase is one.
        state: ``"open"`` or ``"closed"`` if an adjective says so.
    """

    text: str
    noun: Noun | None = None
    part: str | None = None
    pronoun: Pronoun | None = None
    state: str | None = None


def _is_doors_handle(mention: Mention) -> bool:
    """Return whether a mention names the handle of a door or of a drawer."""
    if mention.part != "handle" or mention.noun is None:
        return False
    return mention.noun.name in ("door", "drawer") or vocabulary.own_part(mention.noun, "door") is not None


THERE = Mention("there", pronoun="there")


@dataclass
class Clause:
    """A verb with its objects.

    Attributes:
        text: the clause as the user wrote it.
        verbs: the verbs; two verbs share their objects, as in "open and close the box".
        modifiers: modifiers of the verb, in the order of the sentence.
        half: whether the clause has a modifier such as "halfway".
        objects: direct objects.
        into, onto, to, source: objects of the prepositional phrases.
        direction: direction in which an object is handed over.
        gripped: whether the clause names the part by which the object is taken, as in "by its handle".
        restates: whether the clause may say again what another clause asks for, as in "the box must be closed".
    """

    text: str
    verbs: tuple[str, ...]
    modifiers: list[str] = field(default_factory=list)
    half: bool = False
    objects: list[Mention] = field(default_factory=list)
    into: Mention | None = None
    onto: Mention | None = None
    to: Mention | None = None
    source: Mention | None = None
    direction: str | None = None
    gripped: bool = False
    restates: bool = False

    @property
    def actions(self) -> tuple[Action, ...]:
        """Actions that the verbs stand for.

        Raises:
            SentenceError: a verb does not go with the modifiers.
        """
        return tuple(self._action(verb) for verb in self.verbs)

    def _action(self, verb: str) -> Action:
        parts = {each.part for each in self.objects}
        if verb == "leave":
            if self.half and self.modifiers in ([], ["open"]):
                return Action.CLOSE
            raise SentenceError(Refusal.NOT_UNDERSTOOD, self.text, "say 'leave the door ajar', or what to do")
        modifiers = {*self.modifiers} - {"lifted"}
        found = vocabulary.VERBS[verb].get(tuple(sorted(modifiers)))
        lifted = "lifted" in self.modifiers and found not in (Action.LIFT, Action.TAKE)
        of_part = found in vocabulary.SWINGS
        of_part |= found in (Action.LIFT, Action.LOWER) and verb in WORDS["of_parts"]
        if found is None or lifted or (of_part and None in parts):
            raise SentenceError(Refusal.NOT_UNDERSTOOD, self.text, f"{verb!r} does not go with the other words")
        if found is Action.TAKE and not modifiers and verb in WORDS["grasps"] and (verb != "take" or self.gripped):
            return found
        if found is Action.PULL and all(_is_doors_handle(each) for each in self.objects):
            return Action.OPEN
        if parts & WORDS["covers"]:
            return vocabulary.OF_COVER.get(found, found)
        if parts & WORDS["pressed"]:
            return vocabulary.OF_PRESSED.get(found, found)
        return found


@dataclass(frozen=True)
class Statement:
    """A part of a sentence that asks for nothing.

    Attributes:
        text: the part as the user wrote it.
        mentions: noun phrases with a known noun.
        state: ``"open"`` or ``"closed"`` if the statement says that something is open or closed.
        is_topic: whether the part only names an object. The next clause must then refer to this object.
    """

    text: str
    mentions: tuple[Mention, ...]
    state: str | None = None
    is_topic: bool = False


class ClauseParser:
    """Parser of the clauses of one sentence.

    Args:
        sentence: the sentence as words.
    """

    def __init__(self, sentence: Words) -> None:
        self._words, self._at = sentence, 0
        self._understood: dict[int, bool] = {}
        self._asides = Asides(sentence, self._asks)

    def clauses(self) -> list[Clause | Statement]:
        """Return the clauses and statements in the order of the sentence.

        Raises:
            SentenceError: a part of the sentence is not understood.
        """
        found: list[Clause | Statement] = []
        try:
            while self._read(found):
                pass
        except SentenceError as error:
            negation = next((word for word in self._words[self._at :] if word in WORDS["negations"]), None)
            if negation is not None and error.reason != Refusal.AMBIGUOUS:
                raise SentenceError(Refusal.NEGATION, negation, "say only what to do") from error
            raise
        return found

    def _read(self, found: list[Clause | Statement]) -> bool:
        """Read the next clause or statement, and return whether there is one."""
        follows = self._at > 0 and bool(found) and isinstance(found[-1], Clause)
        follows &= self._word() not in MARKS
        self._skip(PHRASES["connectors"])
        if self._at == len(self._words):
            return False
        start, text = self._at, self._word()
        reason = max(PHRASES["reasons"].length(start, self._words), int(text == "so" and follows))
        if not reason or (end := self._asides.end(start, follows=follows)) == start:
            end = start
            self._at += text == "so" and start + 1 < len(self._words)
            self._skip(PHRASES["connectors"], PHRASES["polite"], PHRASES["neutral"])
            if self._at == len(self._words):
                return False
            try:
                found.append(self._instruction([each for each in found if isinstance(each, Clause)]))
                return True
            except SentenceError:
                failed, self._at = self._at, start
                if (end := self._asides.end(start, follows=follows)) == start:
                    self._skip(PHRASES["connectors"])
                    if (end := self._asides.end(self._at, follows=follows)) == self._at:
                        if (means := self._means(failed)) is not None:
                            found += means
                            return True
                        topic = self._topic(start)
                        if topic is not None:
                            found.append(topic)
                            return True
                        self._at = failed
                        raise
        found.append(self._statement(start, end))
        return True

    def _means(self, start: int) -> list[Clause | Statement] | None:
        """Read a purpose and the action that serves it, as in "start the toast by pushing the lever down"."""
        for at in range(start, len(self._words)):
            if self._words[at] in WORDS["ends"]:
                return None
            verb = vocabulary.GERUNDS.get(self._words[at + 1] if at + 1 < len(self._words) else "")
            if self._words[at] == "by" and verb is not None:
                purpose = self._statement(start, at)
                self._at = at + 2
                return [purpose, self._completed(Clause("", (verb,)), at)]
        return None

    def _topic(self, start: int) -> Statement | None:
        """Read an object that the next clause refers to, as in "the drawer, close it"."""
        self._at = start
        mention = self.mention(_OF_PART)
        if mention is None or mention.noun is None:
            return None
        self._skip(PHRASES["places"])
        return Statement(self._text(start), (mention,), is_topic=True) if self._ends() else None

    def _instruction(self, before: list[Clause]) -> Clause:
        """Read an instruction. Raise SentenceError if none begins here or it is not understood."""
        start = self._at
        more = self._state()
        if more is None and before:
            more = self._continuation(before[-1])
        if more is not None:
            return more
        verbs = self._verbs()
        if not verbs:
            raise self._no_verb(start)
        return self._completed(Clause("", verbs), start)

    def _asks(self, at: int) -> bool:
        """Return whether an instruction that the parser understands begins at a word."""
        # Without this table, the time would double with every reason that follows an instruction.
        if at not in self._understood:
            self._understood[at] = self._reads_at(at)
        return self._understood[at]

    def _reads_at(self, at: int) -> bool:
        """Try to read an instruction that begins at a word, and return whether that succeeds."""
        before, self._at = self._at, at
        try:
            self._skip(PHRASES["polite"], PHRASES["neutral"])
            if self._word() not in vocabulary.VERBS and not self._begins_wish():
                return False
            self._instruction([])
        except SentenceError:
            return False
        finally:
            self._at = before
        return True

    def _begins_wish(self) -> bool:
        """Return whether a phrase such as "make sure that" begins at the current word."""
        return PHRASES["wishes"].length(self._at, self._words) > 0

    def _statement(self, start: int, end: int) -> Statement:
        """Return the statement up to the word ``end``, and move there."""
        inner = ClauseParser(self._words[start:end])
        mentions: list[Mention] = []
        while (mention := inner.next_mention()) is not None:
            mentions.append(mention)
        said = [word for word in self._words[start:end] if word not in WORDS["adverbs"] or word == "not"]
        is_state = len(said) > 2 and said[-2] in ("is", "are", "'s")
        self._at = end
        return Statement(self._text(start), tuple(mentions), vocabulary.STATES.get(said[-1]) if is_state else None)

    def next_mention(self) -> Mention | None:
        """Return the next noun phrase with a known noun, and skip the words before it; None if there is no other."""
        while self._at < len(self._words):
            found = self._phrase(self._at, _OF_PART, take=True)
            if found is not None and found.noun is not None:
                return found
            self._at += 1
        return None

    def mention(self, attach: frozenset[str]) -> Mention | None:
        """Read a noun phrase, if one begins at the current word.

        Args:
            attach: prepositions that may join a part to its object, as in "the lid of the box".
        """
        start = self._at
        if self._word() in WORDS["it"] | WORDS["them"]:
            pronoun: Pronoun = "it" if self._word() in WORDS["it"] else "them"
            # "this" and "both" are also determiners
            after = self._phrase(start + 1)
            if after is None or self._word() in ("it", "them"):
                self._at = start + 1
                return Mention(self._words[start], pronoun=pronoun)
        return self._phrase(start, attach, take=True)

    def _phrase(self, start: int, attach: frozenset[str] = frozenset(), take: bool = False) -> Mention | None:
        """Return the noun phrase that begins at the word ``start``; with ``take``, also move behind it."""
        before, self._at = self._at, start
        found = self._noun_phrase(attach)
        if found is None or not take:
            self._at = before
        return found

    def _noun_phrase(self, attach: frozenset[str]) -> Mention | None:
        start, state = self._at, None
        while self._word() in WORDS["determiners"]:
            self._at += 1
        while True:
            noun, length = vocabulary.named_noun(self._at, self._words)
            if noun is not None:
                # "door" is a noun, and a part of other objects
                is_part = self._words[self._at] in vocabulary.parts() and self._joins(self._at + 1, attach)
                if not is_part:
                    self._at += length
                    own = self._word() == "'s"
                    self._at += own
                    part = self._own_part(noun)
                    self._at -= own and part is None
                    return Mention(self._text(start), noun, part, state=state)
            if self._word() in vocabulary.parts():
                part, self._at = self._word(), self._at + 1
                if self._joins(self._at, attach):
                    self._at += 1
                    inner = self._noun_phrase(frozenset())
                    assert inner is not None
                    part = vocabulary.own_part(inner.noun, part) or part
                    return Mention(self._text(start), inner.noun, part, state=state)
                return Mention(self._text(start), part=vocabulary.usual_part(part), state=state)
            word = self._word()
            if word in vocabulary.STATES:
                state = vocabulary.STATES[word]
            elif word not in WORDS["adjectives"]:
                return None
            self._at += 1

    def _joins(self, at: int, attach: frozenset[str]) -> bool:
        """Return whether a preposition and the object of a part come at the word ``at``."""
        if at >= len(self._words) or self._words[at] not in attach:
            return False
        found = self._phrase(at + 1)
        return found is not None and found.noun is not None

    def _own_part(self, noun: Noun) -> str | None:
        """Read a part that follows its object, as in "the microwave door"."""
        part = vocabulary.own_part(noun, self._word())
        if part is None and self._word() == "handle" and not noun.rigid:
            part = "handle"
        self._at += part is not None
        return part

    def _verbs(self) -> tuple[str, ...]:
        """Read one verb, or two verbs with the same objects; empty if no verb comes."""
        if (length := _PHRASAL.length(self._at, self._words)) > 0:
            self._at += length
            return (vocabulary.PHRASAL[self._words[self._at - length : self._at]],)
        self._at += self._word() == "do" and self._word(1) in vocabulary.VERBS
        first = self._word()
        if self._words[max(self._at - 2, 0) : self._at] == ("if", "you"):
            first = vocabulary.PARTICIPLES.get(first, first)
        if first not in vocabulary.VERBS:
            return ()
        self._at += 1
        if self._word() == "and" and self._word(1) in vocabulary.VERBS:
            self._at += 2
            return first, self._words[self._at - 1]
        return (first,)

    def _state(self) -> Clause | None:
        """Read a wish for a state, as in "make sure the box is shut", "the box must be closed" or "lid down"."""
        start = self._at
        for read in (self._gerund, self._light_verb, self._unwanted, self._wanted):
            found = read()
            if found is not None:
                return self._completed(found, start)
            self._at = start
        return None

    def _gerund(self) -> Clause | None:
        """Read a gerund and what comes before it, as in "would you mind closing" or "the box needs closing"."""
        start = self._at
        self._comes_longest(PHRASES["mind"])
        asked = self._at > start or any(
            self._words[max(start - len(each), 0) : start] == each for each in PHRASES["mind"]
        )
        verb = vocabulary.GERUNDS.get(self._word())
        if verb is not None and asked:
            self._at += 1
            return Clause("", (verb,))
        self._at = start
        wanted = self._placed_mention()
        if wanted is None or not self._comes_longest(PHRASES["needs"]):
            return None
        self._skip(PHRASES["neutral"])
        verb = vocabulary.GERUNDS.get(self._word())
        if verb is None:
            return None
        self._at += 1
        return Clause("", (verb,), objects=[wanted])

    def _light_verb(self) -> Clause | None:
        """Read a noun that stands for a verb, as in "give the lever a push"."""
        if not self._comes("give"):
            return None
        given = self.mention(_OF_PART)
        if given is None or self._word() not in ("a", "another", "one"):
            return None
        self._at += 1
        while self._word() in WORDS["adjectives"] | {"gentle", "quick", "firm", "light", "slight", "strong", "hard"}:
            self._at += 1
        if self._word() not in WORDS["nouns_of_verbs"]:
            return None
        self._at += 1
        return Clause("", (self._words[self._at - 1],), objects=[given])

    def _unwanted(self) -> Clause | None:
        """Read a state that is not wanted, as in "do not leave the box open" or "the water should not be running"."""
        start = self._at
        before = self._comes_longest(PHRASES["unwanted_before"])
        wishes = not before and self._comes_longest(PHRASES["wishes"])
        needs_left = before and self._words[self._at - 1] not in ("leave", "let", "keep", "have")
        wanted = self._placed_mention()
        if wanted is None:
            return None
        if not before and not self._comes_longest(PHRASES["unwanted"]):
            return None
        self._skip(PHRASES["neutral"])
        left = self._comes_longest(PHRASES["unwanted_after"])
        obliged = {"should", "must", "shall", "may", "can", "need", "ought"} & {*self._words[start : self._at]}
        needs_left |= before and self._words[start : start + 3] == ("do", "not", "let") and self._word() == "open"
        if (needs_left and not left) or not (before or wishes or obliged):
            return None
        modifier = self._modifier()
        opposite = vocabulary.OPPOSITES.get(modifier or "")
        stays = left or {"stay", "remain", "left", "standing"} & {*self._words[start : self._at]}
        if opposite is None or self._words[self._at - 1] == "opened" or (modifier == "shut" and not stays):
            return None
        return Clause("", ("have",), [opposite], objects=[wanted])

    def _wanted(self) -> Clause | None:
        """Read a state that is wanted, with or without a phrase that says so."""
        wishes = self._comes_longest(PHRASES["wishes"])
        asked = not wishes and self._word() in ("can", "could", "may") and "please" in self._words
        self._at += asked
        wanted = self._placed_mention()
        if wanted is None:
            return None
        self._skip(PHRASES["neutral"])
        obliged = self._comes("be") if asked else self._comes_longest(PHRASES["obligations"])
        linked = not obliged and wishes and self._comes_longest(PHRASES["links"])
        if not (obliged or wishes):
            return self._telegraphic(wanted)
        self._skip(PHRASES["neutral"])
        verb = vocabulary.PARTICIPLES.get(self._word())
        if verb in ("open", "close", "shut") and self._word() in vocabulary.STATES:
            verb = None
        before = self._words[self._at - 1]
        if verb is not None:
            self._at += 1
        elif (obliged or before == "to") and self._word() in WORDS["intransitive"] and before != "be":
            verb, self._at = self._word(), self._at + 1
        elif wanted.noun is not None and wanted.noun.rigid and self._begins_place():
            verb = "put"
        elif self._begins_state():
            verb = "have"
        if verb is None or (before in ("belongs", "belong") and linked):
            return None
        return Clause("", (verb,), objects=[wanted], restates=True)

    def _placed_mention(self) -> Mention | None:
        """Read an object with its place, as in "the box on the table"."""
        found = self.mention(_OF_PART)
        if found is not None and found.noun is not None and not found.noun.rigid:
            self._skip(PHRASES["places"])
        return found

    def _begins_place(self) -> bool:
        return any(PHRASES[name].length(self._at, self._words) for name in ("into", "onto"))

    def _begins_state(self) -> bool:
        return any(phrases.length(self._at, self._words) for phrases in MODIFIERS.values())

    def _telegraphic(self, wanted: Mention) -> Clause | None:
        """Read a state directly behind an object, as in "lid down"."""
        marks = (word for word in self._words[self._at :] if word in MARKS)
        if next(marks, "") == "?" and "please" not in self._words:
            return None
        clause = Clause("", ("have",), objects=[wanted])
        at = self._at
        self._comes(",")
        try:
            # "The door closed" is a statement, but "door closed, please" is not.
            past = self._word() in vocabulary.PARTICIPLES and wanted.text.split()[0] in WORDS["determiners"]
            if past or not (self._begins_state() or self._by_part()):
                return None
            self._complete(clause)
        except SentenceError:
            return None
        self._at = at
        return clause if clause.modifiers else None

    def _completed(self, clause: Clause, start: int) -> Clause:
        """Read the rest of a clause that begins at the word ``start``."""
        self._complete(clause)
        clause.text = self._text(start)
        return clause

    def _continuation(self, last: Clause) -> Clause | None:
        """Read a clause that shares the verb of the clause before.

        Examples are "... and off again" and "... and the pear".
        """
        start, verb = self._at, last.verbs[-1]
        modifier = self._modifier()
        self._skip(PHRASES["neutral"])
        ends = self._ends()
        if not ends and self._word() not in WORDS["determiners"]:
            ends = self._asides.end(self._at, follows=True) > self._at
        if modifier is not None and modifier != "half" and ends:
            return Clause(self._text(start), (verb,), [modifier], objects=list(last.objects), restates=True)
        self._at = start
        if self._word() in vocabulary.VERBS and self._phrase(start) is None:
            return None
        clause = Clause("", (verb,))
        if self._phrase(start) is None or Action.PUT not in vocabulary.VERBS[verb].values():
            return None
        return self._completed(clause, start)

    def _complete(self, clause: Clause) -> None:
        """Read everything that belongs to the verb of a clause."""
        attach = frozenset(("of",)) if self._puts(clause) else _OF_PART
        while True:
            if self._by_part():
                clause.gripped = True
                continue
            if clause.objects and (self._more_modifiers(clause) or self._result(clause)):
                continue
            if self._ends():
                break
            if clause.objects and (self._same_object(clause) or self._prepositional(clause)):
                continue
            if not clause.objects and self._objects(clause, attach):
                continue
            if self._word() == "to" and self._ends(1):
                self._at += 1
                clause.modifiers.append("shut")
                continue
            if self._comes("half", "open"):
                clause.half = True
                clause.modifiers.append("open")
                continue
            if (clause.modifiers or not self._puts(clause)) and self._skip(PHRASES["places"]):
                continue
            modifier = self._modifier()
            if modifier is not None:
                clause.half |= modifier == "half"
                clause.modifiers += [modifier] if modifier != "half" else []
                continue
            if self._skip(PHRASES["neutral"]):
                continue
            if clause.objects and self._comes("but", "leave", "it", "ajar"):
                clause.half = True
                continue
            if clause.objects and self._asides.end(self._at, follows=True) > self._at:
                break
            raise self._unknown(clause)
        # To turn something down is not to turn it off.
        clause.half |= "turn" in clause.verbs and clause.modifiers == ["down"]

    def _puts(self, clause: Clause) -> bool:
        """Return whether the verb can take a destination, so that "on" does not join a part to its object."""
        return any(Action.PUT in vocabulary.VERBS[verb].values() for verb in clause.verbs)

    def _objects(self, clause: Clause, attach: frozenset[str]) -> bool:
        """Read the direct objects of a verb, such as "the apple, the pear and the plum"."""
        first = self.mention(attach)
        if first is None:
            return False
        clause.objects.append(first)
        while True:
            before = self._at
            comma, conjunction = self._comes(","), self._comes("and")
            more = None
            if (comma or conjunction) and not (self._word() in vocabulary.VERBS and self._phrase(self._at) is None):
                more = self.mention(attach)
            # A pronoun after "and" would be the object of another verb.
            if more is None or more.pronoun is not None:
                self._at = before
                return True
            clause.objects.append(more)

    def _prepositional(self, clause: Clause) -> bool:
        """Read a prepositional phrase or a word such as "there"."""
        if Action.HAND in {a for verb in clause.verbs for a in vocabulary.VERBS[verb].values()}:
            for direction, phrases in vocabulary.HANDING.items():
                if (length := phrases.length(self._at, self._words)) > 0:
                    self._at += length
                    clause.direction = direction
                    return True
        puts = self._puts(clause)
        takes = Action.TAKE in {a for verb in clause.verbs for a in vocabulary.VERBS[verb].values()}
        for field_name in ("into", "onto", "to", "source"):
            length = PHRASES["out_of" if field_name == "source" else field_name].length(self._at, self._words)
            if length and getattr(clause, field_name) is None:
                end = self._at + length
                before, self._at = self._at, end
                found = self.mention(frozenset(("of",)))
                if found is None or (found.noun is None and found.pronoun is None):
                    self._at = before
                    continue
                setattr(clause, field_name, found)
                return True
        if puts and clause.into is None and clause.onto is None and clause.to is None:
            length = PHRASES["there"].length(self._at, self._words)
            if length and self._words[self._at] != "away":
                self._at += length
                clause.into = THERE
                return True
        away = MODIFIERS["away"].length(self._at, self._words) > 0
        if takes and not away and clause.source is None and self._comes("out"):
            clause.source = THERE
            return True
        return False

    def _same_object(self, clause: Clause) -> bool:
        """Read a phrase that names the object a second time with another noun, as in "the water from the tap"."""
        start, first = self._at, clause.objects[0]
        if self._comes_longest(PHRASES["of_same"]):
            found = self.mention(frozenset())
            if (
                found is not None
                and found.noun is not None
                and found.noun is first.noun
                and found.text.split()[-1] != first.text.split()[-1]
            ):
                return True
        self._at = start
        return False

    def _by_part(self) -> bool:
        """Read a phrase such as "by its handle"."""
        start = self._at
        self._comes(",")
        if self._comes_longest(PHRASES["by_part"]):
            self._at += self._word() in WORDS["determiners"]
            if self._word() in vocabulary.parts():
                self._at += 1
                return True
        self._at = start
        return False

    def _more_modifiers(self, clause: Clause) -> bool:
        """Read modifiers behind a comma, as in "push it back, away from me"."""
        start = self._at
        modifier = self._modifier() if self._comes(",") else None
        if modifier in ("away", "back", "closer", "over", "half") and (self._ends() or self._skip(PHRASES["neutral"])):
            clause.half |= modifier == "half"
            clause.modifiers += [modifier] if modifier != "half" else []
            return True
        self._at = start
        return False

    def _result(self, clause: Clause) -> bool:
        """Read the state in which a motion ends, as in "until it is shut"."""
        start = self._at
        if self._comes_longest(PHRASES["results_ends"]):
            return True
        if self._comes_longest(PHRASES["results"]) and self.mention(_OF_PART) is not None:
            self._comes_longest(PHRASES["results_links"])
            self._skip(PHRASES["neutral"])
            word = self._word()
            verb = vocabulary.PARTICIPLES.get(word, word.removesuffix("s"))
            modifier = {"close": "shut", "shut": "shut", "open": "open"}.get(verb) or self._modifier()
            self._at += verb in ("close", "shut", "open")
            actions = [vocabulary.VERBS[verb] for verb in clause.verbs]
            if modifier is not None and self._ends():
                wanted = tuple(sorted({*clause.modifiers, modifier}))
                clause.modifiers += [modifier] if all(wanted in each for each in actions) else []
                return True
        self._at = start
        return False

    def _modifier(self) -> str | None:
        """Read a modifier, such as "off" or "halfway", if one comes."""
        best = max(MODIFIERS, key=lambda name: MODIFIERS[name].length(self._at, self._words))
        length = MODIFIERS[best].length(self._at, self._words)
        self._at += length
        return best if length else None

    def _skip(self, *groups: Phrases) -> bool:
        """Skip phrases without meaning, and return whether there were any."""
        start = self._at
        while (length := max(group.length(self._at, self._words) for group in groups)) > 0:
            self._at += length
        return self._at > start

    def _comes(self, *phrase: str) -> bool:
        """Read a phrase, if it comes next."""
        if self._words[self._at : self._at + len(phrase)] != phrase:
            return False
        self._at += len(phrase)
        return True

    def _comes_longest(self, phrases: Phrases) -> bool:
        """Read the longest of several phrases, if one comes next."""
        length = phrases.length(self._at, self._words)
        self._at += length
        return length > 0

    def _ends(self, ahead: int = 0) -> bool:
        """Return whether the clause ends at the current word, or ``ahead`` words behind it."""
        at = self._at + ahead
        groups = ("connectors", "neutral") if ahead else ("connectors",)
        return at == len(self._words) or any(PHRASES[name].length(at, self._words) for name in groups)

    def _word(self, ahead: int = 0) -> str:
        at = self._at + ahead
        return self._words[at] if at < len(self._words) else ""

    def _text(self, start: int) -> str:
        return " ".join(self._words[start : self._at]).replace(" 's", "'s")

    def _rest(self) -> str:
        """Return the words up to the next connector, for error messages."""
        start, end = self._at, self._at
        while end < len(self._words) and (end == start or self._words[end] not in WORDS["ends"]):
            end += 1
        return " ".join(self._words[start:end]).replace(" 's", "'s")

    def _no_verb(self, start: int) -> SentenceError:
        self._at = start
        return SentenceError(Refusal.UNKNOWN_VERB, self._rest(), known_verbs())

    def _unknown(self, clause: Clause) -> SentenceError:
        """Return the error for a word in a clause that has no role."""
        rest = self._rest()
        follows_determiner = self._word() in WORDS["determiners"]
        if not clause.objects or follows_determiner or self._words[self._at - 1] in _PREPOSITIONS:
            return SentenceError(Refusal.UNKNOWN_OBJECT, rest, known_objects())
        if any(PHRASES[name].length(self._at, self._words) for name in _PLACING):
            return SentenceError(Refusal.UNKNOWN_OBJECT, rest, known_objects())
        return SentenceError(Refusal.NOT_UNDERSTOOD, rest, "leave these words out, or use other words")


def known_verbs() -> str:
    """Return the hint that lists what the program can do."""
    return (
        "I know how to open, close, turn on, turn off, push, pull, press, lift, lower and swing objects, to put things "
        "into or onto others, and to take them out"
    )


def known_objects() -> str:
    """Return the hint that lists the objects."""
    names = dict.fromkeys(each.name for each in vocabulary.nouns().values() if not each.rigid)
    return f"I know {', '.join(names)}, and things such as apple, mug, marker or tennis ball"


#: Prepositions that join a part to its object, as in "the lid on the box".
_OF_PART = frozenset(("of", "on", "off", "from", "to"))
_PLACING = ("into", "onto", "to", "out_of")
_PREPOSITIONS = {phrase[-1] for name in _PLACING for phrase in PHRASES[name]}
_PHRASAL = Phrases(" ".join(each) for each in vocabulary.PHRASAL)
