"""Trials: protocols that match their tasks, placements, answers, stored results, and the table."""

from __future__ import annotations

import json
import math
import os
import pty
import select
import signal
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gensim2.cli import main as cli
from gensim2.core.errors import InputError
from gensim2.core.resumable import FolderLock
from gensim2.rollout.controller_spec import ControllerSpec
from gensim2.scenes.sampler import SceneSampler
from gensim2.tasks.library import load_task
from gensim2_robot.opening import Prepared
from gensim2_robot.pipes import DeviceGoneError
from gensim2_robot.trial.record import (
    Trial,
    TrialFolder,
    TrialSettings,
    protocol_names,
    read_protocol,
    read_trials,
    reset_options,
    row_of,
    write_table,
)
from gensim2_robot.trial.run import trial

REAL = ["--policy", "somewhere", "--arm", "franka:1.2.3.4", "--cameras", "realsense:left=1"]
PAPER = "OpenLaptop CloseLaptop OpenSafe CloseSafe PushDrawerClose SwingBucketHandle OpenBox CloseBox"


def test_the_papers_tasks_have_protocols_that_fit_them() -> None:
    assert set(protocol_names()) == set(PAPER.split())
    for name in protocol_names():
        found, task = read_protocol(name), load_task(name)
        found.require(task)
        assert found.task == name
        assert found.sentence == task.description, "policies know this sentence"
        assert found.verdict.endswith("?")


def test_placements_stay_in_their_ranges_and_follow_from_seed_and_number() -> None:
    protocol = read_protocol("OpenSafe")
    (given,) = protocol.placements.values()
    drawn = [protocol.place(3, number)["safe"] for number in range(200)]
    assert drawn[:5] == [protocol.place(3, number)["safe"] for number in range(5)]
    assert drawn[0] != protocol.place(4, 0)["safe"]
    x, y, yaw = np.array([each.offset for each in drawn]).T
    assert given.openness is not None
    opened = np.array([each.openness for each in drawn])
    for values, (low, high) in ((x, given.x), (y, given.y), (opened, given.openness)):
        assert low <= values.min() < low + 0.1 * (high - low)
        assert high - 0.1 * (high - low) < values.max() <= high
    assert np.abs(yaw).max() <= math.radians(given.yaw)
    assert (np.sign(yaw) == np.sign(y)).all(), "towards the robot"
    np.testing.assert_allclose([[each.x, each.y] for each in drawn], np.array(given.at) + np.stack([x, y], 1))


def test_the_simulator_lays_out_what_a_person_is_told() -> None:
    protocol, sampler = read_protocol("CloseBox"), SceneSampler("CloseBox", assets="builtin")
    placed = [protocol.place(0, number) for number in (0, 1)]
    one, two = (sampler.sample(7, reset_options(each)).objects["box"] for each in placed)
    first, second = (each["box"] for each in placed)
    np.testing.assert_allclose(two.position[:2] - one.position[:2], [second.x - first.x, second.y - first.y])
    assert (one.openness, two.openness) == (first.openness, second.openness)
    said = first.told("box")
    assert f"{100 * first.x:.0f} cm ahead" in said
    assert ("left" if first.y >= 0 else "right") in said


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"verdict": ""}, "verdict"),
        ({"objects": {"lid": "a lid"}}, "must have the same names"),
        ({"placements": {"box": {"at": [0.5]}}}, "placements.box.at"),
        ({"placements": {"box": {"at": [0.5, 0.0], "openness": [0.6, 0.5]}}}, "must not exceed the second"),
        ({"colour": "red"}, "colour"),
        ({"placements": {"box": {"at": [1e308, 0.0]}}}, "placements.box.at.0"),
        ({"placements": {"box": {"at": [0.5, -4.0]}}}, "placements.box.at.1"),
    ],
)
def test_a_protocol_that_cannot_be_used_names_file_and_field(tmp_path: Path, change: dict[str, Any], said: str) -> None:
    path = tmp_path / "mine.json"
    path.write_text(json.dumps({**read_protocol("CloseBox").model_dump(mode="json"), **change}))
    with pytest.raises(InputError) as error:
        read_protocol(str(path))
    assert said in str(error.value)
    assert "mine.json" in str(error.value)
    with pytest.raises(InputError, match="has box"):
        read_protocol("OpenSafe").require(load_task("CloseBox"))


def asked(**change: Any) -> TrialSettings:
    fields = {"task": "CloseBox", "policy": "plan", "seed": 0, "protocol": {}, "line": {"arm": "simulated"}}
    return TrialSettings(**{**fields, "scene": {}, **change})  # type: ignore[arg-type]


