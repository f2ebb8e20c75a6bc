"""Measure the CPU time for loading a prepared object into a scene without rendering.

    python benchmarks/assets_load.py --assets builtin --assets DIR [--raw DIR]

Objects that are not in the cache are prepared before the measurement. The measured time includes checking that the
prepared files are up to date, reading them from the cache, checking the hulls, building the object in an empty PhysX
scene, and setting its friction. ``--raw`` also measures SAPIEN's own loader on the unprepared URDFs of a folder of real
objects. The script prints CPU milliseconds of one process: median, 90th percentile and maximum.
"""

from __future__ import annotations

import argparse
import copy
import json
import os
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import sapien
import torch
from mani_skill.envs.scene import ManiSkillScene
from mani_skill.utils.structs.types import SimConfig

from gensim2.core.progress import ConsoleProgress
from gensim2.objects import Library, RigidObject, open_library
from gensim2.objects.library.catalogue import load_all
from gensim2.sim.objects import load_object
from gensim2.sim.rigid import load_rigid


def empty_scene() -> ManiSkillScene:
    """Return a scene with physics only."""
    return ManiSkillScene(
        sub_scenes=[sapien.Scene([sapien.physx.PhysxCpuSystem()])],
        sim_config=SimConfig(),
        device=torch.device("cpu"),
        backend=_no_pictures(),
    )


def _no_pictures() -> object:
    from mani_skill.envs.utils.system.backend import parse_sim_and_render_backend

    return parse_sim_and_render_backend("physx_cpu", "none")


def into_scene(library: Library, asset_class: str, instance_id: str) -> None:
    """Load an object into a new scene, as an environment does when it uses the object for the first time."""
    instance = copy.copy(library).load(asset_class, instance_id)  # the copy has an empty cache of loaded objects
    if isinstance(instance, RigidObject):
        load_rigid(empty_scene(), instance)
        return
    place = instance.placement
    load_object(empty_scene(), instance, sapien.Pose(place.position, place.quaternion))


def raw(urdf: Path, scale: float) -> None:
    """Load a URDF with SAPIEN's own loader, with several hulls for each mesh file, without visuals."""
    loader = sapien.Scene([sapien.physx.PhysxCpuSystem()]).create_urdf_loader()
    loader.scale, loader.load_multiple_collisions_from_file = scale, True
    builder = loader.parse(str(urdf))[0][0]
    for link in builder.link_builders:
        link.visual_records.clear()
    builder.build(fix_root_link=True)


def cpu_ms(work: Callable[[], object], repeats: int) -> float:
    """Return the median CPU time of ``work``, ms."""
    spent = []
    for _ in range(repeats):
        begin = time.process_time()
        work()
        spent.append(1e3 * (time.process_time() - begin))
    return float(np.median(spent))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--assets", action="append", help="builtin, or a folder of objects; can be repeated")
    parser.add_argument("--raw", type=Path, help="folder of real objects, in the layout of the GenSim2 release")
    parser.add_argument(
        "--repeats", type=int, default=3, help="number of measurements of each object; the median counts"
    )
    parser.add_argument("--core", type=int, default=0, help="CPU core on which the measurement runs")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()

    table: dict[str, dict[str, float]] = {}
    with ConsoleProgress() as progress:
        for where in options.assets or ["builtin"]:
            library = open_library(where)
            items = [(c, i) for c in library.classes() for i in library.instances(c)]
            progress.start(f"{library.name}: prepare", len(items))
            usable = []
            for item, reason in load_all(library, items, 2):
                usable += [item] if reason is None else []
                progress.advance()
            os.sched_setaffinity(0, {options.core})
            into_scene(library, *usable[0])  # the first call also imports modules, so it is not measured
            progress.start(f"{library.name}: load", len(usable))
            table[library.name] = {}
            for item in usable:
                cost = cpu_ms(partial(into_scene, library, *item), options.repeats)
                table[library.name]["/".join(item)] = cost
                progress.advance()
        if options.raw is not None:
            files = sorted((options.raw / "articulated_objs").glob("*/*/mobility.urdf"))
            progress.start(f"{options.raw.name}: load unprepared", len(files))
            table[f"{options.raw.name}, unprepared"] = {}
            for file in files:
                scale = json.loads((file.parent / "info.json").read_text()).get("scale", 0.25)
                cost = cpu_ms(partial(raw, file, scale), 1)
                table[f"{options.raw.name}, unprepared"]["/".join(file.parent.parts[-2:])] = cost
                progress.advance()

    print("| library | objects | median ms | 90 % | worst | which |\n|---|---|---|---|---|---|")
    for name, costs in table.items():
        values = np.array(list(costs.values()))
        worst = max(costs, key=lambda key: costs[key])
        print(
            f"| {name} | {len(values)} | {np.median(values):.1f} | {np.percentile(values, 90):.1f} "
            f"| {values.max():.1f} | {worst} |"
        )
    if options.json is not None:
        options.json.write_text(json.dumps(table, indent=1) + "\n")


if __name__ == "__main__":
    main()
