"""Measure whether half-open objects move by themselves in 5 s, with the original's joint friction.

    python benchmarks/left_alone.py                 # SAPIEN 3, PGS
    python benchmarks/left_alone.py --tgs           # SAPIEN 3, TGS
    SAPIEN2/bin/python benchmarks/left_alone.py     # in a virtual environment with sapien==2.2.2 and numpy<2

The script runs in SAPIEN 2 or SAPIEN 3 and does not import this project. It reads prepared objects from the cache
(``gensim2 assets prepare``), so that both versions use the same hulls. It prints the class, the id and the final
openness of each object.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import tempfile
from pathlib import Path
from typing import Any

import sapien
from sapien.core import Pose

CACHE = Path(os.environ.get("GENSIM2_CACHE") or Path.home() / ".cache" / "gensim2") / "objects"
#: Coefficient of joint friction by class.
FRICTION = {"box_rotate": 0.25, "dishwasher": 0.4, "laptop_rotate": 0.4, "oven": 0.1}
FRICTION |= {"suitcase_rotate": 0.25, "toilet": 0.1, "trash_can": 0.1}
DENSITY, STEPS = 100.0, 500


def weightless_urdf(folder: Path) -> str:
    """Return the URDF of a prepared object with absolute mesh paths, without masses, visuals and joint dynamics."""
    text = (folder / "mobility.urdf").read_text()
    for element in (r"<inertial>.*?</inertial>", r"<visual>.*?</visual>", r"<dynamics[^>]*/>"):
        text = re.sub(element, "", text, flags=re.DOTALL)
    return text.replace('filename="collision', f'filename="{folder}/collision')


def scene_of_2() -> Any:
    import sapien.core as core

    scene = core.Engine().create_scene(core.SceneConfig())
    scene.set_timestep(0.01)
    return scene


def scene_of_3(tgs: bool) -> Any:
    from sapien import physx

    physx.set_shape_config(contact_offset=0.01)
    physx.set_body_config(solver_position_iterations=10, solver_velocity_iterations=1)
    physx.set_scene_config(enable_tgs=tgs, enable_pcm=False)
    physx.set_default_material(0.3, 0.3, 0.1)
    scene = sapien.Scene([physx.PhysxCpuSystem()])
    scene.set_timestep(0.01)
    return scene


def end_openness(scene: Any, urdf: str, facts: dict[str, Any], friction: float) -> float:
    """Return the openness of an object 5 s after it was released at openness 0.5."""
    loader = scene.create_urdf_loader()
    loader.fix_root_link = True
    if hasattr(loader, "set_density"):
        loader.set_density(DENSITY)
        built = loader.load(urdf)
    else:
        built = loader.load(urdf, config={"density": DENSITY})
    built.set_pose(Pose(facts["placement"]["position"], facts["placement"]["quaternion"]))
    (joint,) = built.get_active_joints()
    joint.set_friction(friction)
    joint.set_drive_property(0.0, 0.0)
    lower, upper = facts["joint"]["lower"], facts["joint"]["upper"]
    built.set_qpos([0.5 * (lower + upper)])
    built.set_qvel([0.0])
    for _ in range(STEPS):
        scene.step()
    return float((built.get_qpos()[0] - lower) / (upper - lower))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tgs", action="store_true")
    parser.add_argument("--instances", type=int, default=5, help="number of objects of each class and source")
    options = parser.parse_args()
    is_2 = not hasattr(sapien, "physx")
    with tempfile.TemporaryDirectory() as scratch:
        for asset_class, friction in FRICTION.items():
            for source in ("generated", "real"):
                folders = sorted(CACHE.glob(f"{source}-{asset_class}-*"))
                by_id = {json.loads((f / "instance.json").read_text())["id"]: f for f in folders}
                for instance_id, folder in sorted(by_id.items())[: options.instances]:
                    urdf = Path(scratch) / f"{folder.name}.urdf"
                    urdf.write_text(weightless_urdf(folder))
                    facts = json.loads((folder / "instance.json").read_text())
                    scene = scene_of_2() if is_2 else scene_of_3(options.tgs)
                    end = end_openness(scene, str(urdf), facts, friction)
                    print(f"{source} {asset_class} {instance_id} {end:.3f}")


if __name__ == "__main__":
    main()
