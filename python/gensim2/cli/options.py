"""The decorator of commands, and the options that several of them share."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

import click
from click.core import ParameterSource

from gensim2.cli.output import Show, document, report
from gensim2.cli.typed import Folder, Option, count, options_of_class, parameters, summary
from gensim2.core.cores import usable_cores
from gensim2.core.errors import InputError
from gensim2.core.seeding import LARGEST_SEED

#: Exit codes; 0 is "ran to the end", 128 + n "stopped by signal n".
FOUND_WRONG, BAD_INPUT, NOT_RUN = 1, 2, 3


class _Physics(click.ParamType[str]):
    """A preset, a mixture, or a file of switches."""

    name = "physics"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the word for the switches."""
        from gensim2.scenes.physics import physics_name

        try:
            return physics_name(value)
        except InputError as error:
            self.fail(str(error), param, ctx)


class _Robot(click.ParamType[str]):
    """A robot's name, or a Python file or module, which is loaded because the user names it; data never load one."""

    name = "robot"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the word for the robot."""
        from gensim2.robots import load_robot

        return load_robot(value)


Robot = Annotated[str, _Robot(), Option(metavar="NAME|FILE.py")]
#: Not a path: of ``builtin`` and ``./builtin`` only the latter is a folder.
Checkpoint = Annotated[str, Option(metavar="DIR|builtin")]


class Shared:
    """Options that several commands share, each with one meaning.

    Attributes:
        assets: Folder of objects, 'builtin' for the generated ones, or 'ycb' for ManiSkill's download; a rigid object
            that a folder lacks is the generated one.  [default: $GENSIM2_ASSETS, else builtin]
        control_episodes: Number of episodes of each task and control.
        controls: Baselines to measure beside the policy: blind, shuffled (clouds of other scenes), no-op, expert (the
            planner).
        device: Training device by PyTorch's name; several devices share each batch. auto is the first GPU, else the
            CPU.
        engine: Physics engine: sapien is PhysX with ManiSkill's environments; mujoco (extra gensim2[mujoco]) needs
            neither ManiSkill nor PyTorch, and simulates --physics default only.
        instances: Objects to draw from. train and test split the listed objects nine to one; train-K and test-K, with
            K from 1 to 9, use another tenth for testing; new objects are generated beyond the listed ones; random is
            one listed object, drawn by --seed.
        jobs_per_worker: Jobs after which a simulator process is replaced.
        library: Your own tasks beside those of the package.  [default: $GENSIM2_LIBRARY, else a folder among your data]
        moved_assets: Folder that now holds the data set's objects, which must be unchanged. Built-in objects do not
            need it.  [default: their folder when the data set was made]
        noise: Noise of the depth cameras. deployed is d435 with errors of calibration and clock, drawn for each
            episode; FILE is a file that gensim2 robot fit-noise wrote.
        open_loop: Plan all steps at the start of an episode, each by its first strategy with a complete plan, and do
            not react to deviations.
        origin: Use all tasks of the library that NAME, a designer, proposed.  [default: paper, the paper's suite]
        out: Folder to write to.  [default: runs/<date>-<time>]
        physics: Joint friction, densities, materials, solver, default poses, drives of the fingers and redraws: the
            project's own, or those of the original GenSim2; or a mixture such as original+gripper=default, or a YAML or
            JSON file of switches.
        randomization: Ranges of the scenes: the task's own, half of them, or wider ones that also vary the objects'
            friction and mass and the robot's start.
        ray: Run on Ray (extra gensim2[ray]): on this machine, or on a cluster whose nodes all have --out at the same
            path. --workers is then the largest number of environments at a time.  [default of --workers: one for each
            CPU]
        redraw: Whether to redraw the placements of several objects until all have room.  [default: as --physics has
            it: placement, or none for the original]
        resume: Resume the run in --out.
        robot: Robot: panda, fr3, fetch, or a Python file that registers your own robot.
        seed: Seed of every draw.
        time_limit: Time after which an episode counts as hung and is repeated in a new process.
        video: Record videos where this machine can render.
        workers: Number of simulator processes; the result does not depend on it.
    """

    seed: Annotated[int, click.IntRange(0, LARGEST_SEED)] = 0
    assets: Annotated[str | None, Option(metavar="DIR|builtin|ycb")] = None
    moved_assets: Annotated[str | None, Option("--assets", "DIR|ycb")] = None
    instances: Annotated[str, Option("--instances --instance", "all|train[-K]|test[-K]|new|random|ID")] = "all"
    engine: Literal["sapien", "mujoco"] = "sapien"
    physics: Annotated[str, _Physics(), Option(metavar="default|original|MIXTURE|FILE")] = "default"
    redraw: Literal["none", "placement"] | None = None
    randomization: Literal["paper", "paper-half", "wide"] = "paper"
    robot: Robot = "panda"
    open_loop: bool = False
    library: Annotated[str | None, Option(metavar="DIR|FILE.zip|none")] = None
    origin: Annotated[str | None, Option(metavar="NAME")] = None
    out: Folder | None = None
    workers: Annotated[int, count(1024), Option(shown="number of cores")] = usable_cores()
    time_limit: Annotated[float, click.FloatRange(0, 1e6, min_open=True), Option(metavar="SECONDS")] = 900.0
    jobs_per_worker: Annotated[int, count()] = 500
    ray: Annotated[str | None, Option(metavar="local|ADDRESS")] = None
    resume: bool = False
    video: bool = True
    device: Annotated[str, Option(metavar="auto|NAME[,NAME...]")] = "auto"
    controls: Annotated[str, Option(metavar="all|none|NAME,...")] = "all"
    control_episodes: Annotated[int, count()] = 30
    noise: Annotated[str | None, Option(metavar="d435|deployed|white|FILE")] = None


_SHARED = options_of_class(Shared)

#: Options that decide scenes and episodes.
SCENE = ("assets", "instances", "engine", "physics", "redraw", "randomization", "robot")
EPISODES = ("seed", *SCENE, "open_loop")
#: How simulator processes work.
PROCESSES = ("workers", "time_limit", "jobs_per_worker")


@dataclass(frozen=True)
class Ending:
    """Result of a command that does not end with exit code 0.

    Attributes:
        result: document, which is shown and written as usual.
        error: exception that then ends the command.
    """

    result: dict[str, Any]
    error: BaseException = field(default_factory=lambda: click.exceptions.Exit(FOUND_WRONG))


def command(
    *shared: str | type,
    name: str | None = None,
    show: Show | None = None,
    text: Callable[[dict[str, Any]], str] = document,
    beside: Sequence[click.Option] = (),
) -> Callable[[Callable[..., Any]], click.Command]:
    """Make a command of a typed function whose docstring holds the help.

    Example:
        ```python
        @command("seed", show=lambda result: line(result["name"]))
        def draw(task: str, *, episodes: Count = 5, progress: Progress, **given: Any) -> dict[str, Any]:
            \"\"\"Draw scenes of TASK.

            Args:
                episodes: Number of scenes.
            \"\"\"
        ```

    Args:
        shared: names of options of :class:`Shared`, and classes of options, which the function takes by keyword.
        name: name of the command; None: the function's.
        show: prints the function's result, a dictionary or :class:`Ending`. The command then has ``--json``.
        text: what goes into the file of ``--json``.
        beside: further options.
    """

    def decorate(function: Callable[..., Any]) -> click.Command:
        listening = "progress" in function.__annotations__
        groups = [{each: _SHARED[each]} if isinstance(each, str) else options_of_class(each) for each in shared]
        taken = {name: option for group in groups for name, option in group.items()}
        params = parameters(function, {**_SHARED, **taken})
        own = {each.name for each in params}
        params += [*(option for name, option in taken.items() if name not in own), *beside]
        if show is not None:
            params.append(_json())

        def callback(**given: Any) -> None:
            _settle(click.get_current_context(), given)
            if show is None:
                function(**given)
                return
            with report(given.pop("json_file"), show, text) as (progress, give):
                found = function(**given, **({"progress": progress} if listening else {}))
                give(found.result if isinstance(found, Ending) else found)
            if isinstance(found, Ending):
                raise found.error

        help_text = summary(function)
        return click.Command(
            name or function.__name__.strip("_").replace("_", "-"),
            params=params,
            callback=callback,
            help=help_text,
            short_help=help_text.partition("\n\n")[0].replace("\n", " "),
        )

    return decorate


def _json() -> click.Option:
    return click.Option(
        ["--json", "json_file"],
        is_flag=False,
        flag_value="-",
        metavar="[FILE|-]",
        help="Write the result as JSON to FILE; - or no value is standard output, and all else then goes to standard "
        "error.",
    )


def is_given(context: click.Context, name: str) -> bool:
    """Return whether the user gave an option, rather than its default."""
    return context.get_parameter_source(name) is ParameterSource.COMMANDLINE


def _settle(context: click.Context, given: dict[str, Any]) -> None:
    """Apply the options that change others, or the process.

    Raises:
        UsageError: ``--resume`` without ``--out``: a new folder would begin from nothing.
    """
    if given.get("resume") and given.get("out", "") is None:
        raise click.UsageError("--resume goes on with what --out holds: give --out, too")
    if given.get("ray") is not None and not is_given(context, "workers"):
        given["workers"] = None  # one for each CPU of the cluster
    if "moved_assets" in given:
        given["assets"] = given.pop("moved_assets")
    if (library := given.pop("library", None)) is not None:
        from gensim2.tasks.library import using_library

        context.with_resource(using_library(library))  # worker processes are given tasks as values
