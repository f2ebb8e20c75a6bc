"""Ask a model for solver configs of a step in two stages (constraints, then motions), optionally with pictures."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Protocol

from pydantic import TypeAdapter, ValidationError

from gensim2.core.errors import InputError
from gensim2.core.validation import input_error
from gensim2.design.base import Brief, CandidateResult
from gensim2.design.llm.conversations import Conversations
from gensim2.design.llm.stages import solving
from gensim2.design.llm.stages.solving import CaptionedPictures, Config, StepToSolve
from gensim2.design.pictures import LazyPicture
from gensim2.tasks.spec import Step, TaskSpec
from gensim2.tasks.strategies import Strategies

Mode = Literal["explore", "topdown", "bottomup", "free"]

#: Prompts show up to ``SHOWN_BEST`` of the best configs, and up to ``SHOWN_NEW`` other configs, newest first.
SHOWN_BEST, SHOWN_NEW = 3, 3

FRAMES = "red, green, blue: x, y, z of the frames of the robot's base and of the object, whose keypoints are named"


class Views(Protocol):
    """Renders pictures of scenes for a model.

    The pictures show the robot's frame, the object's frame and the object's keypoints.
    """

    def start(self, task: TaskSpec, step: str) -> LazyPicture:
        """Return a picture of the initial scene.

        The picture shows coordinate frames and the keypoints of the object of ``step``.
        """
        ...

    def actuation(self, task: TaskSpec, steps: Mapping[str, Strategies], step: str) -> LazyPicture:
        """Return a picture of the initial scene.

        The arm is at the actuation pose of the strategies of ``step``.
        """
        ...


@dataclass(frozen=True)
class Asking:
    """Settings for requesting designs from a model.

    Attributes:
        mode: tasks to request. ``"explore"``: tasks with a single step; ``"topdown"``: long tasks that the model
            decomposes; ``"bottomup"``: long tasks composed of verified tasks; ``"free"``: tasks with several objects,
            grasped tools and all criteria.
        target_task: name of the task to propose; None: any.
        target_object: class that each task must use; None: any.
        trials: number of configs that are requested at once for a step.
        max_rounds: maximum number of answers to one question, and maximum number of rounds that improve simulated
            configs.
        visual: whether to send pictures.
        code: whether to request code that defines each task, in addition to its description.
    """

    mode: Mode = "explore"
    target_task: str | None = None
    target_object: str | None = None
    trials: int = 3
    max_rounds: int = 3
    visual: bool = False
    code: bool = False

    @staticmethod
    def read(fields: Mapping[str, Any], file: Path) -> Asking:
        """Return the settings that the record of a run stores.

        Args:
            fields: content of the field ``asking`` in ``model.json``.
            file: path of ``model.json``, for error messages.

        Raises:
            InputError: a field is unknown or invalid.
        """
        unknown = sorted(fields.keys() - Asking.__dataclass_fields__.keys())
        if unknown:
            raise InputError("unknown field", file=file, field=f"asking.{unknown[0]}")
        try:
            return TypeAdapter(Asking).validate_json(json.dumps(fields), strict=True)
        except ValidationError as error:
            raise input_error(error, file=file, within="asking") from error


class Solutions:
    """Asks a model for solver configs of steps.

    Args:
        talk: conversations with the model.
        asking: requested designs: mode, target task or object, and number of configs.
        views: renderer of scenes; None: no pictures of scenes.
    """

    def __init__(self, talk: Conversations, asking: Asking, views: Views | None) -> None:
        self.talk, self.asking, self.views = talk, asking, views

    def configs(self, job: StepToSolve, brief: Brief, fixed: Mapping[str, Strategies]) -> list[Config]:
        """Ask for the configs of one step, in both stages, and return them."""
        sight = self._sight(job)
        found, _ = self.talk.ask(solving.constraints(self.talk.prompts, job, brief.known, sight))
        sight = self._with_actuation(job, found, fixed, sight)
        trials, _ = self.talk.ask(
            solving.motions(self.talk.prompts, job, brief.known, found, self.asking.trials, sight)
        )
        return trials

    def _sight(self, job: StepToSolve) -> CaptionedPictures:
        """Return pictures of the step's objects and of the scene; none if not requested or not available."""
        if not self.asking.visual:
            return CaptionedPictures()
        captions, pictures = [], []
        for thing in (job.things[job.step.object], job.held):
            if thing is not None and thing.picture is not None:
                captions.append(
                    f"`{thing.asset_class}`, seen from the side of the robot, its keypoints marked and named"
                )
                pictures.append(thing.picture)
        if self.views is not None:
            captions.append(f"the scene at the start; {FRAMES}")
            pictures.append(self.views.start(job.task, job.step.name))
        return CaptionedPictures(tuple(captions), tuple(pictures))

    def _with_actuation(
        self, job: StepToSolve, constraint_list: list[Any], fixed: Mapping[str, Strategies], sight: CaptionedPictures
    ) -> CaptionedPictures:
        """Add a picture of the arm at the actuation pose that satisfies the constraints of stage 1."""
        if not self.asking.visual or self.views is None:
            return sight
        fingers = "closed" if job.held is None else "release"
        name = job.step.strategies[0]
        config = {
            "constraint_list": constraint_list,
            "pre_actuation_motions": [["translate_z", -0.08]],
            "gripper": fingers,
        }
        picture = self.views.actuation(job.task, {**fixed, job.step.name: {name: config}}, job.step.name)
        caption = (
            "the arm at the actuation pose that the constraints below lead to (where no motion gets there, the frame "
            f"of the hand alone); {FRAMES}, and of the hand"
        )
        return CaptionedPictures((*sight.captions, caption), (*sight.pictures, picture))


