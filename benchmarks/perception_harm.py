"""Measure the contact forces of the arm on estimated scenes, and the refusal of tasks without their object.

    python benchmarks/perception_harm.py --scenes 500 --seed 1 --out FILE.json
    python benchmarks/perception_harm.py --scenes 192 --seed 2 --noise deployed --out FILE.json

The controller is the one of ``gensim2 benchmark --scene perceived``. It gets one of the 24 single-step tasks with one
articulated object, but the simulated scene contains other objects as well, or does not contain the object of the task.
A result file has one row for each scene. ``perception_harm_table.py`` writes the tables.
"""

from __future__ import annotations

import argparse
from collections import Counter, deque
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, Literal, get_args

import mujoco
import numpy as np
import numpy.typing as npt
from markdown_tables import Row

from gensim2.core.files import write_json
from gensim2.core.seeding import rng, scene_seeds
from gensim2.objects import ArticulatedObject, RigidObject, open_library
from gensim2.objects.types import BODY
from gensim2.perception import EmptyCloudError
from gensim2.perception.estimation import PerceivingChain
from gensim2.robots import DEFAULT_ROBOT, robot
from gensim2.robots.force import FORCE_LIMIT
from gensim2.rollout.controller import spec_of
from gensim2.rollout.record import Cause
from gensim2.rollout.run import controller_seed, run
from gensim2.scenes.footprint import gap_between, outline, square, swept_points
from gensim2.scenes.initial_state import InitialState, PlacedObject, sample_initial_state
from gensim2.scenes.randomize import placed
from gensim2.scenes.reset_options import read_options
from gensim2.sim.headless import HeadlessEnv
from gensim2.sim.mujoco.scene import MujocoScene
from gensim2.sim.parts import RigidPart
from gensim2.tasks.library import load_task, packaged_names
from gensim2.tasks.spec import ObjectSpec, TaskSpec

Array = npt.NDArray[np.float64]
Kind = Literal["distractors", "close", "other", "clutter"]
KINDS: tuple[Kind, ...] = get_args(Kind)
"""Scenes with the object and 1 to 4 rigid objects; with the object and 1 to 3 rigid objects close to it; with an
articulated object of another shape; and with 0 to 4 rigid objects only.
"""
MISSING = ("other", "clutter")
"""Kinds of scenes without the object of the task."""

PROFILE = robot(DEFAULT_ROBOT)
WINDOW = PROFILE.substeps
"""Number of physics steps over which a contact force is averaged: one control step of 50 ms, as on the robot."""
GAP = 0.02
"""Minimum gap (m) between distractors and other objects."""
CLOSE = (0.005, 0.05)
"""Smallest and largest gap (m) between an object in the way and the object of the task."""
REGION = (-0.25, 0.35), (-0.5, 0.5)
"""Ranges of x and y in the world (m) for distractors."""
MAX_DRAWS = 300


@cache
def single_step_tasks() -> tuple[str, ...]:
    """Return the names of the paper's tasks with one step and one articulated object."""
    tasks = [load_task(name) for name in packaged_names()]
    chosen = [each for each in tasks if each.provenance is not None and each.provenance.origin == "paper"]
    return tuple(each.name for each in chosen if len(each.steps) == len(each.objects) == 1 and not _rigid(each))


def _rigid(task: TaskSpec) -> bool:
    return any(each.asset_class in rigid_classes() for each in task.objects.values())


@cache
def rigid_classes() -> tuple[str, ...]:
    library = open_library("builtin")
    return tuple(name for name in library.classes() if library.kind(name) == "rigid")


@cache
def articulated_classes() -> tuple[str, ...]:
    library = open_library("builtin")
    return tuple(name for name in library.classes() if library.kind(name) == "articulated")


