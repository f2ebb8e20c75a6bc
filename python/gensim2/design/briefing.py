"""Summarize an object library and a robot as the input of a designer."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from gensim2.core import seeding
from gensim2.core.errors import InputError
from gensim2.core.progress import Progress
from gensim2.data.runfolder import RunFolder
from gensim2.design.affordance import Affordance
from gensim2.design.base import RobotSummary
from gensim2.design.unseen import seen_by_search
from gensim2.design.views import view_of
from gensim2.objects import ArticulatedObject, Library, RigidObject
from gensim2.objects.library.catalogue import SETS
from gensim2.objects.library.meshes import listed
from gensim2.robots import robot
from gensim2.rollout.inputs import has_instances

#: Number of instances over which the values of an affordance are averaged.
AFFORDANCE_INSTANCES = 3
#: Maximum number of classes that a note lists by name.
NAMED = 6


def robot_summary(name: str) -> RobotSummary:
    """Return the summary of a robot for designers."""
    profile = robot(name)
    x, y, _ = profile.base_position
    return RobotSummary(
        robot=profile.name,
        base=(x, y),
        reach=profile.reach,
        stroke=profile.gripper.widest,
        tool_keypoints=dict(profile.tool_keypoint_descriptions),
    )


def _left_out(instances: str, classes: Sequence[str]) -> str:
    what = f"{instances} objects" if instances in SETS else f"an object {instances!r}"
    return f"classes without {what} are left out: {listed(classes, NAMED)}"


class Classes(Mapping[str, Affordance]):
    """Lazy mapping from a library's classes to their affordances (summaries), articulated classes first.

    Args:
        library: object library.
        instances: value of ``--instances``; classes without any are left out.
        seed: seed of the order of classes and of the sampled instances.
        folder: run folder, which records the sampled objects.
        progress: progress listener.

    Attributes:
        notes: classes and instances that were left out, with the reasons.
    """

    def __init__(self, library: Library, instances: str, seed: int, folder: RunFolder, progress: Progress) -> None:
        self._library, self._seed, self._folder, self._progress = library, seed, folder, progress
        self._names: list[str] = []
        lacking: list[str] = []
        for kind in ("articulated", "rigid"):
            names = [name for name in library.classes(kind) if has_instances(library, name, instances)]
            lacking += [name for name in library.classes(kind) if name not in names]
            order = seeding.rng(seed, "classes" if kind == "articulated" else "rigid classes").permutation(len(names))
            self._names += [names[index] for index in order]
        self._read: dict[str, Affordance] = {}
        self.notes = [_left_out(instances, lacking)] if lacking else []

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)

    def __contains__(self, name: object) -> bool:
        return name in self._names

    def __getitem__(self, name: str) -> Affordance:
        if name not in self._read:
            if name not in self._names:
                raise KeyError(name)
            self._read[name] = self._affordance(name)
        return self._read[name]

    def _affordance(self, name: str) -> Affordance:
        """Return the affordance of a class, averaged over a few instances that the search may use."""
        ids = seen_by_search(self._library, name)
        order = seeding.rng(self._seed, f"{name}/affordance").permutation(len(ids))
        found: list[ArticulatedObject | RigidObject] = []
        failed: InputError | None = None
        self._progress.start(f"{name}: measuring objects", min(AFFORDANCE_INSTANCES, len(ids)))
        for index in order:
            try:
                found.append(self._library.load(name, ids[index]))
                self._progress.advance()
            except InputError as error:
                failed = error
                self.notes.append(f"{name}/{ids[index]} left out: {error}")
            if len(found) == AFFORDANCE_INSTANCES:
                break
        if not found:
            raise InputError(f"no object of the class {name} can be loaded", field="assets") from failed
        for each in found:
            self._folder.add_object(each)
        picture = view_of(self._library.location, name, found[0].id)
        return Affordance.of(found, self._library.describe(name), picture)
