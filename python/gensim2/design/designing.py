"""Create the designer that the user selected: offline or a language model."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from gensim2.core.errors import InputError
from gensim2.core.files import cache_dir
from gensim2.design import OfflineDesigner
from gensim2.design.base import Brief, Candidate, CandidateResult, Designer
from gensim2.design.llm import AnswerStore, Asking, LanguageModel, LLMDesigner, Mode, Prompts, model_options
from gensim2.design.llm.store import recorded_answers
from gensim2.design.views import SceneViews
from gensim2.scenes.config import SceneOptions
from gensim2.tasks.spec import TaskSpec


class Chosen:
    """Designer that filters the proposals of another designer.

    Args:
        designer: designer that proposes tasks and writes candidates.
        accepts: function that returns whether to accept a proposal.
        left_out: end of the note on proposals that were rejected, such as ``"are not wanted"``.
        wish: name of the filter in the run folder. A resumed run must have the same name. None: no name.
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
        return self.designer.name

    @property
    def notes(self) -> Sequence[str]:
        left = [f"{len(self._left)} proposals {self.left_out}"] if self._left else []
        return [*self.designer.notes, *left]

    @property
    def patience(self) -> int:
        return self.designer.patience

    def open(self, folder: Path) -> None:
        self.designer.open(folder)

    def propose(self, brief: Brief, seed: int) -> Iterator[TaskSpec]:
        for task in self.designer.propose(brief, seed):
            if self.accepts(task):
                yield task
            else:
                self._left.append(task.name)

    def candidates(self, task: TaskSpec, brief: Brief, seed: int) -> list[Candidate]:
        return self.designer.candidates(task, brief, seed)

    def refine(
        self, task: TaskSpec, brief: Brief, results: Sequence[CandidateResult], seed: int, round: int
    ) -> list[Candidate]:
        return self.designer.refine(task, brief, results, seed, round)


def offline_designer(
    mode: Mode | None = None, target_object: str | None = None, review: Callable[[TaskSpec], bool] | None = None
) -> Designer:
    """Return the designer that works without a language model.

    Args:
        mode: ``"explore"`` for tasks of one step, ``"bottomup"`` for tasks of several steps; None: both.
        target_object: class that every task must use; None: any.
        review: function that returns whether to accept a proposal; None: accept all proposals.
    """
    designer: Designer = OfflineDesigner()
    if mode is not None:
        designer = Chosen(
            designer, lambda task: task.is_single_step == (mode == "explore"), f"are not for {mode}", mode
        )
    if target_object is not None:

        def is_about_it(task: TaskSpec) -> bool:
            return target_object in {thing.asset_class for thing in task.objects.values()}

        designer = Chosen(designer, is_about_it, f"are not about {target_object}", target_object)
    return _reviewed(designer, review)


def model_designer(
    model: str | None,
    asking: Asking,
    scene: SceneOptions,
    *,
    prompts: Path | None = None,
    replay: Path | None = None,
    config: Path | None = None,
    review: Callable[[TaskSpec], bool] | None = None,
    **options: Any,
) -> Designer:
    """Return a designer that queries a language model.

    Args:
        model: name of the model, as the provider names it. None selects the name in ``config`` or ``replay``.
        asking: mode, targets and number of trials.
        scene: scene options of the run, for the pictures shown to the model.
        prompts: folder of the user's own prompts.
        replay: run folder with recorded answers. Its settings replace ``model`` and ``asking``.
        config: YAML file with fields of :class:`~gensim2.design.llm.ModelOptions`.
        review: function that returns whether to accept a proposal; None accepts all proposals.
        **options: fields of :class:`~gensim2.design.llm.ModelOptions`. All that are not None replace values of
            ``config``.

    Raises:
        InputError: an argument cannot be used.
        MissingExtraError: the extra ``llm`` is not installed.
    """
    texts = Prompts(prompts)
    if replay is None:
        given = model_options(config, model=model, **options)
    else:
        replay = recorded_answers(replay)
        recorded = AnswerStore(replay).model()
        if recorded.prompts != texts.digest:
            remedy = "use the same --prompts as the recorded run"
            wrong = "the recorded run used different prompts from the current prompts"
            raise InputError(wrong, file=replay, remedy=remedy)
        given, asking = recorded.options, Asking.read(recorded.asking, replay)
    asked = LanguageModel(given, texts.digest, asdict(asking), cache=cache_dir() / "answers", replay=replay)
    views = None
    if asking.visual:
        views = SceneViews(scene)
    return _reviewed(LLMDesigner(asked, texts, asking, scene.robot, views), review)


def _reviewed(designer: Designer, review: Callable[[TaskSpec], bool] | None) -> Designer:
    return designer if review is None else Chosen(designer, review, "were rejected in the review")