class ForceMeter(HeadlessEnv):
    """A world that measures the contact forces of the arm.

    Args:
        task: task with all objects of the world.
        setup: initial state of the world.
        seed: seed with which the world is reset.

    Attributes:
        largest: largest contact force (N) on each body, averaged over ``WINDOW`` physics steps. The force is the
            larger one of two values: the sum over all links, and the largest sum over one link. Two fingers that press
            on an object from both sides cancel in the first value.
        longest: longest time (s) for which the averaged force on a body exceeded ``FORCE_LIMIT``.
        moved: largest displacement (m) of each rigid object.
    """

    def __init__(self, task: TaskSpec, setup: InitialState, seed: int) -> None:
        super().__init__(task, assets="builtin", engine="mujoco")
        self._drawn = (seed, setup)
        self.largest: dict[str, float] = {}
        self.longest = 0.0
        self.moved: dict[str, float] = {}

    def reset(self, seed: int, options: Mapping[str, Any] | None = None, *, robot: bool = True) -> None:
        super().reset(seed, options, robot=robot)
        self._recent: deque[dict[tuple[str, str], Array]] = deque(maxlen=WINDOW)
        self._since = 0
        scene = self._scene
        assert isinstance(scene, MujocoScene)
        model = scene.simulation.model
        self._bodies = [
            mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_BODY, int(body)).partition("/") for body in model.geom_bodyid
        ]

    def _advance(self) -> None:
        for _ in range(self.profile.substeps):
            self._scene.step()
            if self._scene.robot is not None:
                self._recent.append(self._forces())
                self._since = self._since + 1 if self._take(self._recent) > FORCE_LIMIT else 0
                self.longest = max(self.longest, self._since / self.profile.simulation.physics_hz)
        self.elapsed_steps += 1
        for name, part in self.parts.items() if self._scene.robot is not None else ():
            if isinstance(part, RigidPart):
                off = part.frame().row()[:3] - self.initial_state.objects[name].position
                self.moved[name] = max(self.moved.get(name, 0.0), float(np.linalg.norm(off)))

    def _forces(self) -> dict[tuple[str, str], Array]:
        """Return the contact force (3,), N, by body and link of the robot."""
        scene, wrench = self._scene, np.zeros(6)
        assert isinstance(scene, MujocoScene)
        model, data = scene.simulation.model, scene.simulation.raw
        found: dict[tuple[str, str], Array] = {}
        for number in range(data.ncon):
            contact = data.contact[number]
            (one, _, link), (other, _, other_link) = (self._bodies[geom] for geom in contact.geom)
            if (one == self.profile.agent) == (other == self.profile.agent):
                continue
            mujoco.mj_contactForce(model, data, number, wrench)
            force = contact.frame.reshape(3, 3).T @ wrench[:3]
            # The force acts on the second body of a contact, and its opposite on the first.
            key = (other, link) if one == self.profile.agent else (one, other_link)
            found[key] = found.get(key, np.zeros(3)) + (force if one == self.profile.agent else -force)
        return found

    def _take(self, steps: Sequence[Mapping[tuple[str, str], Array]] | deque[Any]) -> float:
        """Update ``largest`` with the mean forces of the given physics steps, and return the largest of them."""
        by_link: dict[tuple[str, str], Array] = {}
        for forces in steps:
            for key, force in forces.items():
                by_link[key] = by_link.get(key, np.zeros(3)) + force / WINDOW
        by_body: dict[str, Array] = {}
        for (body, _), force in by_link.items():
            by_body[body] = by_body.get(body, np.zeros(3)) + force
        found = [(body, force) for (body, _), force in by_link.items()] + list(by_body.items())
        for body, force in found:
            self.largest[body] = max(self.largest.get(body, 0.0), float(np.linalg.norm(force)))
        return max((float(np.linalg.norm(force)) for _, force in found), default=0.0)


