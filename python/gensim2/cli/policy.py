"""``gensim2 policy``."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Literal

import click

from gensim2.cli import options
from gensim2.cli.output import line, report, table
from gensim2.core.errors import InputError


@click.group("policy")
def policy() -> None:
    """Look at policies, and write them for other programs."""


@policy.command("show", cls=options.Command, short_help="Say what a checkpoint is.")
@options.checkpoint
@options.json_file
def show(folder: str, json_file: str | None) -> None:
    """Say what the checkpoint DIR is, or the package's own: its network, what it was trained on, what it looks at."""
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
            ("data", f"{_amount(data, result['action']['kind'])}, {data['digest'][:16]}"),
            ("steps", str(result["step"])),
        ],
    )


def _amount(data: dict[str, Any], kind: str) -> str:
    """Describe the size of the training data; keypose policies learn from planned steps, not from episodes."""
    if kind == "keypose":
        return f"{data['frames']} examples, {data['episodes']} planned steps among them"
    return f"{data['frames']} frames of {data['episodes']} episodes"


@policy.command("export", cls=options.Command, short_help="Write a policy's network as ONNX or a PyTorch graph.")
@options.checkpoint
@click.option("--to", type=click.Choice(("onnx", "torch")), default="onnx", show_default=True, help="Format.")
@click.option("--out", type=click.Path(path_type=Path), required=True, metavar="FILE", help="File to write.")
@options.json_file
def export(folder: str, to: Literal["onnx", "torch"], out: Path, json_file: str | None) -> None:
    """Write the network of the checkpoint DIR, one decision at a time, and check that it is the same function.

    FILE.json beside it holds names and shapes of the inputs, the sentences and the observation spec; of keypose
    policies also the order of the points and the meaning of the classes.
    """
    with report(json_file, _show_export) as (_, give):
        from gensim2.policy.export import export_policy

        give(export_policy(folder, out, to))


def _show_export(result: dict[str, Any]) -> None:
    line(f"{result['file']}: differs from the policy by {result['difference']:.1e} at most")


@policy.command("serve", cls=options.Command, short_help="Serve a policy, or any controller, to a robot elsewhere.")
@click.argument("controller", metavar="DIR|builtin|module:Class")
@click.option("--host", default="127.0.0.1", show_default=True, help="Address that is listened at.")
@click.option("--port", type=click.IntRange(0, 65535), default=8321, show_default=True, help="0: any that is free.")
@click.option(
    "--argument", "arguments", multiple=True, metavar="NAME=JSON", help="Argument of module:Class; may be given again."
)
@options.robot
def serve(controller: str, host: str, port: int, arguments: tuple[str, ...], **given: Any) -> None:
    """Serve the checkpoint DIR, or a class of yours, by websocket: gensim2 robot run --policy ws://HOST:PORT.

    Whoever asks must know the token in GENSIM2_POLICY_TOKEN; where it is not set one is made and said. Nothing is
    encrypted: beyond this machine go through a tunnel (ssh -L), or a proxy that speaks wss.
    """
    import os
    import secrets

    from gensim2.policy.remote.protocol import TOKEN
    from gensim2.policy.remote.server import PolicyServer
    from gensim2.rollout.controller_spec import ControllerSpec

    if ":" in controller:
        spec = ControllerSpec.of(controller, dict(map(_argument, arguments)))
    else:
        from gensim2.policy.evaluating import policy_controller

        spec = policy_controller(controller)
    given_token = os.environ.get(TOKEN)
    token = given_token or secrets.token_urlsafe(24)
    server = PolicyServer(spec, given["robot"], token, host=host, port=port, said=line)
    if not given_token:
        line(f"export {TOKEN}={token}")
    line(f"{spec.target} at {server.url}")
    try:
        server.serve()
    finally:
        server.close()


def _argument(text: str) -> tuple[str, Any]:
    name, _, value = text.partition("=")
    try:
        return name, json.loads(value)
    except ValueError as error:
        raise InputError(f"{text!r} is no argument", field="--argument", remedy="as checkpoint='\"runs/a\"'") from error
