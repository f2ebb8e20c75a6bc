"""Commands ``gensim2 policy``."""

from __future__ import annotations

import json
import os
import secrets
from typing import Annotated, Any, Literal

import click

from gensim2.cli.options import Checkpoint, command
from gensim2.cli.output import line, table
from gensim2.cli.typed import File, Option
from gensim2.core.errors import InputError
from gensim2.core.plural import plural


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
        return f"{plural(data['frames'], 'example')}, {plural(data['episodes'], 'planned step')} among them"
    return f"{plural(data['frames'], 'frame')} of {plural(data['episodes'], 'episode')}"


def _show_export(result: dict[str, Any]) -> None:
    line(f"{result['file']}: differs from the policy by {result['difference']:.1e} at most")


def _argument(text: str) -> tuple[str, Any]:
    name, _, value = text.partition("=")
    try:
        return name, json.loads(value)
    except (ValueError, RecursionError) as error:
        remedy = "write it as checkpoint='\"runs/a\"'"
        raise InputError(f"{text!r} is not NAME=JSON", field="--argument", remedy=remedy) from error


@command(show=_show)
def show(folder: Checkpoint) -> dict[str, Any]:
    """Describe a policy checkpoint.

    The command prints network, training data and observation settings of the checkpoint DIR, or of the packaged policy
    (builtin).
    """
    from gensim2.policy.checkpoint import PolicyCheckpoint

    found = PolicyCheckpoint.load(folder)
    return {
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


@command(show=_show_export)
def export(folder: Checkpoint, *, to: Literal["onnx", "torch"] = "onnx", out: File) -> dict[str, Any]:
    """Export a policy's network as ONNX or a PyTorch graph.

    The command exports the network of the checkpoint DIR for batch size 1, and checks that the exported network gives
    the same outputs. It also writes FILE.json, which describes the names and shapes of the inputs, the instructions and
    the observation settings. For a keypose policy (a policy that predicts hand poses), FILE.json also describes the
    order of the points and the meaning of the predicted classes.

    Args:
        to: Format.
        out: File to write.
    """
    from gensim2.policy.export import export_policy

    return export_policy(folder, out, to)


@command()
def serve(
    controller: Annotated[str, Option(metavar="DIR|builtin|module:Class")],
    *,
    host: str = "127.0.0.1",
    port: Annotated[int, click.IntRange(0, 65535)] = 8321,
    arguments: Annotated[tuple[str, ...], Option("--argument", "NAME=JSON")] = (),
    robot: str,
) -> None:
    """Serve a policy or controller to a robot on another machine.

    The command starts a websocket server for the checkpoint DIR or for your own class module:Class. On the robot's
    machine, run gensim2 robot run --policy ws://HOST:PORT.

    Clients must send the token that the environment variable GENSIM2_POLICY_TOKEN contains. Without this variable, the
    server generates a token and prints it. Connections are not encrypted. For access from other machines, use a tunnel
    (ssh -L) or a proxy with encryption (wss).

    Args:
        host: Address to listen on.
        port: Port to listen on; 0 is any free port.
        arguments: Argument of the constructor of module:Class; can be repeated.
    """
    from gensim2.policy.evaluating import policy_controller
    from gensim2.policy.remote.protocol import TOKEN
    from gensim2.policy.remote.server import PolicyServer
    from gensim2.rollout.controller_spec import ControllerSpec

    if ":" in controller:
        spec = ControllerSpec.of(controller, dict(map(_argument, arguments)))
    else:
        spec = policy_controller(controller)
    given_token = os.environ.get(TOKEN)
    token = given_token or secrets.token_urlsafe(24)
    server = PolicyServer(spec, robot, token, host=host, port=port, said=line)
    if not given_token:
        line(f"export {TOKEN}={token}")
    line(f"{spec.target} at {server.url}")
    try:
        server.serve()
    finally:
        server.close()


policy = click.Group("policy", commands=[show, export, serve], help="Inspect policies, export them and serve them.")