def drawn_scene(kind: Kind, task: TaskSpec, seed: int, assets: str) -> InitialState:
    """Return a random scene of one kind for a task."""
    draw = rng(seed, f"{task.name}/{kind}")
    objects: dict[str, PlacedObject] = {}
    if kind != "clutter":
        shown = task if kind != "other" else task.model_copy(update={"objects": {"stranger": _stranger(task, draw)}})
        library = open_library(assets)
        words = "new" if assets == "builtin" else "all"
        ids = {
            name: tuple(each for each in library.choose(spec.asset_class, words))
            for name, spec in shown.objects.items()
        }
        empty = read_options(None, tuple(shown.objects))
        objects |= sample_initial_state(shown, library, ids, seed, empty, PROFILE).objects
    counts = {"distractors": (1, 5), "close": (1, 4), "clutter": (0, 5)}
    if kind in counts:
        for number in range(int(draw.integers(*counts[kind]))):
            thing = _beside(objects, draw, CLOSE if kind == "close" else None)
            if thing is not None:
                objects[f"rigid_{number}"] = thing
    return InitialState(objects, 1, PROFILE.reset_qpos, "paper")


def _stranger(task: TaskSpec, draw: np.random.Generator) -> ObjectSpec:
    """Return a random articulated object whose shape differs from that of the task's object. The first word of a class
    names its shape: box_move and box_rotate have the same shapes.
    """
    [own] = (each.asset_class.split("_")[0] for each in task.objects.values())
    others = [name for name in articulated_classes() if name.split("_")[0] != own]
    return ObjectSpec(asset_class=others[int(draw.integers(len(others)))])


def _beside(
    objects: Mapping[str, PlacedObject], draw: np.random.Generator, gaps: tuple[float, float] | None
) -> PlacedObject | None:
    """Return a random rigid object on the table that overlaps no object; None if there is no room.

    Args:
        objects: objects in the scene.
        gaps: range of the gap (m) to the articulated object; the object may be in the way of its joint. None: the
            object is ``GAP`` apart from all objects, and not in the way of a joint.
    """
    model = open_library("builtin").load(rigid_classes()[int(draw.integers(len(rigid_classes())))], "0")
    assert isinstance(model, RigidObject)
    tool, space = PROFILE.gripper_with(PROFILE.reset_qpos)["tool_head"], PROFILE.footprint
    base, hand = square(np.array(PROFILE.base_position), space.base_half), square(tool, space.hand_half)
    least = GAP if gaps is None else gaps[0]
    articulated = [each for each in objects.values() if isinstance(each.model, ArticulatedObject)]
    region = REGION
    if gaps is not None:
        corners = np.concatenate([outline(swept_points(o.model), o.position, o.quaternion) for o in articulated])
        low, high = corners.min(axis=0) - gaps[1] - 0.1, corners.max(axis=0) + gaps[1] + 0.1
        region = (float(low[0]), float(high[0])), (float(low[1]), float(high[1]))
    for _ in range(MAX_DRAWS):
        x, y = (float(draw.uniform(*each)) for each in region)
        yaw = float(draw.uniform(-np.pi, np.pi))
        at = np.array([0.0, 0.0, model.placement.position[2]])
        thing = PlacedObject(model, *placed(at, model.placement.quaternion, x, y, yaw), yaw, None)
        own = outline(np.concatenate(model.hulls[BODY]), thing.position, thing.quaternion)
        if np.linalg.norm(thing.position[:2] - PROFILE.base_position[:2]) > PROFILE.reach:
            continue
        if min(gap_between(own, base), gap_between(own, hand)) < GAP:
            continue
        if any(gap_between(own, each) < least for o in objects.values() for each in _outlines(o, gaps is None)):
            continue
        if gaps is None or min(gap_between(own, e) for o in articulated for e in _outlines(o, False)) <= gaps[1]:
            return thing
    return None


def _outlines(thing: PlacedObject, swept: bool) -> list[Array]:
    """Return the outlines of an object's hulls, or of the space through which its joint moves (``swept``)."""
    if swept:
        return [outline(swept_points(thing.model), thing.position, thing.quaternion)]
    upright = np.array([1.0, 0.0, 0.0, 0.0])
    return [outline(hull, np.zeros(3), upright) for hull in thing.hulls_in_world()]


