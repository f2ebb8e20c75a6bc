"""Decorator for commands, and options shared by several commands."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

import click
from click.core import ParameterSource

from gensim2.cli.output import Show, document, report
from gensim2.cli.typed import Folder, Option, Real, count, options_of_class, parameters, summary
from gensim2.core.cores import usable_cores
from gensim2.core.errors import InputError, Stopped
from gensim2.core.seeding import LARGEST_SEED

#: Exit codes: 1 if a check failed, 2 for invalid input, 3 if some jobs could not be run.
FOUND_WRONG, BAD_INPUT, NOT_RUN = 1, 2, 3


class _Physics(click.ParamType[str]):
    """Parameter type: a physics preset, a mixture of presets, or a file of settings."""

    name = "physics"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Check the value, and return the normalized name of the physics settings."""
        from gensim2.scenes.physics import physics_name

        try:
            return physics_name(value)
        except InputError as error:
            self.fail(str(error), param, ctx)


class _Robot(click.ParamType[str]):
    """Parameter type: a robot's name, or the user's own Python file or module, which is loaded."""

    name = "robot"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Load the robot, and return the name under which it is registered."""
        from gensim2.robots import load_robot

        return load_robot(value)


Robot = Annotated[str, _Robot(), Option(metavar="NAME|FILE.py")]
#: The type is str instead of Path, because ``builtin`` is the packaged policy and ``./builtin`` is a folder.
Checkpoint = Annotated[str, Option(metavar="DIR|builtin")]


class Shared:
    """Options that several commands share, each with one meaning.

    Attributes:
        assets: Folder of objects, 'builtin' for generated objects, or 'ycb' for ManiSkill's download. If a folder lacks
            a rigid object, the command uses the generated object of the same class.  [default: $GENSIM2_ASSETS, else
            builtin]
        control_episodes: Number of episodes of each task and baseline.
        controls: Baselines to measure in addition to the policy: blind sees no point cloud, shuffled sees point clouds
            of other scenes, no-op does not move, and expert is the planner.
        depth_noise: Noise of the depth cameras with --scene DIR. deployed is the noise d435 plus random calibration and
            clock errors in each episode. FILE is a file written by gensim2 robot fit-noise.
        device: PyTorch device for training, such as cpu or cuda. If several devices are given, each batch is split
            between them. auto is the first GPU, or the CPU if there is no GPU.
        engine: Physics engine. sapien (extra gensim2[sim]) uses PhysX with ManiSkill's environments. mujoco (extra
            gensim2[mujoco]) needs neither ManiSkill nor PyTorch, and supports --physics default only.  [default: sapien
            if it is installed, else mujoco]
        engines: both also runs each verification and each demonstration in the other physics engine, in the same
            scenes. A task is kept only if enough episodes succeed in both engines, and a demonstration only if it
            succeeds in both.
        instances: Objects to use. train is 90 % of the listed objects, and test is the remaining 10 %. train-K and
            test-K, with K from 1 to 9, are nine other divisions of the listed objects into 90 % and 10 %. new stands
            for generated objects that are not listed. random is one random listed object.
        jobs_per_worker: Number of jobs after which a simulator process is replaced.
        library: Folder of your own tasks, used in addition to the tasks of the package.  [default: $GENSIM2_LIBRARY,
            else a folder in your user data]
        moved_assets: Current folder of the data set's objects, if they were moved without changes after recording; not
            needed for built-in objects.  [default: the folder that was used for recording]
        noise: Noise of the depth cameras. deployed is the noise d435 plus random calibration and clock errors in each
            episode. FILE is a file written by gensim2 robot fit-noise.
        open_loop: Plan all steps at the start of an episode and do not react to deviations. Each step uses its first
            strategy that gives a complete plan.
        origin: Use all library tasks proposed by NAME, which is paper or a designer.  [default: paper]
        out: Output folder.  [default: runs/<date>-<time>]
        physics: Physics settings: joint friction, densities, materials, solver, default poses, finger drives and
            redraws. The preset default has gensim2's own settings, and the preset original has the settings of the
            GenSim2 release. To change one setting of a preset, add + and the setting: original+gripper=default takes
            only the setting gripper from default. A YAML or JSON file of settings is also accepted.
        randomization: Random ranges of scenes. paper uses the ranges of the task, and paper-half uses ranges half as
            wide. wide uses wider ranges, and also varies the friction and mass of the objects and the start pose of the
            robot.
        ray: Run on Ray (extra gensim2[ray]), on this machine or on a cluster. All nodes of a cluster must have --out at
            the same path. With this option, --workers is the maximum number of simultaneous environments.  [default of
            --workers: one for each CPU]
        redraw: With placement, the placements are sampled again if objects overlap. With none, the first placements are
            used.  [default: placement; with --physics original: none]
        resume: Continue the run in --out.
        robot: Name of the robot (panda, fr3 or fetch), or a Python file that registers your own robot.
        scene_source: Source of the scene that the planner gets. true is the state of the simulator. perceived is the
            estimator of the package, and DIR is an estimator made by gensim2 perceive train. With an estimator, the
            planner gets estimates from point clouds, and uses them to decide when a task is done. benchmark skips tasks
            that have an object class unknown to the estimator, and demo and do refuse such tasks.
        seed: Random seed.
        time_limit: Time after which an episode counts as hung. The episode is then repeated in a new process.
        videos: Number of episodes of each task to record as video. The videos show demonstrations, or failed episodes
            if the task is not kept.
        workers: Number of simulator processes; does not affect the result.
    """

    seed: Annotated[int, click.IntRange(0, LARGEST_SEED)] = 0
    assets: Annotated[str | None, Option(metavar="DIR|builtin|ycb")] = None
    moved_assets: Annotated[str | None, Option("--assets", "DIR|ycb")] = None
    instances: Annotated[str, Option("--instances --instance", "all|train[-K]|test[-K]|new|random|ID")] = "all"
    engine: Literal["sapien", "mujoco"] | None = None
    engines: Literal["one", "both"] = "one"
    physics: Annotated[str, _Physics(), Option(metavar="default|original|MIXTURE|FILE")] = "default"
    redraw: Literal["none", "placement"] | None = None
    randomization: Literal["paper", "paper-half", "wide"] = "paper"
    robot: Robot = "panda"
    open_loop: bool = False
    library: Annotated[str | None, Option(metavar="DIR|FILE.zip|none")] = None
    origin: Annotated[str | None, Option(metavar="NAME")] = None
    out: Folder | None = None
    workers: Annotated[int, count(1024), Option(shown="number of cores")] = usable_cores()
    time_limit: Annotated[float, Real(0, 1e6, min_open=True), Option(metavar="SECONDS")] = 900.0
    jobs_per_worker: Annotated[int, count()] = 500
    ray: Annotated[str | None, Option(metavar="local|ADDRESS")] = None
    resume: bool = False
    videos: Annotated[int, click.IntRange(0, 1000)] = 1
    device: Annotated[str, Option(metavar="auto|NAME[,NAME...]")] = "auto"
    controls: Annotated[str, Option(metavar="all|none|NAME,...")] = "all"
    control_episodes: Annotated[int, count()] = 30
    noise: Annotated[str | None, Option(metavar="d435|deployed|white|FILE")] = None
    depth_noise: Annotated[str | None, Option("--noise", "d435|deployed|white|FILE")] = None
    scene_source: Annotated[str, Option("--scene", "true|perceived|DIR")] = "true"


_SHARED = options_of_class(Shared)

#: Options that determine scenes and episodes.
SCENE = ("assets", "instances", "engine", "physics", "redraw", "randomization", "robot")
EPISODES = ("seed", *SCENE, "open_loop")
#: Options for the input of the planner: the source of its scene, and the noise of the depth images for an estimated
#: scene.
PLANNER = ("scene_source", "depth_noise")
#: Options of simulator processes.
PROCESSES = ("workers", "time_limit", "jobs_per_worker")


@dataclass(frozen=True)
class Ending:
    """Result of a command whose exit code is not 0.

    Attributes:
        result: result of the command, which is shown and written as usual.
        error: exception that the command raises after it has shown and written the result; by default an exit with code
            1.
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
    """Create a command from a typed function whose docstring holds the help.

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
        shared: options that the command has in common with others: names of attributes of :class:`Shared`, or classes
            of options. The function receives their values as keyword arguments.
        name: name of the command. If it is None, the command has the function's name.
        show: function that prints the command's result (a dictionary or :class:`Ending`). A command with ``show`` also
            has the option ``--json``.
        text: function that formats the result for the file of ``--json``.
        beside: additional options of the command, as click objects.
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
            try:
                with report(given.pop("json_file"), show, text) as (progress, give):
                    found = function(**given, **({"progress": progress} if listening else {}))
                    give(found.result if isinstance(found, Ending) else found)
                if isinstance(found, Ending):
                    raise found.error
            except (KeyboardInterrupt, Stopped) as error:
                if "resume" in given:
                    named = given.get("out", "") is not None or "folder" in given
                    error.add_note("to continue, repeat the command with --resume" + ("" if named else " --out FOLDER"))
                raise

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
        help="Write the result as JSON to FILE. With - or without a value, the JSON goes to standard output, and all "
        "other output to standard error.",
    )


def is_given(context: click.Context, name: str) -> bool:
    """Return whether the user gave an option explicitly."""
    return context.get_parameter_source(name) is ParameterSource.COMMANDLINE


def _settle(context: click.Context, given: dict[str, Any]) -> None:
    """Set defaults that depend on other options, select ``--library``, and refuse ``--resume`` without ``--out``."""
    # `design` can resume without --out, because its run folder is below its argument `folder`.
    if given.get("resume") and given.get("out", "") is None and "folder" not in given:
        raise click.UsageError("--resume continues the run in the folder given with --out; add --out")
    if given.get("ray") is not None and not is_given(context, "workers"):
        given["workers"] = None  # None means one worker for each CPU of the cluster
    if "engine" in given and given["engine"] is None:
        from gensim2.scenes.physics import default_engine

        given["engine"] = default_engine()
        if given["engine"] != "sapien":
            click.echo("SAPIEN is not installed, so MuJoCo simulates the scenes (--engine mujoco)", err=True)
    if "moved_assets" in given:
        given["assets"] = given.pop("moved_assets")
    if (library := given.pop("library", None)) is not None:
        from gensim2.tasks.library import using_library

        # Only this process looks up tasks by name. Jobs contain complete definitions.
        context.with_resource(using_library(library))
