"""Every way in which the command line ends has its exit code and a message of one line."""

from __future__ import annotations

import json
import os
import pickle
import subprocess
import sys
from importlib.metadata import EntryPoints
from pathlib import Path

import click
import pytest

import gensim2.doctor
from gensim2.cli import main as cli
from gensim2.cli.output import report
from gensim2.cli.solve import solve
from gensim2.core.errors import GenSim2Error, InputError, MissingExtraError, NotRunError
from gensim2.doctor import Check, DoctorReport


def _command_that_raises(monkeypatch: pytest.MonkeyPatch, error: BaseException) -> None:
    @click.command("tasks")
    def tasks() -> None:
        raise error

    monkeypatch.setattr(cli.LazyGroup, "get_command", lambda *_: tasks)


@pytest.mark.parametrize(
    ("error", "code", "words"),
    [
        (InputError("is broken", file="a.yaml", field="success"), 2, "a.yaml: success: is broken"),
        (InputError("two\nlines"), 2, "two lines"),
        (MissingExtraError("mani_skill", "sim"), 2, "pip install 'gensim2[sim]'"),
        (ModuleNotFoundError("no", name="sapien.core"), 2, "pip install 'gensim2[sim]'"),
        (ModuleNotFoundError("no", name="msgpack"), 2, "pip install 'gensim2[remote]'"),
        (MissingExtraError("ur_rtde", "ur", "gensim2-robot"), 2, "pip install 'gensim2-robot[ur]'"),
        (GenSim2Error("a worker died"), 1, "a worker died"),
        (NotRunError("OpenBox: demos", {4: "took too long"}), 3, "OpenBox: demos: could not be run: 4 (took too long"),
        (KeyboardInterrupt(), 130, "interrupted"),
        (SystemExit(0), 3, "something called sys.exit(0)"),
    ],
)
def test_exit_codes(
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
    error: BaseException,
    code: int,
    words: str,
) -> None:
    _command_that_raises(monkeypatch, error)
    assert cli.run(["tasks"]) == code
    out, err = capfd.readouterr()
    assert out == ""
    assert words in err
    assert err.strip().count("\n") == 0


@pytest.mark.parametrize("error", [ZeroDivisionError("ours"), ModuleNotFoundError("no", name="gensim2.lost")])
def test_a_bug_keeps_its_traceback(monkeypatch: pytest.MonkeyPatch, error: Exception) -> None:
    _command_that_raises(monkeypatch, error)
    with pytest.raises(type(error)):
        cli.run(["tasks"])


@pytest.mark.parametrize(
    "arguments",
    [
        ["nonsense"],
        ["run-pipeline", "--seed", "-1"],
        ["run-pipeline", "--episodes", "-1"],
        ["run-pipeline", "--workers", "two"],
        ["run-pipeline", "--no-such-flag"],
        ["demo"],
        ["solve", "--json"],
    ],
)
def test_bad_flags_are_bad_input(capfd: pytest.CaptureFixture[str], arguments: list[str]) -> None:
    assert cli.run(arguments) == 2
    out, err = capfd.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    assert "--help" in err


