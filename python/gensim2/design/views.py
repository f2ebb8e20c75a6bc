"""Render pictures for a language model: an object with its keypoints, or the arm at an actuation pose.

A separate process renders, because graphics drivers may crash. The process starts with the first picture, which takes
half a minute with software rendering.
"""

from __future__ import annotations

import json
import multiprocessing
from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from functools import cache
from threading import Lock
from typing import TYPE_CHECKING, Any

import numpy as np

from gensim2.core.errors import GenSim2Error
from gensim2.core.processes.fork_server import forget_piped_script
from gensim2.design.pictures import LazyPicture
from gensim2.objects import open_library
from gensim2.planning.steps import StepPlanner
from gensim2.planning.strategies import KeypointStrategy
from gensim2.robots import robot
from gensim2.rollout.worker import SCREEN_OPTIONS, parsed
from gensim2.scenes.config import SceneOptions
from gensim2.tasks.spec import TaskSpec
from gensim2.tasks.strategies import Strategies

if TYPE_CHECKING:
    from PIL.ImageDraw import ImageDraw

#: Seed of the rendered scenes.
SEED = 7

#: Edge length in pixels of the pictures of one object.
OBJECT_SIZE = 300

#: Length (m) of the three axes of drawn coordinate frames, and their colours.
AXIS, COLOURS = 0.15, ("#d6273a", "#1b8f4c", "#1f6fd1")

#: Position, target and field of view of the video camera (gensim2.perception.raycast.state_drawing).
EYE, TARGET, FIELD_OF_VIEW = (-0.55, -1.3, 0.8), (-0.13, -0.07, 0.23), np.deg2rad(50)

#: Several threads may ask for the first picture, but only one may start the rendering process.
_STARTING = Lock()


def view_of(location: str, asset_class: str, instance: str) -> LazyPicture:
    """Return a picture with labelled keypoints.

    The picture shows an articulated object at three joint positions, or a rigid object from three sides.
    """
    return LazyPicture(f"{asset_class}/{instance}", cache(lambda: _drawn(draw_thing, location, asset_class, instance)))


class SceneViews:
    """Renders scenes for a language model; implements :class:`~gensim2.design.llm.Views`.

    Args:
        options: scene options of the run.
    """

    def __init__(self, options: SceneOptions) -> None:
        self.options = options

    def start(self, task: TaskSpec, step: str) -> LazyPicture:
        """Return a picture of the initial scene, with frames and the keypoints of the object of ``step``."""
        return self.actuation(task, {}, step)

    def actuation(self, task: TaskSpec, steps: Mapping[str, Strategies], step: str) -> LazyPicture:
        """Return a picture with the arm at the actuation pose of ``step``.

        Without such a pose, it shows the initial scene.
        """
        told = {"task": task.model_dump(mode="json"), "steps": steps, "step": step, **self.options.to_record()}
        given = (self.options, task, {name: dict(each) for name, each in steps.items()}, step)
        return LazyPicture(json.dumps(told, sort_keys=True), cache(lambda: _drawn(draw_scene, *given)))


@cache
def _painter() -> ProcessPoolExecutor:
    """Return the rendering process; the first call starts it."""
    forget_piped_script()
    return ProcessPoolExecutor(max_workers=1, mp_context=multiprocessing.get_context("spawn"))


def _drawn(draw: Callable[..., bytes], *given: Any) -> bytes:
    with _STARTING:
        painter = _painter()
    try:
        return painter.submit(draw, *given).result()
    except BrokenProcessPool as error:
        _painter.cache_clear()
        raise GenSim2Error("the rendering process ended; run without --visual") from error


def draw_thing(location: str, asset_class: str, instance: str) -> bytes:
    """Return the PNG of an object; runs in the rendering process."""
    from gensim2.inspection.pictures import png, strip

    return png(strip(open_library(location).load(asset_class, instance), OBJECT_SIZE))


