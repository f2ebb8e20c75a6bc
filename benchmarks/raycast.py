"""Ray-cast observations beside SAPIEN's own pictures of the same recorded states: agreement, and CPU time a frame.

    gensim2 collect TASK... --episodes 1 --out DIR
    taskset -c 1 python benchmarks/raycast.py DIR [DIR...] [--compared 3] [--timed 40] [--photographed 10]

Needs a Vulkan driver for SAPIEN's pictures. Of each episode that held, `--compared` instants are compared and `--timed`
are observed against the clock. CPU time is of the whole process, the renderer's threads with it. A pixel agrees where
both see the same link; depth is compared where they agree, SAPIEN's in whole millimetres.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from gensim2.data.dataset import DataSet
from gensim2.objects import open_library
from gensim2.perception import CloudSettings, DepthNoise, ObservationSpec, View, point_cloud
from gensim2.perception.raycast.observer import Observer
from gensim2.robots import robot as robot_profile
from gensim2.rollout.recording import Recording
from gensim2.scenes.config import SceneConfig
from gensim2.sim.pictures import StatePictures

NEAR_M = 0.002
"""Within which depths count as equal."""

clock = time.process_time


@dataclass
class Agreement:
    """Counts of pixels."""

    pixels: int = 0
    same: int = 0
    near: int = 0
    seen: int = 0
    worst: float = 1.0
    apart_mm: list[float] = field(default_factory=list)

    def add(self, ours: Any, image: dict[str, Any]) -> None:
        same = image["segmentation"] == ours.segmentation
        both = same & (image["segmentation"] > 0)
        apart = np.abs(image["depth"] / 1000.0 - ours.depth)[both]
        self.pixels, self.same = self.pixels + same.size, self.same + int(same.sum())
        self.seen, self.near = self.seen + int(both.sum()), self.near + int((apart <= NEAR_M).sum())
        self.worst = min(self.worst, float(same.mean()))
        self.apart_mm.append(1e3 * float(np.median(apart)))


@dataclass
class Times:
    """CPU seconds by part, and how often."""

    seconds: dict[str, float] = field(default_factory=dict)
    frames: dict[str, int] = field(default_factory=dict)

    def add(self, part: str, seconds: float, frames: int = 1) -> None:
        self.seconds[part] = self.seconds.get(part, 0.0) + seconds
        self.frames[part] = self.frames.get(part, 0) + frames

    def ms(self, part: str) -> float:
        return 1e3 * self.seconds[part] / self.frames[part]


def episodes(folders: list[Path]) -> Iterator[tuple[SceneConfig, Recording]]:
    """Every episode that held."""
    for folder in folders:
        dataset = DataSet.open(folder)
        options = dataset.record.scene
        for name in dataset.tasks:
            store = dataset.task(name)
            shown = options.with_task(store.spec())
            for row in store.rows():
                if row.held and (recording := store.read(row).recording) is not None:
                    yield shown, recording


def observer(shown: SceneConfig, recording: Recording, settings: CloudSettings) -> Observer:
    library = open_library(shown.assets)
    objects = {
        name: library.load(spec.asset_class, recording.instances[name]) for name, spec in shown.task.objects.items()
    }
    return Observer(robot_profile(shown.robot), objects, ObservationSpec(cloud=settings), recording.seed)


def fused(seeing: Observer, views: tuple[View, ...]) -> None:
    point_cloud(views, seeing.spec.cloud, seeing.scene.robot)


def spread(count: int, wanted: int) -> list[int]:
    return sorted({round(x) for x in np.linspace(0, count - 1, min(wanted, count))})


def time_frames(shown: SceneConfig, recording: Recording, wanted: int, times: Times) -> None:
    """Whole observations of successive instants, as `gensim2 render` makes them."""
    for part, settings in (
        ("cloud of 1,024 points", CloudSettings()),
        ("the same, outliers dropped", CloudSettings(outliers=2.0)),
        ("the same, depth noise", CloudSettings(noise=DepthNoise())),
    ):
        begin = clock()
        seeing = observer(shown, recording, settings)
        poses = seeing.scene.poses(recording.env_states)
        fused(seeing, seeing.views(poses[0], 0))
        times.add(f"{part}: start of an episode", clock() - begin)
        rows = range(1, min(wanted, len(poses)))
        begin = clock()
        for step in rows:
            fused(seeing, seeing.views(poses[step], step))
        times.add(part, clock() - begin, len(rows))
        if settings == CloudSettings():
            begin = clock()
            for step in rows:
                seeing.scene.see(poses[step])
            times.add("of it rays", clock() - begin, len(rows))


def compare(
    shown: SceneConfig, recording: Recording, wanted: int, agreement: Agreement, pictures: StatePictures
) -> None:
    seeing = observer(shown, recording, CloudSettings())
    poses = seeing.scene.poses(recording.env_states)
    for step in spread(len(poses), wanted):
        images = pictures.at(recording.env_states, step)
        for view in seeing.views(poses[step], step):
            agreement.add(view, images[view.camera.name])


def photograph(shown: SceneConfig, recording: Recording, wanted: int, times: Times) -> None:
    """RGB of recorded states, beside the renderer alone: the same scene drawn again and again."""
    pictures = StatePictures(shown)
    pictures.show(recording.instances, recording.seed, recording.reset_options)
    env = pictures._env
    steps = spread(recording.steps + 1, wanted)
    pictures.at(recording.env_states, 0)  # shaders
    for step in steps:  # one of each in turn: the machine's mood is the same for both
        begin = clock()
        pictures.at(recording.env_states, step)
        middle = clock()
        env.scene.update_render(update_sensors=True, update_human_render_cameras=False)
        for sensor in env.scene.sensors.values():
            sensor.capture()
            sensor.camera.get_picture(["Color"])
        times.add("rgb of a recorded state", middle - begin)
        times.add("the renderer alone", clock() - middle)
    pictures.close()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="+", type=Path)
    parser.add_argument("--compared", type=int, default=3)
    parser.add_argument("--timed", type=int, default=40)
    parser.add_argument("--photographed", type=int, default=10)
    given = parser.parse_args()
    print(f"cores: {sorted(os.sched_getaffinity(0))}")
    agreements: dict[tuple[str, str], Agreement] = {}
    times, count, last = Times(), 0, None
    for shown, recording in episodes(given.folders):
        key = "generated" if shown.assets == "builtin" else "real", shown.task.name
        time_frames(shown, recording, given.timed, times)
        pictures = StatePictures(shown, ("depth", "segmentation"))
        pictures.show(recording.instances, recording.seed, recording.reset_options)
        compare(shown, recording, given.compared, agreements.setdefault(key, Agreement()), pictures)
        pictures.close()
        count, last = count + 1, (shown, recording)
        found = agreements[key]
        print(
            f"{key[0]:10}{key[1]:32} segmentation {found.same / found.pixels:.5f} (worst picture {found.worst:.5f})"
            f"  depth within 2 mm {found.near / found.seen:.5f}  median {np.median(found.apart_mm):.2f} mm",
            flush=True,
        )
    assert last is not None, "no episode succeeded"
    photograph(*last, given.photographed, times)
    for part in times.seconds:
        print(f"{part:50}{times.ms(part):8.2f} ms of CPU, mean of {times.frames[part]}")
    every = list(agreements.values())
    total = {
        "episodes": count,
        "tasks": len({name for _, name in agreements}),
        "pictures": sum(len(each.apart_mm) for each in every),
        "segmentation_equal": sum(each.same for each in every) / sum(each.pixels for each in every),
        "depth_within_2mm": sum(each.near for each in every) / sum(each.seen for each in every),
        "worst_picture": min(each.worst for each in every),
        "cloud_ms": times.ms("cloud of 1,024 points"),
        "rgb_over_renderer": times.ms("rgb of a recorded state") / times.ms("the renderer alone"),
    }
    print(json.dumps({name: round(value, 5) for name, value in total.items()}, indent=2))


if __name__ == "__main__":
    main()