def episode(kind: Kind, name: str, seed: int, assets: str = "builtin", noise: str | None = None) -> Row:
    """Run one episode, and return its measured values."""
    task = load_task(name)
    setup = drawn_scene(kind, task, seed, assets)
    beside = {each: ObjectSpec(asset_class=setup.objects[each].model.asset_class) for each in setup.objects}
    world = ForceMeter(
        task.model_copy(update={"objects": {**beside, **({} if kind in MISSING else task.objects)}}), setup, seed
    )
    controller = PerceivingChain(task, noise=noise)
    held, cause, steps = None, None, 0
    try:
        if kind in MISSING:
            steps = _run(world, controller, seed)
        else:
            found = run(world, controller, seed=seed).episode
            held, cause, steps = found.held, None if found.cause is None else found.cause.value, found.control_steps
    except EmptyCloudError:
        cause = "empty cloud"
    events = [event.what for event in controller.events]
    largest = max(world.largest, key=lambda body: world.largest[body], default=None)
    return {
        "kind": kind,
        "task": name,
        "seed": seed,
        "objects": "generated" if assets == "builtin" else "real",
        "noise": noise or "none",
        "stranger": setup.objects["stranger"].model.asset_class if kind == "other" else None,
        "rigid": sum(each.startswith("rigid_") for each in setup.objects),
        "refused": cause == "empty cloud" or Cause.OBJECT_NOT_SEEN in events,
        "why": next((dict(event.detail) for event in controller.events if event.what == Cause.OBJECT_NOT_SEEN), None),
        "held": held,
        "cause": cause,
        "events": dict(Counter(str(event) for event in events)),
        "control_steps": steps,
        "force": round(world.largest[largest], 1) if largest else 0.0,
        "force_on": largest,
        "forces": {body: round(force, 1) for body, force in world.largest.items()},
        "seconds_above": round(world.longest, 3),
        "moved": round(max((off for name, off in world.moved.items() if name in world.largest), default=0.0), 3),
    }


def _run(world: ForceMeter, controller: PerceivingChain, seed: int) -> int:
    """Run an episode in a world that does not contain the task's object; return the number of control steps."""
    world.reset(seed)
    controller.reset(world.observe(spec_of(controller)), controller_seed(seed))
    for step in range(world.max_episode_steps):
        action = controller.act(world.observe(spec_of(controller)))
        if action is None:
            return step
        world.step(action)
    return world.max_episode_steps


def measured(count: int, seed: int, kinds: Sequence[Kind], assets: str, noise: str | None) -> Iterator[Row]:
    """Yield the rows of ``count`` scenes. The kinds and the tasks take turns."""
    tasks = single_step_tasks()
    for number in range(count):
        kind, name = kinds[number % len(kinds)], tasks[(number // len(kinds)) % len(tasks)]
        [own] = scene_seeds(seed, name, f"harm/{kind}", 1, number // (len(kinds) * len(tasks)))
        yield episode(kind, name, own, assets, noise)


def main() -> None:
    """Run the episodes, and write the result file after each one."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", type=int, default=500)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--kind", action="append", choices=KINDS, help="kind of scenes; default: all in turn")
    parser.add_argument("--assets", default="builtin", help="library of the articulated objects")
    parser.add_argument("--noise", help="noise of the depth images")
    parser.add_argument("--out", type=Path, required=True)
    given = parser.parse_args()
    rows: list[Row] = []
    for row in measured(given.scenes, given.seed, given.kind or KINDS, given.assets, given.noise):
        rows.append(row)
        said = "refused" if row["refused"] else f"held {row['held']} {row['cause']}"
        print(len(rows), row["kind"], row["task"], said, f"{row['force']} N on {row['force_on']}", flush=True)
        write_json(given.out, {"schema_version": 1, "rows": rows})


if __name__ == "__main__":
    main()
