"""Collect the questions, answers and costs of a language model for the report."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from gensim2.design.llm.conversations import ConversationRecord, read_log
from gensim2.design.llm.store import MODEL_FOLDER, MODEL_JSON, AnswerRecord, AnswerStore

#: Maximum number of characters shown of an answer.
SHOWN_ANSWER = 20_000

#: Stages in the order in which a task is designed.
STAGES = (
    "proposal",
    "composition",
    "free",
    "reflection",
    "decomposition",
    "code",
    "constraints",
    "constraints_visual",
    "motions",
    "motions_visual",
    "regeneration",
)


class ModelReport:
    """Reads the conversations of one run folder for the report.

    Args:
        run_dir: run folder.

    Raises:
        InputError: a file of the folder is damaged.
    """

    def __init__(self, run_dir: Path) -> None:
        folder = run_dir / MODEL_FOLDER
        self._store = AnswerStore(folder)
        self._model = self._store.model().model if (folder / MODEL_JSON).exists() else None
        self._conversations = read_log(folder).conversations

    def of_task(self, name: str) -> dict[str, Any] | None:
        """Return the conversations about a task and their cost; None without conversations."""
        own = [each for each in self._conversations if each.subject == name]
        return self._told(own) if own else None

    def of_run(self) -> dict[str, Any] | None:
        """Return the model, its questions, outcomes, costs, and the conversations without a result.

        Return None if there is no model.
        """
        if self._model is None:
            return None
        stages = sorted({each.stage for each in self._conversations}, key=_rank)
        nameless = [each for each in self._conversations if not each.subject]
        return {
            "model": self._model,
            "stages": [self._stage(stage) for stage in stages],
            "sums": self._sums(self._conversations),
            "nameless": self._told(nameless) if nameless else None,
        }

    def _stage(self, stage: str) -> dict[str, Any]:
        own = [each for each in self._conversations if each.stage == stage]
        return {
            "name": stage,
            "questions": len(own),
            **{word: sum(each.outcome == word for each in own) for word in ("used", "refused", "dropped")},
            "complaints": sum(len(each.turns) - (each.outcome != "dropped") for each in own),
            **self._sums(own),
        }

    def _told(self, conversations: Sequence[ConversationRecord]) -> dict[str, Any]:
        ordered = sorted(conversations, key=lambda each: (_rank(each.stage), each.about))
        return {"conversations": [self._conversation(each) for each in ordered], "sums": self._sums(conversations)}

    def _conversation(self, given: ConversationRecord) -> dict[str, Any]:
        turns = []
        for turn in given.turns:
            record = self._store.record(turn.answer)
            if record is not None:
                turns.append(
                    {
                        "question": str(record.messages[-1]["text"]),
                        "pictures": record.messages[1].get("pictures", []) if len(record.messages) == 2 else [],
                        "answer": record.text[:SHOWN_ANSWER],
                        "more": max(0, len(record.text) - SHOWN_ANSWER),
                        "problems": turn.problems,
                    }
                )
        return {
            "stage": given.stage.replace("_", ", "),
            "about": given.about,
            "outcome": given.outcome,
            "reason": given.reason,
            "turns": turns,
        }

    def _sums(self, conversations: Iterable[ConversationRecord]) -> dict[str, Any]:
        """Return totals of answers, retries, tokens and USD; ``cost`` is None if the prices are unknown."""
        records = [self._store.record(turn.answer) for each in conversations for turn in each.turns]
        found: list[AnswerRecord] = [record for record in records if record is not None]
        costs = [record.cost for record in found]
        return {
            "answers": len(found),
            "retries": sum(record.retries for record in found),
            "tokens_in": sum(record.tokens_in for record in found),
            "tokens_out": sum(record.tokens_out for record in found),
            "estimated": any(not record.counted for record in found),
            "cost": None if None in costs else sum(cost for cost in costs if cost is not None),
        }


def _rank(stage: str) -> int:
    return STAGES.index(stage) if stage in STAGES else len(STAGES)