def test_a_distribution_adds_its_command_and_is_named_where_it_is_missing(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    context = click.Context(cli.cli)
    assert cli.cli.list_commands(context) == [*cli.COMMANDS, "robot"]
    assert cli.run(["robot", "--help"]) == 0
    assert "dry-run" in capfd.readouterr().out
    monkeypatch.setattr(cli, "entry_points", lambda **_: EntryPoints())
    assert cli.cli.list_commands(context) == list(cli.COMMANDS)
    assert cli.run(["robot", "check"]) == 2
    assert capfd.readouterr().err == "gensim2: gensim2 robot is not installed (pip install gensim2-robot)\n"


@pytest.mark.parametrize("name", sorted(cli.COMMANDS))
def test_every_command_explains_itself(capfd: pytest.CaptureFixture[str], name: str) -> None:
    assert cli.run([name, "--help"]) == 0
    out, _ = capfd.readouterr()
    assert "Usage: gensim2" in out


def test_help_is_quick_because_imports_are_late() -> None:
    script = (
        "import sys; from gensim2.cli.main import run; run(['--help']); run(['run-pipeline', '--help']);"
        "sys.exit(any(name in sys.modules for name in ('torch', 'mani_skill', 'sapien', 'scipy')))"
    )
    assert subprocess.run([sys.executable, "-c", script], capture_output=True, check=False).returncode == 0


def test_tasks_list_as_json(capfd: pytest.CaptureFixture[str]) -> None:
    assert cli.run(["tasks", "list", "--json"]) == 0
    tasks = json.loads(capfd.readouterr().out)["tasks"]
    assert {"OpenBox", "CloseBox", "OpenDrawer", "TurnOnFaucet"} <= {task["name"] for task in tasks}
    assert all(task["env_id"] == f"GenSim2-{task['name']}-v1" for task in tasks)


def test_json_to_a_file_leaves_the_table_on_standard_output(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert cli.run(["tasks", "list", "--json", str(tmp_path / "tasks.json")]) == 0
    assert "OpenBox" in capfd.readouterr().out
    assert json.loads((tmp_path / "tasks.json").read_text())["schema_version"] == 1


@pytest.mark.parametrize(
    ("arguments", "task", "json_file"),
    [
        (["OpenBox", "--json"], "OpenBox", "-"),
        (["--json", "-", "OpenBox"], "OpenBox", "-"),
        (["--json", "box.json", "OpenBox"], "OpenBox", "box.json"),
        (["OpenBox", "--json", "box.json"], "OpenBox", "box.json"),
        (["OpenBox", "--json=box"], "OpenBox", "box"),
        (["OpenBox"], "OpenBox", None),
    ],
)
def test_json_does_not_swallow_the_task(arguments: list[str], task: str, json_file: str | None) -> None:
    context = solve.make_context("solve", arguments)
    assert context.params["task"] == task
    assert context.params["json_file"] == json_file


def test_a_file_that_cannot_be_written_is_refused_before_the_work(capfd: pytest.CaptureFixture[str]) -> None:
    for target in ("/proc/nowhere/result.json", "/proc"):
        assert cli.run(["tasks", "list", "--json", target]) == 2
        out, err = capfd.readouterr()
        assert out == ""
        assert err.startswith(f"gensim2: {target}: --json: ")


@pytest.mark.parametrize("words", [["demo", "CloseBox"], ["benchmark"], ["learn", "CloseBox"], ["run-pipeline"]])
def test_going_on_needs_the_folder_that_is_gone_on_with(
    words: list[str], capfd: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert cli.run([*words, "--resume"]) == 2
    assert "add --out" in capfd.readouterr().err
    assert not list(tmp_path.iterdir())


def test_unknown_library_folder_is_bad_input(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    missing = tmp_path / "nowhere"
    assert cli.run(["assets", "list", "--assets", str(missing), "--json"]) == 2
    out, err = capfd.readouterr()
    assert out == ""
    assert str(missing) in err


def test_only_the_document_reaches_standard_output(capfd: pytest.CaptureFixture[str]) -> None:
    with report("-", lambda _: None) as (progress, give):
        print("a print")
        os.write(1, b"a library written in C++\n")
        subprocess.run(["echo", "a worker"], check=True)
        progress.start("stage", 1)
        progress.advance()
        give({"answer": 42})
    out, err = capfd.readouterr()
    assert json.loads(out) == {"answer": 42}
    for words in ("a print", "a library written in C++", "a worker", "stage: 1/1"):
        assert words in err


def test_nothing_is_written_when_a_command_fails(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    target = tmp_path / "result.json"
    with pytest.raises(InputError), report(str(target), lambda _: None):
        raise InputError("no")
    assert not target.exists()
    with pytest.raises(InputError), report("-", lambda _: None):
        raise InputError("no")
    assert capfd.readouterr().out == ""


@pytest.mark.parametrize(("status", "code"), [("ok", 0), ("limited", 0), ("missing", 1)])
def test_doctor_ends_with_1_where_something_needed_is_missing(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str], status: str, code: int
) -> None:
    check = Check("Solver", status, "found", "build it")  # type: ignore[arg-type]
    monkeypatch.setattr(gensim2.doctor, "doctor", lambda *_: DoctorReport((check,)))
    assert cli.run(["doctor", "--json"]) == code
    answer = json.loads(capfd.readouterr().out)
    assert answer["healthy"] is (code == 0)
    assert answer["checks"][0]["remedy"] == "build it"


def test_a_reader_that_leaves_early_is_no_error() -> None:
    script = f"{sys.executable} -m gensim2 tasks list --json | head -n 1"
    result = subprocess.run(["bash", "-c", script], capture_output=True, text=True, check=False)
    assert result.stdout == "{\n"
    assert "Traceback" not in result.stderr
    assert "BrokenPipe" not in result.stderr


def test_ctrl_c_ends_with_130() -> None:
    script = (
        "import click, os, signal, gensim2.cli.main as m\n"
        "@click.command('tasks')\n"
        "def tasks(): os.kill(os.getpid(), signal.SIGINT)\n"
        "m.LazyGroup.get_command = lambda *_: tasks\n"
        "m.main(['tasks'])"
    )
    result = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert result.returncode == 130
    assert "Traceback" not in result.stderr


@pytest.mark.parametrize(
    "error",
    [MissingExtraError("sapien", "sim"), InputError("is broken", file="a.yaml", field="success", remedy="mend it")],
)
def test_errors_come_whole_from_a_worker(error: GenSim2Error) -> None:
    again = pickle.loads(pickle.dumps(error))
    assert type(again) is type(error)
    assert str(again) == str(error)
    assert again.__dict__ == error.__dict__
