"""Command ``gensim2 experiment``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from gensim2.cli.options import command
from gensim2.cli.output import line, table
from gensim2.cli.typed import File
from gensim2.core.progress import Progress

#: Description of each experiment.
EXPERIMENTS = {
    "generalization": "Train one policy for 5 tasks and one for 15, and test both on training objects and on "
    "unseen objects. Policies for real objects need the folder of real objects, --assets.",
    "breadth": "Train one policy for the 24 single-step tasks and one for all 39, and test on unseen objects, on real "
    "objects, with opposite instructions and with reworded ones. Real objects need their folder, --assets.",
    "scaling": "Measure success on unseen objects by the number of training objects.",
    "combinations": "Test one policy on pairs of an object and a container that did not occur together in training.",
    "designed": "Train one policy for each designed single-step task of the package, and one for all of them.",
}


@click.group("experiment", short_help="Train and measure several policies, and draw the figure.")
def experiment() -> None:
    """Train and compare several policies, and write a page with the results. --resume continues an experiment."""


def _add(name: str, help_text: str) -> None:
    def run(
        *, small: bool = False, config: File | None = None, out: Path | None, progress: Progress, **given: Any
    ) -> dict[str, Any]:
        """Run an experiment.

        Args:
            small: Run a small version of the experiment, which takes some minutes on two cores.
            config: YAML file with the policies to compare, instead of the package's policies.
        """
        if small and config is not None:
            raise click.UsageError("Give either --small or --config.")
        from gensim2.data.runfolder import default_run_dir
        from gensim2.policy.experiments import config_of, read_experiment, run_experiment

        chosen = config_of(name, small=small) if config is None else read_experiment(config)  # type: ignore[arg-type]
        return run_experiment(chosen, out=out or default_run_dir(), progress=progress, **given).to_dict()

    made = command("seed", "assets", "workers", "device", "resume", name=name, show=_show)(run)
    made.help = made.short_help = help_text
    experiment.add_command(made)


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
    line(f"report: {Path(result['out']) / 'report.html'}")


def _rate(row: dict[str, Any], kind: str) -> str:
    mean, interval = row[f"{kind}_mean"], row[f"{kind}_interval"]
    return "" if mean is None else f"{mean:.2f} ({interval[0]:.2f} to {interval[1]:.2f})"


for _name, _text in EXPERIMENTS.items():
    _add(_name, _text)
