"""The deployed line by the machine's clock: its periods, clouds and stops. For a quiet machine.

    python benchmarks/robot_line.py [--task CloseBox] [--policy DIR] [--minutes 10] [--speed 0.5] [--pixels 320x240]
        [--cameras simulated|software|recordings] [--rate 10] [--force 140] [--faults 10]
        [--simulated-clock] [--json OUT]

With ``--simulated-clock`` everything goes by a clock that waits for it: what is noticed and what follows, on any
machine, and no figure of its speed.

Runs the line once without a fault, then ``gensim2 robot run`` with each fault so many times at random moments. Prints
periods, how late they began, pictures to clouds, and for each fault how often it ended in the state that it must, how
long it took from being noticed to the last command that moves, and whether the log replays. Ends with 1 where a limit
was passed, a fault was not noticed, the arm not held or stopped within a period of that, or a log is not whole.

The run without a fault is resumed at once whenever the watch holds it, and every hold is listed. --cameras software:
the pictures of the simulated cameras go through software devices of the RealSense library. --cameras recordings: files
of such devices are made first, of the scene in which the arm stands, and played again and again in a dry run. Both want
``pip install pyrealsense2``.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from gensim2.core.seeding import rng
from gensim2.policy.remote import protocol
from gensim2.policy.remote.server import PolicyServer
from gensim2.rollout.inputs import read_task_input
from gensim2_robot.devices import Keys
from gensim2_robot.drivers.realsense import RealSenseCameras, SoftwareDevice
from gensim2_robot.faults import Fault
from gensim2_robot.live import looking
from gensim2_robot.log_reader import replay
from gensim2_robot.run import run as run_line
from gensim2_robot.simulated import SimulatedCameras, SimulatedWorld, simulated_cameras
from gensim2_robot.watch import WatchRules

ENDS = {
    "camera-frozen": "holding",
    "camera-late": "holding",
    "camera-unplugged": "holding",
    "camera-torn": "holding",
    "camera-clock": "holding",
    "camera-swapped": "holding",
    "camera-mislabelled": "holding",
    "policy-killed": "stopped",
    "policy-nan": "holding",
    "policy-slow": "holding",
    "policy-garbage": "holding",
    "policy-token": "holding",
    "arm-reflex": "stopped",
    "arm-lagging": "holding",
    "arm-silent": "holding",
    "arm-refusing": "stopped",
    "arm-at-limit": "holding",
    "disk-full": "holding",
}
SECONDS, SIMULATED_SECONDS = 60.0, 4.0
"""Within which each fault begins, by the machine's clock and by a simulated one."""
DEADLINE = 30.0
"""Seconds for a server's answer: it is to be refused, not late."""
RAYS = WatchRules(frame_age=0.25)
"""Pictures of simulated cameras are 0.1 s apart and come 0.08 s late: so long rays are cast for three of them."""
SHOTS, RECORDED = 60, 20.0
"""Pictures of a recording that differ in their noise, and its seconds."""
WITHIN = 100.0
"""Milliseconds from being noticed within which the last command that moves is sent: a period."""


def replayed(found: dict[str, Any], log: Path) -> dict[str, Any]:
    """Add to a result the clouds of its log that were made anew, and the number that came out otherwise."""
    again = replay(log)
    return found | {"replayed": again.clouds, "differs": len(again.different)}


def run(words: list[str], minutes: float, folder: Path) -> dict[str, Any]:
    """Run ``gensim2 robot run`` and return its JSON."""
    out = folder / "result.json"
    command = [sys.executable, "-m", "gensim2", "robot", "run", *words, "--minutes", str(minutes)]
    subprocess.run([*command, "--json", str(out), "--out", str(folder / "log")], check=False, stdout=subprocess.DEVNULL)
    found: dict[str, Any] = json.loads(out.read_text())
    return replayed(found, folder / "log")


class Resuming(Keys):
    """A person who resumes at once."""

    @property
    def is_there(self) -> bool:
        """Always."""
        return True

    def pressed(self) -> str | None:
        """To go on."""
        return "r"


def run_quiet(options: argparse.Namespace, folder: Path) -> dict[str, Any]:
    """The line by the machine's clock and without a fault, its devices in processes of their own."""
    width, height = map(int, options.pixels.split("x"))
    source = options.cameras
    if source == "recordings":
        files = record(options, folder.parent, (width, height))
        source = "recording:" + ",".join(f"{name}={file}" for name, file in files.items())
    found = run_line(
        options.task,
        policy=options.policy,
        deadline=DEADLINE,
        speed=options.speed,
        pixels=(width, height),
        rate=options.rate,
        force=options.force,
        cameras=source,
        minutes=options.minutes,
        dry=options.cameras == "recordings",
        log=folder,
        keys=Resuming(),
        rules=None if options.cameras == "recordings" else RAYS,
        assets="builtin",
    )
    return replayed(found, folder)


def record(options: argparse.Namespace, folder: Path, pixels: tuple[int, int]) -> dict[str, Path]:
    """Recordings of the scene in which the arm stands, by camera."""
    given = read_task_input(options.task, assets="builtin")
    world = SimulatedWorld(given.scene)
    world.reset(0)
    cameras = [each for each in simulated_cameras(world.profile, *pixels) if each.link is None]
    taker = SimulatedCameras(world.profile, tuple(cameras), seed=0)
    shots = [{frame.camera: frame for frame in taker.take(world.rows(0.0))} for _ in range(SHOTS)]
    files = {camera.name: folder / f"{camera.name}.db3" for camera in cameras}
    rate = round(options.rate)
    devices = {camera.name: SoftwareDevice(camera, f"recorded-{camera.name}", rate) for camera in cameras}
    recorders = {name: device.recorder(files[name]) for name, device in devices.items()}
    films = RealSenseCameras(cameras, recorders, rate)  # what is not open is not recorded
    due = time.monotonic()
    for number in range(round(RECORDED * options.rate)):
        for name, device in devices.items():
            device.give(replace(shots[number % SHOTS][name], number=number, captured=due))
        films.poll()
        due += 1.0 / options.rate
        time.sleep(max(0.0, due - time.monotonic()))
    films.close()
    world.close()
    return files