def draw_scene(options: SceneOptions, task: TaskSpec, steps: Mapping[str, Strategies], name: str) -> bytes:
    """Return the PNG of a scene; runs in the rendering process."""
    from PIL import Image, ImageDraw

    from gensim2.inspection.pictures import png
    from gensim2.sim.driver import NO_DRIVER, can_render
    from gensim2.sim.env import GenSim2Env

    if not can_render():
        raise GenSim2Error(NO_DRIVER)
    scene_config = SceneOptions(options.assets, options.physics, options.robot).with_task(task)
    env = GenSim2Env(scene_config, obs_mode="none", render_mode="rgb_array")
    try:
        env.reset(seed=SEED)
        scene = env.scene_state()
        q, T_hand = _actuation(options, task, steps, name, scene) if name in steps else (None, None)
        if q is not None:
            env.agent.robot.set_qpos(q)
        picture = Image.fromarray(np.asarray(env.render()[0].cpu().numpy(), dtype=np.uint8))
    finally:
        env.close()
    draw = ImageDraw.Draw(picture)
    _axes(draw, picture.size, scene.T_world_base, "base")
    if T_hand is not None:
        _axes(draw, picture.size, scene.T_world_base @ T_hand, "hand")
    step = next(each for each in task.steps if each.name == name)
    _axes(draw, picture.size, scene.T_world_base @ scene.objects[step.object].T_base_object, "object")
    for key, point in scene.objects[step.object].keypoints.items():
        place = (scene.T_world_base @ np.append(point, 1.0))[:3]
        x, y = _pixel(place, picture.size)
        draw.ellipse((x - 4, y - 4, x + 4, y + 4), fill="#7b3fb0", outline="#ffffff")
        draw.text((x + 6, y - 6), key.split("_object_")[-1], fill="#ffffff", stroke_width=2, stroke_fill="#1c2430")
    return png(picture)


def _actuation(
    options: SceneOptions, task: TaskSpec, steps: Mapping[str, Strategies], name: str, scene: Any
) -> tuple[Any, Any]:
    """Return the joints (n,) and the hand pose (4, 4), base frame, at the actuation pose.

    Return (None, None) without a pose.
    """
    planner = StepPlanner(robot(options.robot), options=SCREEN_OPTIONS)
    step = next(each for each in task.steps if each.name == name)
    for before in task.steps:  # if the tool is a grasped object, its grasp is planned first
        if before.name != name and before.object == step.tool and before.name in steps:
            strategy = next(iter(parsed(steps[before.name]).values()))
            taken = planner.plan(scene, before, strategy)
            if taken.after is None:
                return None, None
            scene = taken.after
            break
    strategy = next(iter(parsed(steps[name]).values()))
    assert isinstance(strategy, KeypointStrategy)
    plan = planner.plan(scene, step, strategy).plan
    if plan is None:
        return None, None
    frame = next((each for each in plan.keyframes if each["label"] == "actuation"), None)
    if frame is None:
        return None, None
    if plan.trajectory is None or frame["time"] is None:
        return None, np.asarray(frame["T_base_hand"])
    return plan.trajectory.sample(frame["time"])[0], np.asarray(frame["T_base_hand"])


def _axes(draw: ImageDraw, size: tuple[int, int], T_world_frame: Any, name: str) -> None:
    origin = T_world_frame[:3, 3]
    start = _pixel(origin, size)
    for axis, colour in enumerate(COLOURS):
        draw.line([start, _pixel(origin + AXIS * T_world_frame[:3, axis], size)], fill=colour, width=3)
    draw.text((start[0] + 4, start[1] + 4), name, fill="#ffffff", stroke_width=2, stroke_fill="#1c2430")


def _pixel(point: Any, size: tuple[int, int]) -> tuple[float, float]:
    eye, target = np.array(EYE), np.array(TARGET)
    ahead = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    up = np.cross(right, ahead)
    depth = max(float((point - eye) @ ahead), 1e-3)
    focal = 0.5 * size[1] / float(np.tan(FIELD_OF_VIEW / 2))
    x = size[0] / 2 + focal * float((point - eye) @ right) / depth
    return x, size[1] / 2 - focal * float((point - eye) @ up) / depth
