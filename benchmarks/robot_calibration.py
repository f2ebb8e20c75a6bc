"""Cameras calibrated against the robot's own meshes, from a first guess that is far off, under a stereo pair's noise.

    python benchmarks/robot_calibration.py [--draws 120] [--views 6] [--degrees 15] [--metres 0.1] [--pixels 320x240]
        [--seed 0] [--json OUT]

In each draw one of the three cameras of observations stands where it stands, the first guess is turned by so many
degrees about a random axis and shifted so many metres some way, and the depth has a scale and a bias of its own. The
arm stands in random poses, two of them held out. Prints the errors of the pose found (median, 95th percentile), how
many are within 10 mm and 1 degree (converged), how many of the others the calibration itself refused, and CPU seconds.
"""

from __future__ import annotations

import argparse
import json
import time
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from gensim2.core.seeding import rng
from gensim2.perception import D435, DepthNoise
from gensim2.perception.raycast.scene import RaycastScene
from gensim2.robots import robot
from gensim2_robot.arm_limits import ArmLimits
from gensim2_robot.calibration.mesh import calibrate
from gensim2_robot.calibration.run import displaced, pose_error
from gensim2_robot.calibration.surfaces import ArmView, RobotSurface
from gensim2_robot.simulated import simulated_cameras

PROFILE = robot("panda")
SPREAD = np.array([0.9, 0.5, 0.6, 0.6, 0.8, 0.8, 1.0])
"""Rad about the reset pose within which arm poses are drawn."""
SCALE, BIAS = 0.01, 0.003
"""Standard deviations of the depth's scale and bias (m)."""
CONVERGED = 10.0, 1.0
"""Millimetres and degrees."""


@cache
def limits() -> ArmLimits:
    """Limits that arm poses keep."""
    return ArmLimits.of(PROFILE)


@cache
def surface() -> RobotSurface:
    """The robot's meshes."""
    return RobotSurface(PROFILE)


def arm_poses(draw: np.random.Generator, count: int) -> list[np.ndarray]:
    """(n,) joints, so many, within the limits."""
    found: list[np.ndarray] = []
    while len(found) < count:
        q = np.array(PROFILE.reset_qpos[:7]) + draw.uniform(-1, 1, 7) * SPREAD
        tool = limits().tool(q[None])[0]
        inside = (q > limits().lower).all() and (q < limits().upper).all()
        if inside and (tool > limits().low).all() and (tool < limits().high).all() and limits().is_clear(q[None]):
            found.append(limits().whole(q[None])[0])
    return found


def picture(
    scene: RaycastScene, q: np.ndarray, noise: DepthNoise, scale: float, bias: float, draw: np.random.Generator
) -> ArmView:
    """Measure with the scene's camera the robot and its table, in whole millimetres."""
    base = np.array([*PROFILE.base_position, *PROFILE.base_quaternion])
    state = np.concatenate([base, np.zeros(6), q, np.zeros(len(q))])[None].astype(np.float32)
    (view,) = scene.see(scene.poses({"articulations": {PROFILE.agent: state}})[0])
    camera = scene.cameras[0]
    colors = view.colors_at(np.arange(view.depth.size)).reshape(*view.depth.shape, 3)
    depth = noise.on(view.depth, draw, colors, float(camera.intrinsic[1, 1]))
    measured = np.where(depth > 0, np.rint(1e3 * (depth - bias) / scale), 0.0).clip(0.0)
    return ArmView(q, (1e-3 * measured).astype(np.float32))


def calibrated(
    number: int, views: int, degrees: float, metres: float, pixels: tuple[int, int], seed: int, noise: DepthNoise = D435
) -> dict[str, Any]:
    """One draw: errors of the pose, scale and bias found, and what the calibration says of itself."""
    draw = rng(seed, "calibration benchmark", number)
    cameras = [camera for camera in simulated_cameras(PROFILE, *pixels) if camera.link is None]
    true = cameras[number % len(cameras)]
    scene = RaycastScene(PROFILE, {}, [true])
    scale, bias = 1.0 + SCALE * draw.normal(), BIAS * draw.normal()
    taken = [picture(scene, q, noise, scale, bias, draw) for q in arm_poses(draw, views + 2)]
    guess = displaced(true, degrees, metres, draw)
    began = time.process_time()
    found = calibrate(surface(), guess, taken[:views], taken[views:], seed=number)
    millimetres, turned = pose_error(found.camera.T_base_camera, true.T_base_camera)
    return {
        "camera": true.name,
        "mm": millimetres,
        "deg": turned,
        "scale": found.scale - scale,
        "bias_mm": 1e3 * (found.bias - bias),
        "held_out_mm": found.held_out_mm,
        "trouble": found.trouble,
        "cpu_s": time.process_time() - began,
    }


def summary(found: list[dict[str, Any]]) -> dict[str, float]:
    """Figures of all draws."""
    mm, deg = (np.array([each[name] for each in found]) for name in ("mm", "deg"))
    good = (mm < CONVERGED[0]) & (deg < CONVERGED[1])
    said = np.array([each["trouble"] is None for each in found])
    return {
        "draws": len(found),
        "median_mm": float(np.median(mm)),
        "median_deg": float(np.median(deg)),
        "p95_mm": float(np.percentile(mm, 95)),
        "p95_deg": float(np.percentile(deg, 95)),
        "converged": float(good.mean()),
        "wrong_and_not_said": int((~good & said).sum()),
        "right_and_refused": int((good & ~said).sum()),
        "cpu_s": float(np.median([each["cpu_s"] for each in found])),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draws", type=int, default=120)
    parser.add_argument("--views", type=int, default=6)
    parser.add_argument("--degrees", type=float, default=15.0)
    parser.add_argument("--metres", type=float, default=0.1)
    parser.add_argument("--pixels", default="320x240")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    width, height = map(int, options.pixels.split("x"))
    found = []
    for number in range(options.draws):
        found.append(calibrated(number, options.views, options.degrees, options.metres, (width, height), options.seed))
        said = {name: round(value, 3) if isinstance(value, float) else value for name, value in found[-1].items()}
        print(number, said, flush=True)
    figures = summary(found)
    print({name: round(value, 3) for name, value in figures.items()})
    if options.json is not None:
        options.json.write_text(json.dumps({"summary": figures, "draws": found}, indent=2) + "\n")


if __name__ == "__main__":
    main()