def run_simulated(
    options: argparse.Namespace, policy: Path | str | None, folder: Path, seed: int = 0, fault: str | None = None
) -> dict[str, Any]:
    """The same by a simulated clock, in this process; one episode, or until the fault is over."""
    width, height = map(int, options.pixels.split("x"))
    found = run_line(
        options.task,
        policy=policy,
        deadline=DEADLINE,
        speed=options.speed,
        pixels=(width, height),
        minutes=(2.0 * SIMULATED_SECONDS / 60.0) if fault else options.minutes,
        faults=[Fault.parse(fault)] if fault else [],
        seed=seed,
        log=folder,
        assets="builtin",
        simulated_clock=True,
    )
    return replayed(found, folder)


@contextlib.contextmanager
def served() -> Iterator[str]:
    """A server of a controller that stands still, for what only a server can refuse; gives its URL."""
    token = os.environ[protocol.TOKEN] = "a token of this benchmark"
    server = PolicyServer(looking("panda"), "panda", token, port=0)
    threading.Thread(target=server.serve, daemon=True).start()
    try:
        yield server.url
    finally:
        server.close()


def words_of(options: argparse.Namespace, policy: Path | str | None) -> list[str]:
    """Words of the command line for a policy, or for the plan."""
    how = ["--plan"] if policy is None else ["--policy", str(policy), "--deadline", str(DEADLINE)]
    return [options.task, *how, "--speed", str(options.speed), "--pixels", options.pixels, "--assets", "builtin"]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--task", default="CloseBox")
    parser.add_argument("--policy", type=Path)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--speed", type=float, default=0.5)
    parser.add_argument("--pixels", default="320x240")
    parser.add_argument("--force", type=float, default=140.0, help="that stops the run without a fault, N")
    parser.add_argument("--cameras", choices=("simulated", "software", "recordings"), default="simulated")
    parser.add_argument("--rate", type=float, default=10.0)
    parser.add_argument("--faults", type=int, default=10, help="times that each is tried")
    parser.add_argument("--simulated-clock", action="store_true")
    parser.add_argument("--only", nargs="*", default=list(ENDS), help="names of faults")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    seconds = SIMULATED_SECONDS if options.simulated_clock else SECONDS
    draw = rng(options.seed, "faults of the line")
    figures: dict[str, Any] = {"faults": {}}
    wrong = 0
    with tempfile.TemporaryDirectory() as place, contextlib.ExitStack() as stack:
        folder = Path(place) / "quiet"
        if options.simulated_clock:
            quiet = run_simulated(options, options.policy, folder)
        else:
            quiet = run_quiet(options, folder)
        figures["quiet"] = quiet
        wrong += quiet["limits_passed"] + quiet["differs"]
        for name in ("periods_ms", "overrun_ms", "commands_late_ms", "clouds_ms", "picture_age_ms", "acting_ms"):
            each = {key: None if value is None else round(value, 2) for key, value in quiet[name].items()}
            print(f"{name:16} {each}")
        counted = ("scheduling", "overruns", "skipped_ms", "late_actions", "limits_passed", "replayed", "differs")
        print(", ".join(f"{name} {quiet[name]}" for name in counted))
        print(f"{quiet['state']}: {quiet['reason']}; {quiet['episodes']} episodes, success {quiet['success']}")
        for reason, times in Counter(re.sub(r"[0-9.]+", "#", each["reason"]) for each in quiet["halts"]).items():
            print(f"held {times} times: {reason}")
        for name, state in ((name, ENDS[name]) for name in options.only if options.faults):
            found = []
            policy = stack.enter_context(served()) if name == "policy-token" else options.policy
            for number in range(options.faults):
                at = draw.uniform(1.0, seconds)
                folder = Path(place) / f"{name}_{number}"
                if options.simulated_clock:
                    found.append(run_simulated(options, policy, folder, number, f"{name}@{at:.2f}"))
                else:
                    seeded = [*words_of(options, policy), "--seed", str(number), "--fault", f"{name}@{at:.2f}"]
                    found.append(run(seeded, 2.0 * seconds / 60.0, folder))
                shutil.rmtree(folder, ignore_errors=True)
            figures["faults"][name] = found
            ended = sum(each["state"] == state for each in found)
            took = [each["detected_to_stopped_ms"] for each in found if each["detected_to_stopped_ms"] is not None]
            whole = sum(each["differs"] == 0 for each in found)
            late = sum(each > WITHIN + 1e-6 for each in took) + len(found) - len(took)
            wrong += len(found) - ended + len(found) - whole + late + sum(each["limits_passed"] for each in found)
            longest = max(took, default=float("nan"))
            line = f"{name:18} {state} {ended}/{len(found)}, stopped within {longest:.0f} ms, {whole} logs whole"
            print(line, sorted({each["reason"][:60] for each in found}), flush=True)
    if options.json is not None:
        options.json.write_text(json.dumps(figures, indent=2) + "\n")
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
