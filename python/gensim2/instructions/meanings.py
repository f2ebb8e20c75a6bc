"""Find the joint goal of an action.

For example, pressing a stapler closes its joint, and pressing the lever of a toaster opens its joint.

Meanings come from the parsed sentences of ``objects/words.toml``, so a new class needs no code.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

from gensim2.instructions import vocabulary
from gensim2.instructions.clauses import Clause, ClauseParser, Mention
from gensim2.instructions.steps import MoveJoint
from gensim2.instructions.vocabulary import Action, spelled
from gensim2.objects import words
from gensim2.objects.words import GOALS, Goal, halfway
from gensim2.tasks.library import load_task, task_names
from gensim2.tasks.likeness import joint_goal

#: Actions that may replace an action for which an object has no meaning, in order of preference.
_INSTEAD = {
    Action.OPEN: (Action.SLIDE_OPEN, Action.TURN_ON),
    Action.CLOSE: (Action.SLIDE_SHUT, Action.TURN_OFF),
    Action.SLIDE_OPEN: (Action.OPEN,),
    Action.SLIDE_SHUT: (Action.CLOSE,),
    Action.TURN_ON: (Action.PRESS,),
}

#: Actions on a whole object, which differ from the same action on a part of it.
_OF_WHOLE = (Action.LIFT, Action.LOWER, Action.PUSH, Action.PULL)


@dataclass(frozen=True)
class _Key:
    """An action on an object.

    Attributes:
        part: part of the object that the action moves; None for the object itself.
        action, half: the action, and whether the joint stops halfway.
    """

    noun: str
    part: str | None
    action: Action
    half: bool


def meaning(mention: Mention, action: Action, half: bool) -> MoveJoint | None:
    """Return the joint goal that an action on an object stands for; None if there is none.

    Args:
        mention: the object, with a noun.
        half: whether the joint stops halfway.
    """
    if mention.noun is None or mention.noun.rigid:
        return None
    for each in (action, *_INSTEAD.get(action, ())):
        for part in dict.fromkeys((mention.part, None)):
            found = _meanings().get(_Key(mention.noun.name, part, each, half))
            if found is not None and (mention.part is None or mention.part in words.parts(found.asset_class)):
                return found
    return None


@cache
def solved() -> dict[MoveJoint, str]:
    """Return the joint goals of the library's tasks with the name of the task. The tasks of the paper come first."""
    found: dict[MoveJoint, str] = {}
    for name in dict.fromkeys((*task_names("paper"), *task_names())):
        goal = joint_goal(load_task(name))
        if goal is not None:
            found.setdefault(MoveJoint(*goal), name)
    return found


def possible(noun: vocabulary.Noun) -> list[str]:
    """Return instructions for the objects of a noun that a task of the library carries out."""
    return [each.text for each in solved() if each.asset_class in noun.classes]


@cache
def _meanings() -> dict[_Key, MoveJoint]:
    exact: dict[_Key, MoveJoint] = {}
    of_whole: dict[_Key, MoveJoint] = {}
    for asset_class in words.articulated_classes():
        for goal in GOALS:
            sentence = _sentence(asset_class, goal)
            if sentence is None:
                continue
            (clause,) = (each for each in ClauseParser(spelled(sentence)).clauses() if isinstance(each, Clause))
            (action,) = clause.actions
            mention = clause.onto if clause.onto is not None else clause.objects[0]
            assert mention.noun is not None, sentence
            part = mention.part or clause.objects[0].part
            step = MoveJoint(asset_class, goal)
            key = _Key(mention.noun.name, part, action, clause.half)
            assert key not in exact, f"{sentence}: {exact[key]}"
            exact[key] = step
            if part is not None and action not in _OF_WHOLE:
                of_whole.setdefault(_Key(mention.noun.name, None, action, clause.half), step)
    return {**of_whole, **exact}


def _sentence(asset_class: str, goal: Goal) -> str | None:
    """Return the sentence of ``words.toml`` for a joint goal; None if people do not ask for it."""
    if goal == "articulated_open" or goal == "articulated_closed":
        return words.words(asset_class, goal).sentence
    phrase = halfway(asset_class, goal)
    return None if phrase is None else phrase.sentence