def record(number: int, success: bool, cause: str | None = None) -> Trial:
    words = {"by": "person", "goal": None, "state": "idle", "reason": "episode over", "seconds": 1.0, "at": "now"}
    return Trial(number=number, placements={}, success=success, cause=cause, **words)  # type: ignore[arg-type]


def test_the_table_has_wilsons_interval_and_the_causes(tmp_path: Path) -> None:
    with TrialFolder(tmp_path / "CloseBox", asked(), resume=False) as folder:
        for number in range(10):
            folder.add(record(number, number < 7, None if number < 7 else "it slipped | and fell"))
    found = write_table(tmp_path)
    (row,) = found["rows"]
    share, z, n = 0.7, 1.959963984540054, 10
    middle = (share + z * z / (2 * n)) / (1 + z * z / n)
    half = z / (1 + z * z / n) * math.sqrt(share * (1 - share) / n + z * z / (4 * n * n))
    np.testing.assert_allclose(row["interval"], [middle - half, middle + half], atol=1e-9)
    assert row["causes"] == {"it slipped | and fell": 3}
    assert json.loads((tmp_path / "table.json").read_text())["rows"][0]["records"][3]["success"] is True
    lines = (tmp_path / "table.md").read_text().splitlines()
    assert len({line.count("|") for line in lines}) == 1
    assert "| 0.70 | 0.40 to 0.89 | 3 it slipped / and fell |" in lines[2]
    assert row_of(asked(), [])["interval"] == [0.0, 1.0]


def test_what_is_gone_on_with_must_be_the_same_and_a_line_that_was_cut_off_is_none(tmp_path: Path) -> None:
    with TrialFolder(tmp_path, asked(), resume=False) as folder:
        folder.add(record(0, True))
    with (tmp_path / "trials.jsonl").open("a") as stream:
        stream.write('{"number": 1, "succ')
    with pytest.raises(InputError, match="--resume"):
        TrialFolder(tmp_path, asked(), resume=False)
    with pytest.raises(InputError, match="policy"):
        TrialFolder(tmp_path, asked(policy="another"), resume=True)
    with TrialFolder(tmp_path, asked(), resume=True) as folder:
        assert set(folder.trials) == {0}
        with pytest.raises(InputError, match="another run is using this folder"):
            TrialFolder(tmp_path, asked(), resume=True)
        folder.add(record(1, False, "why"))
    assert [each.number for each in read_trials(tmp_path)] == [0, 1]
    whole = (tmp_path / "trials.jsonl").read_text()
    for change, said in (
        ("nonsense\n", "line 1"),
        (whole.replace("1.0", "1e999"), "line 1"),
        (whole + whole, "line 3.*repeats trial 0"),
        ("[" * 10**5 + "\n", "line 1"),
        ('{"number": \ud800}\n', "line 1"),
    ):
        (tmp_path / "trials.jsonl").write_bytes(change.encode("utf-8", "surrogatepass"))
        with pytest.raises(InputError, match=said):
            read_trials(tmp_path)
    (tmp_path / "trials.jsonl").write_text(whole + '{"cut": ')
    assert len(read_trials(tmp_path)) == 2
    assert (tmp_path / "trials.jsonl").read_text() == whole + '{"cut": ', "a reader writes nothing"
    (tmp_path / "trials.jsonl").unlink()
    os.mkfifo(tmp_path / "trials.jsonl")
    with pytest.raises(InputError, match="is a pipe"):
        read_trials(tmp_path)
    (tmp_path / "asked.json").write_text(asked(line={}).model_dump_json())
    assert row_of(asked(line={}), [])["arm"] == ""


def test_a_second_process_is_refused_and_a_link_out_of_the_folder_too(tmp_path: Path) -> None:
    folder = tmp_path / "CloseBox"
    line: dict[str, Any] = {"assets": "builtin", "simulated_clock": True, "pixels": (64, 48)}

    def refused(said: str) -> None:
        with pytest.raises(InputError, match=said):
            trial(read_protocol("CloseBox"), out=tmp_path, trials=1, verdict="simulator", **line)
        assert not (folder / "asked.json").exists()

    with FolderLock(folder):
        refused("another run is using this folder")
    (folder / "log_0000").symlink_to("/gone")
    refused("log_0000: is a link out of the folder")


class Scripted:
    """A fake person who answers no with a reason; Ctrl-C is pressed at the second question."""

    def __init__(self) -> None:
        self.asked: list[tuple[str, bool | None]] = []

    def lay_out(self, lines: Sequence[str]) -> None:
        raise AssertionError("the simulator lays out")

    def judge(self, question: str, offered: bool | None) -> bool:
        self.asked.append((question, offered))
        if len(self.asked) == 2:
            raise KeyboardInterrupt
        return False

    def cause(self, causes: Sequence[str]) -> str:
        return causes[0]


