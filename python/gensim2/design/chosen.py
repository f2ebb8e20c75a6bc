"""A designer whose proposals are chosen among: by a person who is asked, or a wish for one class of objects."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from gensim2.design.base import Brief, Candidate, CandidateResult, Designer
from gensim2.tasks.spec import TaskSpec


class Chosen:
    """Fills :class:`~gensim2.design.base.Designer` for another designer.

    Args:
        designer: proposes and designs.
        accepts: says of a proposal whether it is to be designed.
        left_out: what is said of those that are not: ``"are not wanted"``.
        wish: what is wished for, in a word that a resumed run must repeat; None: whoever is asked says it anew.
    """

    def __init__(
        self, designer: Designer, accepts: Callable[[TaskSpec], bool], left_out: str, wish: str | None = None
    ) -> None:
        self.designer, self.accepts, self.left_out = designer, accepts, left_out
        inner = designer.wish if isinstance(designer, Chosen) else None
        self.wish: str | None = ", ".join(each for each in (inner, wish) if each) or None
        self._left: list[str] = []

    @property
    def name(self) -> str:
        """The other's."""
        return self.designer.name

    @property
    def notes(self) -> Sequence[str]:
        """The other's, and what was left out."""
        left = [f"{len(self._left)} proposals {self.left_out}"] if self._left else []
        return [*self.designer.notes, *left]

    def open(self, folder: Path) -> None:
        """As the other."""
        self.designer.open(folder)

    def propose(self, brief: Brief, seed: int) -> Iterator[TaskSpec]:
        """Yield the other's proposals that are accepted."""
        for task in self.designer.propose(brief, seed):
            if self.accepts(task):
                yield task
            else:
                self._left.append(task.name)

    def candidates(self, task: TaskSpec, brief: Brief, seed: int) -> list[Candidate]:
        """As the other."""
        return self.designer.candidates(task, brief, seed)

    def refine(
        self, task: TaskSpec, brief: Brief, results: Sequence[CandidateResult], seed: int, round: int
    ) -> list[Candidate]:
        """As the other."""
        return self.designer.refine(task, brief, results, seed, round)
