"""Command ``gensim2 view``."""

from __future__ import annotations

from typing import Annotated, Any

import click

from gensim2.cli.options import EPISODES, PLANNER, command
from gensim2.cli.typed import Name, Option

Port = Annotated[int, click.IntRange(1, 65535)]


@command("library", *EPISODES, *PLANNER)
def view(
    what: Annotated[str, Option(metavar="TASK|EPISODE|DATA")],
    *,
    task: Name | None = None,
    episode: Annotated[int | None, click.IntRange(0), Option(metavar="N")] = None,
    port: Port = 8080,
    **given: Any,
) -> None:
    """Show an episode in the browser.

    The argument is a TASK, which is planned and run, an EPISODE file, or the folder DATA of a data set. The page shows
    the meshes of the scene, the keyframes of the plan (only for a TASK on the true scene), the point cloud that a
    policy would see, and a time slider. The server runs until Ctrl-C. Needs the extra `viz`.

    Args:
        task: Task of a data set.  [default: the first task]
        episode: Number of an episode in a data set.  [default: the first successful episode]
        port: Port of the page.
    """
    from gensim2.planning.show import wait
    from gensim2.viewing import view as function

    server = function(what, task=task, episode=episode, port=port, **given)
    click.echo(
        f"http://{server.get_host()}:{server.get_port()} shows the episode; press Ctrl-C to stop the server", err=True
    )
    wait(server)