def tried_of(step: Step, results: Sequence[CandidateResult]) -> list[solving.Tried]:
    """Return the solver configs that were tried, with their results.

    The list has up to ``SHOWN_BEST`` best configs, followed by up to ``SHOWN_NEW`` newest other configs.

    Args:
        step: step for which the configs were written.
        results: results of the candidates that use the configs, best first.
    """
    name = step.strategies[0]
    distinct: dict[str, CandidateResult] = {}
    for result in results:
        distinct.setdefault(json.dumps(result.candidate.steps[step.name][name], sort_keys=True), result)
    ranked = list(distinct.values())
    rest = sorted(ranked[SHOWN_BEST:], key=lambda result: -int(result.candidate.provenance.get("round", 0)))
    return [_tried(step, result) for result in (*ranked[:SHOWN_BEST], *rest[:SHOWN_NEW])]


def _tried(step: Step, result: CandidateResult) -> solving.Tried:
    """Return a config and its results in words: success rates by object, and failures in planning and simulation."""
    told = f"Planned on {result.plan_score:.0%} of the scenes."
    if result.episodes:
        told += f" In physics it succeeded in {result.held:.0f} of {result.episodes} episodes."
    if len(result.candidate.steps[step.name]) > 1:
        told += " Where it had no plan, other configs of the step were used."
    if len(result.by_object) > 1:
        rates = ", ".join(f"{each} {held} of {count}" for each, (held, count) in result.by_object.items())
        told += f" By object: {rates}."
    words = tuple(
        f"{'planning' if stage.name == 'plan' else 'physics'}, {diagnosis}"
        for stage in result.stages
        for diagnosis in stage.diagnoses
        if diagnosis.step in (None, step.name)
    )
    return solving.Tried(result.candidate.steps[step.name][step.strategies[0]], told, tuple(dict.fromkeys(words)))


def in_words(config: Config) -> str:
    """Return one phrase that describes a solver config."""
    points = [each["target_keypoint_name"] for each in config["constraint_list"] if "target_keypoint_name" in each]
    motions = [
        " ".join(f"{part:g}" if isinstance(part, int | float) else str(part) for part in motion)
        if isinstance(motion, list)
        else str(motion)
        for motion in config.get("post_actuation_motions", [])
    ]
    target = str(points[0]).removeprefix("articulated_object_") if points else "its part"
    return f"{config.get('gripper', 'open')} at {target}" + (f", {', '.join(motions)}" if motions else "")
