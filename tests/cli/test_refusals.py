"""Bad input is refused in one line with exit code 2 before anything slow is imported; so are file system errors."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from gensim2.cli import main as cli

TASK_FOLDER = Path(__file__).parents[1] / "common" / "open_drawer"

#: Modules that take seconds to import.
HEAVY = ("torch", "mani_skill", "sapien", "trimesh", "scipy")

#: Run commands in one process; print exit code, CPU seconds, output and imported modules of each.
_SCRIPT = """
import contextlib, io, json, sys, time
from gensim2.cli.main import run
answers = []
for words in json.load(sys.stdin):
    started = time.process_time()
    with contextlib.redirect_stderr(io.StringIO()) as said, contextlib.redirect_stdout(io.StringIO()) as out:
        code = run(words)
    answers.append([code, time.process_time() - started, said.getvalue(), out.getvalue()])
json.dump({"answers": answers, "modules": sorted(sys.modules)}, sys.stdout)
"""

NINES = "9" * 3000
PULL = "strategies/pull.yaml"


def _broken_tasks(folder: Path) -> dict[str, tuple[str, str]]:
    """Return folders that have one error each: name to (file, part of the error message)."""
    task, config = (TASK_FOLDER / "task.yaml").read_text(), (TASK_FOLDER / PULL).read_text()
    nobody, outside = (task.replace("class: drawer", f"class: {name}") for name in ("nope", "../../x"))
    cases = {
        "unknown_field": (task, config + "speed: 3\n", PULL, "speed: is not a known field"),
        "no_constraints": (task, config.replace("constraint_list:", "task_name:"), PULL, "given twice"),
        "empty_config": (task, "task_name: x\n", PULL, "constraint_list: is missing"),
        "bad_number": (task, config.replace("tolerance: 0.001", "tolerance: wide"), PULL, "tolerance: must"),
        "unknown_class": (nobody, config, "task.yaml", "objects.drawer.class: the library builtin has no class"),
        "escaping_class": (outside, config, "task.yaml", "objects.drawer.class: "),
        "unknown_task_field": (task + "speed: 3\n", config, "task.yaml", "speed: unknown field"),
        "date": (task + "extra: 2020-13-45\n", config, "task.yaml", f"line {len(task.splitlines()) + 1}: "),
        "endless_number": (task.replace("400", "4" * 5000), config, "task.yaml", "64 bits"),
        "too_many_steps": (task.replace("400", "400000000"), config, "task.yaml", "max_episode_steps"),
        "laughs": (task, config + "x: &a [" + "1," * 999 + "]\ny: [" + "*a," * 999 + "]\n", PULL, "20000"),
        "binary": (task, "\0\1", PULL, "a control character"),
    }
    for name, (task_text, config_text, _, _) in cases.items():
        (folder / name / "strategies").mkdir(parents=True)
        (folder / name / "task.yaml").write_text(task_text)
        (folder / name / PULL).write_text(config_text)
    (folder / "no_files").mkdir()
    return {name: (file, words) for name, (_, _, file, words) in cases.items()} | {
        "no_files": ("task.yaml", "is not there (give a folder with")
    }


def _refusals(folder: Path) -> list[tuple[list[str], str]]:
    long = "x" * 300
    file = folder / "file"
    file.write_text("")
    loop = folder / "loop"
    loop.symlink_to("loop")
    archive, mixture = folder / "tasks.zip", folder / "mixture.yaml"
    with zipfile.ZipFile(archive, "w"):
        pass
    mixture.write_text("base: [original]\n")
    found: list[tuple[list[str], str]] = []
    for name, (broken, words) in _broken_tasks(folder).items():
        for command in ("demo", "solve"):
            found.append(([command, str(folder / name)], f"{folder / name / broken}: "))
            found.append(([command, str(folder / name)], words))
    for task in ("demo", "solve"):
        found += [
            ([task, "Nope"], "unknown task 'Nope'"),
            ([task, ""], "unknown task ''"),
            ([task, long], "File name too long"),
            ([task, "x" * 3000], "(3000 characters)"),
            ([task, str(loop)], "unknown task"),
            ([task, "OpenDrawer", "--seed", NINES], "(3000 characters)"),
            ([task, "OpenDrawer", "--seed", "x"], "--seed"),
            ([task, "OpenDrawer", "--seed", str(2**32)], "--seed"),
            ([task, "OpenDrawer", "--physics", "newton"], "--physics"),
            ([task, "OpenDrawer", "--randomization", "narrow"], "--randomization"),
            ([task, "OpenDrawer", "--robot", "r2d2"], "robot: no robot 'r2d2'"),
            ([task, "OpenDrawer", "--instances", ""], "no instance ''"),
            ([task, "OpenDrawer", "--instances", NINES], "no instance"),
            ([task, "OpenDrawer", "--instances", "-1"], "no instance '-1'"),
            ([task, "OpenDrawer", "--assets", str(file)], "no such folder"),
            ([task, "OpenDrawer", "--assets", ""], "no such folder"),
            ([task, "OpenDrawer", "--assets", long], "no such folder"),
            ([task, "OpenDrawer", "--out", str(file)], "cannot write: Not a directory"),
            ([task, "OpenDrawer", "--out", long], "cannot write: File name too long"),
            ([task, "OpenDrawer", "--json", str(file / "x")], "--json: cannot write: Not a directory"),
        ]
    found += [
        (["demo", "OpenDrawer", "--episodes", "99999999999999999999999"], "--episodes"),
        (["demo", "OpenDrawer", "--workers", NINES], "--workers"),
        (["demo", "OpenDrawer", "--time-limit", "inf"], "--time-limit"),
        (["demo", "OpenDrawer", "--time-limit", "nan"], "nan is not a number"),
        (["robot", "run", "CloseBox", "--plan", "--calibration-days", "nan"], "nan is not a number"),
        (["robot", "run", "CloseBox", "--plan", "--deadline", "nan"], "nan is not a number"),
        (["demo", "OpenDrawer", "--jobs-per-worker", NINES], "--jobs-per-worker"),
        (["run-pipeline", "--num-tasks", NINES], "--num-tasks"),
        (["run-pipeline", "--single", "0"], "single, long: no task is requested (set single or long to at least 1"),
        (["run-pipeline", "--episodes", "-1"], "--episodes"),
        (["run-pipeline", "--target-task", "Nope"], "unknown task"),
        (["run-pipeline", "--target-task", ""], "unknown task"),
        (["run-pipeline", "--stored-task", "Nope"], "unknown task 'Nope'"),
        (["run-pipeline", "--physics", "newton"], "--physics"),
        (["run-pipeline", "--target-object", "drawr", "--assets", "builtin"], "did you mean drawer"),
        (
            ["run-pipeline", "--target-task", "OpenDrawer", "--target-object", "drawer"],
            "--target-object: cannot be combined",
        ),
        (["run-pipeline", "--library", str(archive)], "is an archive, which is read-only"),
        (["tasks", "add", str(folder), "--episodes", "30"], "--episodes: does not apply to a run folder"),
        (["demo", "OpenDrawer", "--physics", str(mixture)], "base: no physics ['original']"),
        (["run-pipeline", "--randomization", "narrow"], "--randomization"),
        (
            ["run-pipeline", "--instances", "-1"],
            "instances: no class in the library builtin has instances that match '-1'",
        ),
        (["run-pipeline", "--target-task", "OpenDrawer", "--instances", "-1"], "no instance '-1'"),
        (
            ["benchmark", "OpenDrawer", "--instances", "-1"],
            "no task can be run on these objects; for example, OpenDrawer: no instance",
        ),
        (["benchmark", "OpenDrawer", "--attempts", NINES], "--attempts"),
        (["benchmark", "Nope"], "unknown task 'Nope'"),
        (["run-pipeline", "--robot", "r2d2"], "robot: no robot 'r2d2'"),
        (["run-pipeline", "--designer", "Nope"], "$OPENAI_API_KEY: is not set"),
        (["run-pipeline", "--assets", str(folder / "nowhere")], "no such folder"),
        (["bench", "solver", "--problems", str(folder)], "is a folder, not a file"),
        (["bench", "solver", "--problems", str(file), "--sample-dt", "nan"], "--sample-dt: must be at least"),
        (["bench", "solver", "--problems", str(file), "--sample-dt", "1e-9"], "--sample-dt: must be at least"),
        (["bench", "solver", "--problems", str(file), "--threads", "1000000"], "--threads"),
        (["assets", "list", "--assets", long], "no such folder"),
        (["assets", "show", "drawr"], "did you mean drawer"),
        (["assets", "show", "drawer/"], "no instance"),
        (["assets", "validate", "drawer/x"], "no instance 'x'"),
        (["assets", "validate", "--random", NINES], "--random"),
        (["assets", "prepare", "nope"], "no class 'nope'"),
        (["assets", "export", "nope", "--out", str(folder / "out")], "no class 'nope'"),
        (["assets", "export", "--out", str(folder / "out")], "give a CLASS"),
        (["assets", "export", "drawer/1", "--out", str(file)], "--out"),
        (["assets", "import", long, "--class", "drawer", "--name", "1", "--out", str(folder)], "no such folder"),
        (["assets", "render", "drawer/1", "--out", str(file / "x.png")], "cannot write: Not a directory"),
        (["assets", "render", "nope", "--out", str(folder / "x.png")], "no class 'nope'"),
        (["assets", "gallery", "--classes", "nope", "--out", str(folder / "page")], "no class 'nope'"),
        (["assets", "export", "mug", "--out", str(folder / "x")], "mug is rigid: it has no joint"),
        (["assets", "show", "mug/1"], "no instance '1' of mug"),
        (["nonsense"], "No such command"),
    ]
    return found


def test_refusals_are_quick_and_import_nothing_heavy(tmp_path: Path) -> None:
    cases = _refusals(tmp_path)
    done = subprocess.run(
        [sys.executable, "-c", _SCRIPT],
        input=json.dumps([words for words, _ in cases]),
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
        cwd=tmp_path,
        env={**os.environ, "GENSIM2_ASSETS": "", "OPENAI_API_KEY": "", "OPENAI_BASE_URL": ""},
    )
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    for (words, expected), (code, seconds, said, out) in zip(cases, result["answers"], strict=True):
        shown = [word[:60] for word in words]
        assert code == cli.BAD_INPUT, (shown, said)
        assert expected in said, (shown, said)
        assert said.count("\n") == 1, (shown, said)
        assert len(said) < 1000, shown
        assert out == "", shown
        assert seconds < 2.0, shown
    assert not set(HEAVY) & set(result["modules"])


def test_help_and_version_need_click_alone() -> None:
    for words in (["--help"], ["--version"], ["demo", "--help"], ["assets", "export", "--help"], ["nonsense"]):
        script = f"import sys; from gensim2.cli.main import run; run({words}); print(*sys.modules, file=sys.stderr)"
        done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
        modules = set(done.stderr.split())
        assert not modules & {*HEAVY, "numpy", "pydantic", "rich", "yaml", "jinja2", "gymnasium"}


def _shell(command: str) -> subprocess.CompletedProcess[str]:
    script = command.replace("gensim2", f"{sys.executable} -m gensim2")
    return subprocess.run(["bash", "-c", script], capture_output=True, text=True, check=False, timeout=120)


@pytest.mark.parametrize(
    "words", ["--help", "--version", "tasks list", "tasks list --json", "assets list", "doctor --help", "demo --help"]
)
def test_standard_output_that_is_full_is_one_line(words: str) -> None:
    done = _shell(f"gensim2 {words} > /dev/full")
    assert done.returncode == cli.BAD_INPUT
    assert done.stderr == "gensim2: standard output: No space left on device\n"


@pytest.mark.parametrize("words", ["--version", "tasks list --json", "demo OpenDrawer"])
def test_standard_output_that_is_closed_is_one_line(words: str, tmp_path: Path) -> None:
    done = _shell(f"cd {tmp_path}; gensim2 {words} >&-")
    assert done.returncode == cli.BAD_INPUT
    assert done.stderr == "gensim2: standard output is closed (redirect it to a file or to /dev/null)\n"
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("text", ["9" * 5000, "[" * 100_000])
def test_controller_arguments_that_python_cannot_read_are_one_line(
    text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["evaluate", "CloseBox", "--assets", "builtin", "--controller", "mine.py:Mine", "--controller-args", text]
    assert cli.run(words) == cli.BAD_INPUT
    (said,) = capsys.readouterr().err.splitlines()
    assert "--controller-args: is not valid JSON" in said


def test_nobody_to_tell_leaves_the_exit_code() -> None:
    assert _shell("gensim2 tasks list >&- 2>&-").returncode == cli.BAD_INPUT
    assert _shell("gensim2 demo Nope 2>&-").returncode == cli.BAD_INPUT
    assert _shell("gensim2 demo Nope 2> /dev/full").returncode == cli.BAD_INPUT


def test_a_folder_that_may_not_be_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """Root may read every file, so the test raises the error itself."""

    def refused(path: Path) -> object:
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr(Path, "iterdir", refused)
    assert cli.run(["assets", "list", "--assets", str(tmp_path)]) == cli.BAD_INPUT
    out, err = capfd.readouterr()
    assert out == ""
    assert err.startswith(f"gensim2: {tmp_path}: ")
    assert "Permission denied" in err
    assert err.count("\n") == 1


def test_what_the_file_system_refuses_anywhere_is_one_line(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    import gensim2.tasks.library

    def refused(origin: str | None = None) -> object:
        raise PermissionError(13, "Permission denied", "/some/where")

    monkeypatch.setattr(gensim2.tasks.library, "task_names", refused)
    assert cli.run(["tasks", "list"]) == cli.BAD_INPUT
    assert capfd.readouterr().err == "gensim2: /some/where: Permission denied\n"


def test_names_that_are_no_text_are_shown(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable.encode(), b"-m", b"gensim2", b"demo", b"\xff\x1b[31m"],
        capture_output=True,
        check=False,
        cwd=tmp_path,
    )
    assert done.returncode == cli.BAD_INPUT
    assert b"\x1b" not in done.stderr
    assert done.stderr.count(b"\n") == 1
