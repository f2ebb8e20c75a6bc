"""``gensim2 view``."""

from __future__ import annotations

from typing import Any

import click

from gensim2.cli import options


@click.command("view", cls=options.Command, short_help="Watch an episode in the browser.")
@click.argument("what", metavar="TASK|EPISODE|DATA")
@click.option("--task", metavar="NAME", default=None, help="Task of a data set.  [default: its first]")
@click.option(
    "--episode",
    type=click.IntRange(0),
    metavar="N",
    default=None,
    help="Episode of a data set.  [default: the first that held]",
)
@click.option("--port", type=click.IntRange(1, 65535), default=8080, show_default=True, help="Port of the page.")
@options.library
@options.scenes
def view(what: str, **given: Any) -> None:
    """Show an episode in the browser until Ctrl-C: a TASK, which is planned and run, the file of an EPISODE, or one of
    the data set in the folder DATA.

    The page holds the scene's meshes, the keyframes of the plan (of a TASK), the point cloud as a policy sees it, and a
    slider over time. Needs the extra `viz`.
    """
    from gensim2.planning.show import wait
    from gensim2.viewing import view as function

    server = function(what, **given)
    click.echo(f"http://{server.get_host()}:{server.get_port()} shows the episode; Ctrl-C ends it", err=True)
    wait(server)
