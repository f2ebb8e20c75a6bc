"""Command ``gensim2 solve``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import click

from gensim2.cli.options import EPISODES, Ending, command
from gensim2.cli.output import line, table
from gensim2.cli.typed import Folder, Option

if TYPE_CHECKING:
    from gensim2.planning.scene import Scene
    from gensim2.robots import RobotProfile
    from gensim2_kpam import Plan


def _browse(scene: Scene, plan: Plan, profile: RobotProfile) -> None:
    from gensim2.planning.show import show, wait

    server = show(scene, plan, profile)
    click.echo(
        f"http://{server.get_host()}:{server.get_port()} shows the plan; press Ctrl-C to stop the server", err=True
    )
    wait(server)


def _show(result: dict[str, Any]) -> None:
    things = ", ".join(f"{thing['class']}/{thing['instance']}" for thing in result["objects"].values())
    for step in result["steps"]:
        what = result["task"] if len(result["steps"]) == 1 else f"{result['task']}, {step['name']} ({step['strategy']})"
        line(f"{what} on {things}: {step['status']}")
        if step["reason"]:
            line(step["reason"])
        if step["plan"] is not None:
            _show_plan(step["plan"])
    if result["picture"] is not None:
        line(f"picture: {result['picture']}")


def _show_plan(plan: dict[str, Any]) -> None:
    table(
        ("constraint", "residual", "tolerance", "satisfied"),
        [
            (
                entry["name"],
                f"{entry['residual']:.2e}",
                f"{entry['tolerance']:.1e}",
                "yes" if entry["satisfied"] else "NO",
            )
            for entry in plan["residuals"]
        ],
    )
    table(
        ("keyframe", "time [s]", "reached"),
        [
            (
                entry["label"],
                "-" if entry["time"] is None else f"{entry['time']:.2f}",
                "yes" if entry["reached"] else "NO",
            )
            for entry in plan["keyframes"]
        ],
    )


@command("library", *EPISODES, show=_show)
def solve(
    task: str, *, out: Folder | None = None, browser: Annotated[bool, Option("--show")] = False, **given: Any
) -> dict[str, Any] | Ending:
    """Plan the motions of a task without executing them.

    The command plans the steps of TASK in one random scene, in the same way as an episode does. The plan of a step
    starts from the predicted result of the previous steps.

    If the command finds no complete motion for a step, the plan contains the longest possible part of the motion, which
    an episode would execute. The plan then has the status partial, and the command prints why the motion is incomplete.
    A picture of the step shows the scene, the keypoints, the targets, the keyframes and the remaining errors of the
    constraints. The exit code is 1 if a step has no motion at all.

    Args:
        out: Folder to write the plan and its picture to.  [default: none; the picture of a step without a complete
            motion goes to the cache]
        browser: Show the plan in the browser until Ctrl-C (extra viz).
    """
    from gensim2.rollout import solve as function

    result = function(task, out=out, view=_browse if browser else None, **given)
    return result.to_dict() if result.is_whole else Ending(result.to_dict())
