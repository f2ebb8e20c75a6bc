"""Damage logs, calibrations, trials, protocols and noise files, and check what their readers do.

``python tests/fuzz/logs.py --inputs 5000 --files 2000`` damages this many logs and other files. Each is read in its own
process with 1 GiB of memory and 5 s of CPU, beside modules that report their import. Each must be accepted with its
original content or refused in one line, without running code or writing other files.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import shutil
import socket
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import CompressionType, Writer
from mutate import Kind, check_line, damaged, damaged_value
from runner import Ended, Round, Say, Tally, in_process, main, tried

from gensim2.core.errors import InputError
from gensim2.core.record_files import read_record
from gensim2.core.yaml_files import dump_yaml, read_yaml
from gensim2.perception import D435, Camera, ObservationSpec
from gensim2.perception.camera_record import CameraRecord
from gensim2.perception.noise import NoiseFile, read_noise
from gensim2.robots import robot
from gensim2_robot.calibration.file import Calibration, CameraCalibration, calibrated, read_calibration
from gensim2_robot.calibration.poses import read_standing
from gensim2_robot.devices import ArmState, CameraFrame
from gensim2_robot.drivers.logged import LoggedCameras
from gensim2_robot.eyes import Eyes, SensorSnapshot, inputs
from gensim2_robot.fit_noise import fit_log
from gensim2_robot.log import ENCODING, Log
from gensim2_robot.log_messages import About, pack, unpack
from gensim2_robot.log_reader import messages, replay
from gensim2_robot.mind import ControllerAnswer, Question
from gensim2_robot.simulated import simulated_cameras
from gensim2_robot.trial.record import Trial, TrialFolder, TrialSettings, read_protocol, read_trials, row_of

FILE = "log_000000.mcap"
CANARIES = ("notes.py", "panda.py", "mcap.py", "sitecustomize.py")
"""Names of modules beside each input, which damaged data may contain."""
NAMES = ("notes.py", "notes:robot", "./panda.py", "os:system", "../notes.py", "mcap")


@cache
def camera_of() -> Camera:
    """Return the camera of all good files."""
    return replace(simulated_cameras(robot("panda"), 32, 24)[0], name="left")


@dataclass(frozen=True)
class Subject:
    """A good file and its reader.

    Attributes:
        name: kind of input.
        file: the file to damage, relative to the folder.
        kind: kind of its content.
        read: takes the folder and returns its content as plain data.
    """

    name: str
    file: str
    kind: Kind
    read: Callable[[Path], Any]


def good_folder(folder: Path) -> None:
    """Fill a folder with a valid log, calibration, trials, protocol and noise file, and the modules that report their
    import.
    """
    _write_log(folder / "log")
    camera = camera_of()
    one = CameraCalibration(
        serial="1",
        method="mesh",
        link=None,
        pose=camera.T_base_camera.tolist(),
        width=camera.width,
        height=camera.height,
        intrinsic=camera.intrinsic.tolist(),
        residual_mm=1.0,
        held_out_mm=1.5,
        links_mm={"panda_hand": 1.0},
    )
    Calibration(made=datetime.now(UTC), robot="panda", cameras={"left": one}).write(folder / "calibration.json")
    (folder / "noise.json").write_text(NoiseFile(noise=vars(D435), told={"lost": 300}).model_dump_json(indent=1))
    protocol = read_protocol("CloseBox").model_dump(mode="json")
    (folder / "protocol.yaml").write_text(dump_yaml(protocol))
    asked = TrialSettings(
        task="CloseBox", policy="p", seed=0, protocol=protocol, line={"arm": "simulated"}, scene={"n": 1}
    )
    words: dict[str, Any] = {"by": "person", "goal": None, "state": "idle", "reason": "over", "at": "2027-01-01"}
    with TrialFolder(folder / "trials", asked, resume=False) as trials:
        for number in range(4):
            placed = {name: vars(each) for name, each in read_protocol("CloseBox").place(0, number).items()}
            words: dict[str, Any] = {
                "by": "person",
                "goal": None,
                "state": "idle",
                "reason": "over",
                "at": "2027-01-01",
            }
            success = number % 2 == 0
            cause = None if success else "it slipped"
            trials.add(Trial(number=number, placements=placed, success=success, cause=cause, seconds=1.5, **words))
    for place in (folder, folder / "log", folder / "trials"):
        for name in CANARIES:
            (place / name).write_text(f"open({str(folder.parent / 'code-ran')!r}, 'w').close()\nrobot = None\n")


def _write_log(folder: Path) -> None:
    """Write a log of an arm in front of a box with two requests, whose observations can be computed again."""
    camera, profile = camera_of(), robot("panda")
    spec = ObservationSpec.of({"cameras": ["left"], "points": 64, "candidates": 0, "robot": "all"})
    about = About(
        robot="panda",
        language="Close the box.",
        observation=spec.to_dict(),
        cameras=[CameraRecord.of(camera)],
        pixels=1000,
    )
    log = Log(folder, about)
    eyes = Eyes(spec, profile, (camera,), about.language, 1000)
    draw, q = np.random.default_rng(0), np.array(profile.reset_qpos)
    for number in range(12):
        moment = 0.1 * number
        for cycle in range(5):
            log.state(ArmState(moment + 0.02 * cycle, q, 0.0 * q, 1.5))
        depth = draw.integers(300, 500, (camera.height, camera.width)).astype(np.uint16)
        colors = draw.integers(0, 255, (camera.height, camera.width, 3)).astype(np.uint8)
        frame = CameraFrame("left", number, moment + 0.01, depth, colors, "1")
        log.frame(frame)
        log.clocks(moment, 0.0, {"left": 0.01})
        if number in (4, 8):
            sight = SensorSnapshot(number, q, 0.0 * q, 1.0, (frame,), {"left": q})
            log.question(moment, Question(number, sight, 2))
            seen = inputs(eyes.observe(sight))
            log.answer(moment, ControllerAnswer(number, np.zeros((2, 8), np.float32), seen=seen, cloud_ms=1.0))
    log.change(1.2, "idle", "episode over")
    log.close()


# --------------------------------------------------------------------- readers


def _content(folder: Path) -> list[str]:
    """Return a digest of each message of the log."""
    found = []
    for topic, message in messages(folder / "log"):
        arrays = [value for value in vars(message).values() if isinstance(value, np.ndarray)]
        told = hashlib.sha256(f"{topic}{message!r}".encode("utf-8", "backslashreplace"))
        for array in arrays:
            told.update(array.tobytes())
        found.append(told.hexdigest())
    return found


def _refusing(read: Callable[[], object]) -> None:
    """Call a reader and check its error message, if it refuses; another reader may accept the same file."""
    try:
        read()
    except InputError as error:
        check_line(str(error))


def read_log(folder: Path) -> list[str]:
    """Read a log with all readers; return digests of its messages."""
    log = folder / "log"
    found = _content(folder)
    with tempfile.TemporaryDirectory() as out:
        _refusing(lambda: replay(log))
        _refusing(lambda: read_standing(log))
        _refusing(lambda: fit_log(log, Path(out) / "noise.json"))
        _refusing(lambda: LoggedCameras([camera_of()], {"left": log}).poll())
    return found


def _read_calibration(folder: Path) -> Any:
    found = read_calibration(folder / "calibration.json", "panda", [camera_of()], days=1000.0)
    assert all(np.isfinite(camera.rays).all() for camera in calibrated([camera_of()], found))
    return found.model_dump(mode="json", exclude={"made"})


def _read_trials(folder: Path) -> Any:
    trials = read_trials(folder / "trials")
    row_of(read_record(folder / "trials" / "asked.json", TrialSettings, "-"), trials)
    return [each.model_dump(mode="json") for each in trials]


def _read_asked(folder: Path) -> Any:
    found = read_record(folder / "trials" / "asked.json", TrialSettings, "-")
    row_of(found, read_trials(folder / "trials"))
    return found.model_dump(mode="json")


def _read_protocol(folder: Path) -> Any:
    found = read_protocol(str(folder / "protocol.yaml"))
    for number in range(3):
        for name, placed in found.place(0, number).items():
            assert np.isfinite([placed.x, placed.y, *placed.offset]).all()
            placed.told(name)
    return found.model_dump(mode="json")


def _read_noise(folder: Path) -> Any:
    noise = read_noise(folder / "noise.json")
    noise.on(np.ones((24, 32), np.float32), np.random.default_rng(0), np.zeros((24, 32, 3), np.uint8))
    return {"noise": vars(noise)}


LOG = Subject("log", f"log/{FILE}", "binary", read_log)
FILES = (
    Subject("calibration", "calibration.json", "json", _read_calibration),
    Subject("trials", "trials/trials.jsonl", "lines", _read_trials),
    Subject("asked", "trials/asked.json", "json", _read_asked),
    Subject("protocol", "protocol.yaml", "yaml", _read_protocol),
    Subject("noise", "noise.json", "json", _read_noise),
)


# ---------------------------------------------------------------------- damage


def _pick(values: Sequence[Any], generator: np.random.Generator) -> Any:
    return values[int(generator.integers(len(values)))]


def damage(path: Path, kind: Kind, generator: np.random.Generator) -> str:
    """Damage a file; return the kind of damage: ``"bytes"`` if its content must not change."""
    chance = generator.random()
    if chance < 0.04:
        return _replaced(path, generator)
    if path.suffix == ".mcap" and chance < 0.6:
        return _rewritten(path, generator)
    path.write_bytes(damaged(path.read_bytes(), kind, generator))
    return "bytes"


def _replaced(path: Path, generator: np.random.Generator) -> str:
    content = path.read_bytes()
    path.unlink()

    def bound() -> None:
        with socket.socket(socket.AF_UNIX) as server:
            server.bind(str(path))

    def sparse() -> None:
        path.write_bytes(content)
        os.truncate(path, 2**40)

    ways: dict[str, Callable[[], object]] = {
        "gone": lambda: None,
        "a pipe": lambda: os.mkfifo(path),
        "a socket": bound,
        "a folder": path.mkdir,
        "a device": lambda: path.symlink_to("/dev/zero"),
        "a link to itself": lambda: path.symlink_to(path.name),
        "a terabyte": sparse,
        "zeros": lambda: path.write_bytes(bytes(2**20)),
    }
    told: str = _pick(list(ways), generator)
    ways[told]()
    return told


def _rewritten(path: Path, generator: np.random.Generator) -> str:
    """Damage messages of a log and write a valid log of them, as an attacker would."""
    found: list[tuple[str, bytes]] = list(_packed(path))
    for _ in range(int(generator.integers(1, 4))):
        place = int(generator.integers(len(found))) if generator.random() < 0.7 else 0
        topic, data = found[place]
        try:
            plain, arrays = unpack(data)
        except InputError:  # damaged before
            continue
        way = int(generator.integers(8))
        if way == 0:
            topic = _pick(("", "/about", "/camera/left", "/camera/", "/arm", "x" * 10**5, "/camera/../x"), generator)
        elif way == 1 and arrays:
            name = _pick(list(arrays), generator)
            arrays[name] = _array(arrays[name], generator)
        elif way == 2 and arrays:
            name = _pick(list(arrays), generator)
            arrays[_pick(("", "q", "posed/right", "seen/x", f"{name}/{name}"), generator)] = arrays.pop(name)
        elif way == 3 and "robot" in plain:
            plain["robot"] = _pick(NAMES, generator)
        elif way == 4:
            found.insert(int(generator.integers(len(found) + 1)), found[place])
            continue
        else:
            plain = damaged_value(plain, generator)
        try:
            found[place] = topic, pack(plain, arrays)
        except (TypeError, ValueError):
            found[place] = topic, damaged(data, "binary", generator)
    stream = io.BytesIO()
    compression = _pick(list(CompressionType), generator)
    writer = Writer(stream, compression=compression, enable_data_crcs=True, use_chunking=bool(generator.random() < 0.9))
    writer.start()
    channels: dict[str, int] = {}
    for topic, data in found:
        if topic not in channels:
            channels[topic] = writer.register_channel(topic, ENCODING, 0)
        writer.add_message(channels[topic], 0, data, 0)
    writer.finish()
    path.write_bytes(stream.getvalue())
    return "rewritten"


def _packed(path: Path) -> Sequence[tuple[str, bytes]]:
    from gensim2_robot.log_reader import _packed as packed

    return list(packed(path))


def _array(values: np.ndarray, generator: np.random.Generator) -> np.ndarray:
    ways: tuple[Callable[[], np.ndarray], ...] = (
        lambda: values[:0],
        lambda: values.reshape(-1),
        lambda: np.concatenate([values, values]),
        lambda: values[..., None],
        lambda: values.astype(np.int64),
        lambda: values.astype(np.float32),
        lambda: np.full(values.shape, np.nan),
        lambda: np.full(values.shape, np.inf),
        lambda: np.full(values.shape, 1e308),
        lambda: np.zeros_like(values),
        lambda: np.full(values.shape, np.iinfo(np.int64).max),
        lambda: np.zeros((4000, 4000), np.uint8),
        lambda: np.zeros(10**6, values.dtype),
    )
    return _pick(ways, generator)()


# --------------------------------------------------------------------- verdict


def verdict(good: Path, subject: Subject, folder: Path, told: str) -> str:
    """Return how reading a damaged file ended."""
    try:
        found = subject.read(folder)
    except InputError as error:
        check_line(str(error))
        return "refused"
    check_accepted(found, good, folder, subject, told)
    return "accepted"


def attempt(good: Path, subject: Subject, scratch: Path, generator: np.random.Generator) -> Ended:
    """Damage a copy of a file and read it; return how it ended.

    Raises:
        AssertionError: it was neither read correctly nor refused in one line, took too much time or memory, or had
            effects.
    """
    folder = scratch / "input"
    shutil.copytree(good, folder)
    told = damage(folder / subject.file, subject.kind, generator)
    try:
        outcome, *cost = in_process(partial(verdict, good, subject, folder, told), folder, 2**30)
    except AssertionError as error:
        raise AssertionError(f"{subject.name}, {told}: {error}") from error
    assert not (good.parent / "code-ran").exists(), f"{told}: code ran"
    return Ended(f"{subject.name}, {told if told in ('bytes', 'rewritten') else 'replaced'}: {outcome}", *cost)


def check_accepted(found: Any, good: Path, folder: Path, subject: Subject, told: str) -> None:
    """Check that the accepted content is that of the file, or that of the file before the damage."""
    if subject is LOG and told == "bytes":
        whole = _content(good)
        assert found == whole[: len(found)], f"{told}: accepted, and another"
        assert len(found) == len(whole) or (folder / subject.file).read_bytes()[-8:] != b"\x89MCAP0\r\n", told
    elif subject.kind in ("json", "yaml"):
        path = folder / subject.file
        held = read_yaml(path) if subject.kind == "yaml" else json.loads(path.read_bytes())
        assert _agrees(held, found), f"{told}: {held} is read as {found}"


def _agrees(held: Any, found: Any) -> bool:
    """Return whether everything in a file is in the data that was read; a range may be a single number."""
    if isinstance(held, dict):
        return all(_agrees(value, found.get(name)) for name, value in held.items() if name not in ("made", "told"))
    if isinstance(held, list):
        return len(held) == len(found) and all(_agrees(*pair) for pair in zip(held, found, strict=True))
    if isinstance(found, list):
        return found == [-held, held]
    return bool(held == found) or found is None


def run(good: Path, subjects: Sequence[Subject], numbers: range, seed: int, scratch: Path, say: Say) -> Tally:
    """Try damaged files, kinds in turn; report and count failures."""

    def one(number: int) -> Ended:
        subject, place = subjects[number % len(subjects)], scratch / f"try{number}"
        place.mkdir(parents=True)
        try:
            return attempt(good, subject, place, np.random.default_rng([seed, number]))
        finally:
            shutil.rmtree(place, ignore_errors=True)
            (good.parent / "code-ran").unlink(missing_ok=True)

    return tried(numbers, one, say)


def prepare(folder: Path) -> dict[str, list[Round]]:
    """Write the good files."""
    good_folder(folder / "good")
    return {"inputs": [partial(run, folder / "good", (LOG,))], "files": [partial(run, folder / "good", FILES)]}


if __name__ == "__main__":
    sys.exit(main(str(__doc__), {"inputs": 5000, "files": 2000}, prepare))
