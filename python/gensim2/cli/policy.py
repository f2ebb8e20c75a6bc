"""``gensim2 policy``."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import click

from gensim2.cli import options
from gensim2.cli.output import line, report, table


@click.group("policy")
def policy() -> None:
    """Look at policies, and write them for other programs."""


@policy.command("show", cls=options.Command, short_help="Say what a checkpoint is.")
@click.argument("folder", metavar="DIR", type=click.Path(path_type=Path))
@options.json_file
def show(folder: Path, json_file: str | None) -> None:
    """Say what the checkpoint DIR is: its network, what it was trained on, and what it looks at."""
    with report(json_file, _show) as (_, give):
        from gensim2.policy.checkpoint import PolicyCheckpoint

        found = PolicyCheckpoint.load(folder)
        give(
            {
                "schema_version": 1,
                "robot": found.robot,
                "policy": found.config.to_dict(),
                "training": found.training.to_dict(),
                "step": found.step,
                "parameters": sum(parameter.numel() for parameter in found.network.parameters()),
                "sentences": list(found.sentences),
                "observation": found.observation.to_dict(),
                "action": found.action.model_dump(),
                "data": found.data.model_dump(mode="json"),
                "versions": found.versions,
            }
        )


def _show(result: dict[str, Any]) -> None:
    data, network = result["data"], result["policy"]
    table(
        ("what", "value"),
        [
            ("network", f"{network['encoder']}, {network['text']}, {network['head']}: {result['parameters']} weights"),
            ("robot", result["robot"]),
            ("points", str(result["observation"]["cloud"]["points"])),
            ("tasks", ", ".join(data["tasks"])),
            ("data", f"{data['frames']} frames of {data['episodes']} episodes, {data['digest'][:16]}"),
            ("steps", str(result["step"])),
        ],
    )


@policy.command("export", cls=options.Command, short_help="Write a policy's network as ONNX or a PyTorch graph.")
@click.argument("folder", metavar="DIR", type=click.Path(path_type=Path))
@click.option("--to", type=click.Choice(("onnx", "torch")), default="onnx", show_default=True, help="Format.")
@click.option("--out", type=click.Path(path_type=Path), required=True, metavar="FILE", help="File to write.")
@options.json_file
def export(folder: Path, to: Literal["onnx", "torch"], out: Path, json_file: str | None) -> None:
    """Write the network of the checkpoint DIR, one decision at a time, and check that it is the same function.

    FILE.json beside it holds names and shapes of the inputs, the sentences and the observation spec.
    """
    with report(json_file, _show_export) as (_, give):
        from gensim2.policy.export import export_policy

        give(export_policy(folder, out, to))


def _show_export(result: dict[str, Any]) -> None:
    line(f"{result['file']}: differs from the policy by {result['difference']:.1e} at most")
