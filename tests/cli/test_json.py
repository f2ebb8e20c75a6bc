"""``--json [FILE]``: which argument is the file, and how an existing file of that name is treated."""

from __future__ import annotations

import json
import os
import socket
import stat
import subprocess
import sys
import threading
from pathlib import Path

import click
import pytest

from gensim2.cli import main as cli
from gensim2.core.files import write_output
from gensim2.core.special_files import descriptor

LIST = ["tasks", "list", "--json"]


def _json_commands() -> list[tuple[str, click.Command]]:
    """Return every command with ``--json``, by its full name."""
    context = click.Context(cli.cli)
    found: list[tuple[str, click.Command]] = []

    def walk(name: str, command: click.Command) -> None:
        if isinstance(command, click.Group):
            for each in command.list_commands(context):
                inner = command.get_command(context, each)
                assert inner is not None
                walk(f"{name} {each}".strip(), inner)
        elif any("--json" in param.opts for param in command.params):
            found.append((name, command))

    walk("", cli.cli)
    return found


def _needed(command: click.Command) -> list[str]:
    """Return the arguments that a command requires."""
    words = []
    for param in command.params:
        if param.required and isinstance(param, click.Argument):
            words.append(_word(param))
        elif param.required:
            words += [param.opts[0], _word(param)]
    return words


def _word(param: click.Parameter) -> str:
    """Return a value that the parameter accepts."""
    kind = param.type
    if isinstance(kind, click.Choice):
        return str(kind.choices[0])
    if isinstance(kind, click.Path) and kind.exists:
        return "."
    return "1" if isinstance(kind, click.IntRange) else "WORD"


@pytest.mark.parametrize(("name", "command"), _json_commands(), ids=[name for name, _ in _json_commands()])
def test_the_rule_is_the_same_in_every_command(name: str, command: click.Command) -> None:
    def json_file(words: list[str]) -> object:
        return command.make_context(name, list(words)).params["json_file"]

    needed = _needed(command)
    assert json_file(needed) is None
    assert json_file([*needed, "--json"]) == "-"
    assert json_file([*needed, "--json", "-"]) == "-"
    for word in ("result", "result.json", "some/result", "drawer"):
        assert json_file([*needed, "--json", word]) == word
        assert json_file(["--json", word, *needed]) == word
        assert json_file([*needed, f"--json={word}"]) == word


def test_the_word_behind_it_is_the_file() -> None:
    show = next(command for name, command in _json_commands() if name == "assets show")
    for words, wanted in [
        (["--json", "box.json", "drawer"], ("drawer", "box.json")),
        (["--json", "--seed", "3", "drawer"], ("drawer", "-")),
        (["--json", "-", "drawer"], ("drawer", "-")),
    ]:
        params = show.make_context("show", list(words)).params
        assert (params["object_"], params["json_file"]) == wanted
    with pytest.raises(click.MissingParameter, match="object_"):
        show.make_context("show", ["--json", "drawer"])


def test_a_file_of_any_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("result", "r" * 200, "ü\n.json"):
        assert cli.run([*LIST, name]) == 0
        assert json.loads(Path(name).read_text())["schema_version"] == 1
    assert {path.name for path in tmp_path.iterdir()} == {"result", "r" * 200, "ü\n.json"}


def test_a_device_stays_a_device(capfd: pytest.CaptureFixture[str]) -> None:
    for device, code in (("/dev/null", 0), ("/dev/full", 2)):
        before = Path(device).stat().st_rdev
        assert cli.run([*LIST, device]) == code
        after = Path(device).stat()
        assert stat.S_ISCHR(after.st_mode)
        assert after.st_rdev == before
    wrong = "/dev/full: --json: cannot write: No space left on device"
    assert capfd.readouterr().err == f"gensim2: {wrong} (choose another file with --json)\n"


def test_no_writer_replaces_a_device() -> None:
    """Images and plans are written by the same function as JSON documents."""
    write_output(Path("/dev/null"), b"a picture")
    assert stat.S_ISCHR(Path("/dev/null").stat().st_mode)


def test_a_link_stays_and_its_target_is_replaced(tmp_path: Path) -> None:
    target, link, chain = tmp_path / "sub" / "target.json", tmp_path / "link", tmp_path / "chain"
    target.parent.mkdir()
    link.symlink_to("sub/target.json")
    chain.symlink_to(link)
    for _ in range(2):  # the first time the link is dangling
        assert cli.run([*LIST, str(chain)]) == 0
        assert link.is_symlink()
        assert chain.is_symlink()
        assert json.loads(target.read_text())["schema_version"] == 1
    assert {path.name for path in target.parent.iterdir()} == {"target.json"}


def test_links_in_a_circle_are_named(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "a").symlink_to("b")
    (tmp_path / "b").symlink_to("a")
    assert cli.run([*LIST, str(tmp_path / "a")]) == 2
    assert "Too many levels of symbolic links" in capfd.readouterr().err


def test_a_pipe_is_written_through(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    read: list[str] = []
    reader = threading.Thread(target=lambda: read.append(pipe.read_text()))
    reader.start()
    assert cli.run([*LIST, str(pipe)]) == 0
    reader.join(timeout=10)
    assert json.loads(read[0])["schema_version"] == 1
    assert stat.S_ISFIFO(pipe.stat().st_mode)


def test_a_socket_is_refused(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "socket"
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(str(path))
        listener.listen()
        assert cli.run([*LIST, str(path)]) == 2
    assert str(path) in capfd.readouterr().err
    assert path.is_socket()


def test_the_names_of_open_descriptors(tmp_path: Path) -> None:
    with (tmp_path / "file").open("w") as stream:
        number = stream.fileno()
        (tmp_path / "link").symlink_to(f"/dev/fd/{number}")
        for name in (f"/dev/fd/{number}", f"/proc/self/fd/{number}", str(tmp_path / "link")):
            assert descriptor(Path(name)) == number
    assert descriptor(Path("/dev/stdout")) == 1
    assert descriptor(tmp_path / "file") is None
    assert descriptor(Path("/dev/null")) is None


@pytest.mark.parametrize("redirection", ["> {file}", "| cat > {file}", "3> {file} > /dev/null"])
def test_standard_output_by_its_name(tmp_path: Path, redirection: str) -> None:
    file = tmp_path / "out"
    name = "/dev/fd/3" if redirection.startswith("3") else "/dev/stdout"
    command = f"{sys.executable} -m gensim2 tasks list --json {name} {redirection.format(file=file)}"
    subprocess.run(["bash", "-c", command], check=True)
    assert json.loads(file.read_text())["schema_version"] == 1


def test_a_result_is_shown_although_its_file_cannot_be_written(capfd: pytest.CaptureFixture[str]) -> None:
    assert cli.run([*LIST, "/dev/full"]) == 2
    assert "OpenDrawer" in capfd.readouterr().out


def test_problems_go_through_the_same_writer(tmp_path: Path) -> None:
    """``bench solver`` writes one line per problem with the same function."""
    problems = tmp_path / "problems.jsonl"
    problems.write_text("")
    for target in ("/proc/nowhere/x", str(tmp_path)):
        assert cli.run(["bench", "solver", "--problems", str(problems), "--json", target]) == 2