def test_ctrl_c_keeps_what_is_finished_and_resuming_goes_on(tmp_path: Path) -> None:
    protocol, person = read_protocol("CloseBox"), Scripted()
    still = ControllerSpec("gensim2.policy.no_op:NoOpPolicy", {"arm": 7})
    line: dict[str, Any] = {"assets": "builtin", "simulated_clock": True, "pixels": (64, 48), "speed": 1.0}
    with pytest.raises(KeyboardInterrupt):
        trial(protocol, out=tmp_path, trials=3, person=person, policy=still, **line)
    assert person.asked == [(protocol.verdict, False)] * 2
    (first,) = json.loads((tmp_path / "table.json").read_text())["rows"][0]["records"]
    assert (first["number"], first["success"], first["cause"], first["by"]) == (0, False, protocol.causes[0], "person")
    found = trial(protocol, out=tmp_path, trials=3, verdict="simulator", resume=True, policy=still, **line)
    (row,) = found["rows"]
    assert (row["trials"], row["successes"]) == (3, 0)
    assert row["judged_by"] == {"simulator": 2, "person": 1}
    assert [each["placements"] for each in row["records"]] == [
        {name: {**vars(each), "offset": list(each.offset)} for name, each in protocol.place(0, number).items()}
        for number in range(3)
    ]
    with pytest.raises(InputError, match="line"):
        trial(
            protocol, out=tmp_path, trials=3, verdict="simulator", resume=True, policy=still, **{**line, "speed": 0.5}
        )


def test_a_signal_while_devices_open_ends_the_trials(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def opening(prepared: Prepared, *, interrupted: Sequence[int] = (), **_: Any) -> None:
        signal.raise_signal(signal.SIGINT)
        assert list(interrupted) == [signal.SIGINT]
        raise DeviceGoneError("a person asked to stop")

    monkeypatch.setattr("gensim2_robot.trial.run.opened", opening)
    policy = ControllerSpec("gensim2.policy.no_op:NoOpPolicy", {"arm": 7})
    with pytest.raises(KeyboardInterrupt):
        trial(read_protocol("CloseBox"), out=tmp_path, verdict="simulator", policy=policy, assets="builtin")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["Juggle", "--plan"], "no protocol 'Juggle'"),
        (["CloseBox"], "either --plan or --policy"),
        (["CloseBox", "--plan", "--resume"], "--out"),
        (["CloseBox", *REAL], "a trial moves the arm"),
        (["CloseBox", *REAL, "--move"], "a person must confirm the motion at a terminal"),
    ],
)
def test_wrong_words_of_a_trial_are_told(capfd: pytest.CaptureFixture[str], words: list[str], said: str) -> None:
    assert cli.run(["robot", "trial", *words]) == 2
    assert said in capfd.readouterr().err


def test_a_person_at_a_terminal_types_and_ctrl_c_is_heard_at_once(tmp_path: Path) -> None:
    """With a real terminal (pty): answers are read as lines, and typed text is not erased."""
    script = tmp_path / "asks.py"
    script.write_text(
        "import sys\n"
        "from gensim2_robot.devices import Keys\n"
        "from gensim2_robot.trial.run import Terminal\n"
        "from gensim2.core.progress import ConsoleProgress\n"
        "with ConsoleProgress() as progress, Keys() as keys:\n"
        "    person = Terminal(keys, progress)\n"
        "    person.lay_out(['box: there'])\n"
        "    print('said', person.judge('Is it closed?', True), person.cause(['a', 'b']), flush=True)\n"
        "    try:\n"
        "        person.judge('And now?', None)\n"
        "    except BaseException as error:\n"
        "        print('ended', type(error).__name__, flush=True)\n"
    )
    process, terminal = pty.fork()
    if process == 0:
        os.execv(sys.executable, [sys.executable, str(script)])
    typed = [(b"Enter begins", b"\n"), (b"[Y/n]", b"n\n"), (b"own words", b"9\n"), (b"own words", b"2\n")]
    typed.append((b"And now?", b"\x03"))
    heard, end = b"", time.monotonic() + 120.0
    for question, answer in [*typed, (b"ended", b"")]:
        while question not in heard:
            assert time.monotonic() < end, heard
            if select.select([terminal], [], [], 1.0)[0]:
                heard += os.read(terminal, 4096)
            elif not answer:  # readline may miss early input: type it again
                os.write(terminal, b"\x03")
        heard = heard[heard.index(question) + len(question) :] if answer else heard
        if b"said" in heard:
            assert b"said False b" in heard
        os.write(terminal, answer)
    assert b"ended Abort" in heard
    os.waitpid(process, 0)
