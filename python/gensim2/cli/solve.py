"""``gensim2 solve``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from gensim2.cli import options
from gensim2.cli.main import FOUND_WRONG
from gensim2.cli.output import line, report, table

if TYPE_CHECKING:
    from gensim2.planning.scene import Scene
    from gensim2.robots import RobotProfile
    from gensim2_kpam import Plan


@click.command("solve", cls=options.Command, short_help="Plan the motions of a task.")
@click.argument("task")
@options.library
@options.scenes
@options.out("Folder to write the plan to.  [default: written nowhere]")
@click.option("--show", "browser", is_flag=True, help="Show the plan in the browser until Ctrl-C (extra viz).")
@options.json_file
@click.pass_context
def solve(ctx: click.Context, /, task: str, browser: bool, json_file: str | None, **given: Any) -> None:
    """Plan the motions of TASK in the scene of one seed as an episode would, without executing them.

    Each step is planned on the scene that the steps before it should leave. Where the whole motion cannot be had, its
    longest part is taken, as episodes do, and the plan is called partial. Ends with 1 where a step has none; the status
    and the reason say why.
    """
    with report(json_file, _show) as (_, give):
        from gensim2.rollout import solve as function

        result = function(task, view=_browse if browser else None, **given)
        give(result.to_dict())
    if not result.is_whole:
        ctx.exit(FOUND_WRONG)


def _browse(scene: Scene, plan: Plan, profile: RobotProfile) -> None:
    from gensim2.planning.show import show, wait

    server = show(scene, plan, profile)
    click.echo(f"http://{server.get_host()}:{server.get_port()} shows the plan; Ctrl-C ends it", err=True)
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
