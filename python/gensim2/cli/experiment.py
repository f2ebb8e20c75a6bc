"""``gensim2 experiment``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from gensim2.cli import options
from gensim2.cli.output import line, report, table


@click.group("experiment", short_help="Teach and measure several policies, and draw the figure.")
def experiment() -> None:
    """Experiments of several trainings, each one command that --resume goes on with, and one page."""


def _command(name: str, short: str) -> click.Command:
    @click.command(name, cls=options.Command, short_help=short, help=short)
    @click.option("--small", is_flag=True, help="The same at the size of a check: some minutes on two cores.")
    @click.option(
        "--config",
        type=click.Path(path_type=Path),
        default=None,
        metavar="FILE",
        help="Arms as YAML, in place of the package's own.",
    )
    @options.seed
    @options.assets
    @options.out("Folder to write to.  [default: runs/<date>-<time>]")
    @options.workers
    @options.device
    @options.resume
    @options.json_file
    def run(small: bool, config: Path | None, out: Path | None, json_file: str | None, **given: Any) -> None:
        if small and config is not None:
            raise click.UsageError("Give either --small or --config.")
        with report(json_file, _show) as (progress, give):
            from gensim2.data.runfolder import default_run_dir
            from gensim2.policy.experiments import config_of, read_experiment, run_experiment

            chosen = config_of(name, small=small) if config is None else read_experiment(config)  # type: ignore[arg-type]
            give(run_experiment(chosen, out=out or default_run_dir(), progress=progress, **given).to_dict())

    return run


experiment.add_command(
    _command(
        "generalization",
        "One policy for 5 tasks and one for 15, on objects that it was taught on and on others; arms of real objects "
        "take a folder of them, --assets.",
    )
)
experiment.add_command(
    _command(
        "breadth",
        "One policy for the 24 single-step tasks and one for all 39, on unseen objects, on real ones, told the "
        "opposite, and told the same in other words; real objects take a folder of them, --assets.",
    )
)
experiment.add_command(
    _command("scaling", "Success on unseen objects by the number of objects that a policy was taught on.")
)
experiment.add_command(
    _command("combinations", "One policy on things in containers that it was not taught together, by their sentences.")
)
experiment.add_command(
    _command(
        "designed", "One policy for the designed tasks of one step that come with the package, and one for all of them."
    )
)


def _show(result: dict[str, Any]) -> None:
    from gensim2.policy.experiments.page import WORDS

    kinds = [kind for kind in WORDS if any(row[f"{kind}_mean"] is not None for row in result["tasks"])]
    rows = [
        (row["arm"], row["name"], *(_rate(row, kind) for kind in kinds), row["episodes"]) for row in result["tasks"]
    ]
    table(("arm", "task", *(WORDS[kind] for kind in kinds), "episodes"), rows)
    for arm in result["arms"]:
        rates = ", ".join(f"{WORDS[kind]} {_rate(arm, kind)}" for kind in kinds if arm[f"{kind}_mean"] is not None)
        line(f"{arm['name']}: {rates}; {arm['cpu_s']:.0f} s of CPU")
    for name, reason in result["skipped"].items():
        line(f"not run: {name}: {reason}")
    line(f"page: {Path(result['out']) / 'report.html'}")


def _rate(row: dict[str, Any], kind: str) -> str:
    mean, interval = row[f"{kind}_mean"], row[f"{kind}_interval"]
    return "" if mean is None else f"{mean:.2f} ({interval[0]:.2f} to {interval[1]:.2f})"
