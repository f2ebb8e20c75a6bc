"""Export policies for use without gensim2, with ``torch.export`` or as ONNX."""

from __future__ import annotations

import io
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args

import torch
from torch import nn

from gensim2.core.errors import InputError, required
from gensim2.core.files import write_atomic, write_json
from gensim2.policy.checkpoint import PolicyCheckpoint, checkpoint_folder
from gensim2.policy.frames import cloud_size, proprio_size
from gensim2.policy.keypose.answers import order_of_points
from gensim2.policy.keypose.training import read_ways
from gensim2.policy.network import CLOUD, PROPRIO, TEXT

if TYPE_CHECKING:
    from gensim2.policy.network import PolicyNetwork

Format = Literal["torch", "onnx"]
FORMATS: tuple[Format, ...] = get_args(Format)
NOISE, OUTPUT = "noise", "action"

TOLERANCE = 1e-5
"""Maximum error of an exported value v, relative to 1 + abs(v)."""


class Exported(nn.Module):  # type: ignore[misc]
    """Policy network for export.

    The network has separate inputs for cloud and proprioception, and for text and noise if the policy uses them.
    """

    def __init__(self, network: PolicyNetwork) -> None:
        super().__init__()
        self.network = network
        self.names = [CLOUD, PROPRIO]
        if network.text is not None:
            self.names.append(TEXT)
        if network.head.noise:
            self.names.append(NOISE)

    def forward(self, *given: torch.Tensor) -> torch.Tensor:
        batch = dict(zip(self.names, given, strict=True))
        noise = batch.pop(NOISE) if NOISE in batch else given[0].new_zeros(len(given[0]), 0)
        return self.network(batch, noise)


def example_inputs(checkpoint: PolicyCheckpoint, seed: int = 0) -> dict[str, torch.Tensor]:
    """Return random network inputs for one prediction, distributed around the mean of the training data."""
    network, config = checkpoint.network, checkpoint.config
    generator = torch.Generator().manual_seed(seed)
    arm, points = checkpoint.action.arm, checkpoint.observation.cloud.points
    cloud = torch.randn(1, config.history, points, cloud_size(config), generator=generator)
    own = torch.randn(1, config.history, proprio_size(config, arm), generator=generator)
    found = {
        CLOUD: network.cloud_mean + network.cloud_scale * cloud,
        PROPRIO: network.proprio_mean + network.proprio_scale * own,
    }
    if network.text is not None:
        found[TEXT] = checkpoint.table[:1]
    if network.head.noise:
        found[NOISE] = torch.randn(1, *network.head.noise, generator=generator)
    return found


def export_policy(folder: Path | str, out: Path, to: Format) -> dict[str, Any]:
    """Export a policy's network with batch size 1, and compare its output with the output of the original network.

    ``<name>.json`` describes the use of the exported network: names and shapes of the inputs, instructions, observation
    spec and action format. The inputs have the form of :class:`~gensim2.policy.frames.Inputs`, so the user must
    transform clouds and poses into the policy's frame. For a keypose policy, ``points_order`` is the expected order of
    the points, and ``classes`` lists the output classes; the last class, "done", is ``null``.

    Args:
        folder: folder of the checkpoint.
        to: format, one of ``FORMATS``.

    Returns:
        A dict with the exported ``file``, its ``format``, the shapes of the ``inputs`` by name, and the ``difference``:
        the largest deviation of the exported network's output from the original output.

    Raises:
        InputError: the format is unknown, the checkpoint cannot be used, or the outputs differ by more than 1e-5.
        MissingExtraError: a package is not installed.
    """
    if to not in FORMATS:
        raise InputError(f"must be one of {', '.join(FORMATS)}, but is {to!r}", field="to")
    folder = checkpoint_folder(folder)
    checkpoint = PolicyCheckpoint.load(folder)
    module = Exported(checkpoint.network).eval()
    inputs = example_inputs(checkpoint)
    values = tuple(inputs[name] for name in module.names)
    with torch.no_grad():
        graph = torch.export.export(module, values)
    buffer = io.BytesIO()
    if to == "torch":
        torch.export.save(graph, buffer)
    else:
        _write_onnx(graph, values, module.names, buffer)
    write_atomic(out, buffer.getvalue())
    run, difference = exported(out, to), 0.0
    for seed in range(1, 4):
        inputs = example_inputs(checkpoint, seed)
        given = {name: inputs[name] for name in module.names}
        with torch.no_grad():
            found, expected = run(given), module(*given.values())
        difference = max(difference, float(((found - expected).abs() / (1 + expected.abs())).max()))
    if not difference <= TOLERANCE:
        out.unlink()
        wrong = f"its output differs from the output of the checkpoint by {difference:.1e}"
        raise InputError(f"the exported model is wrong and was removed: {wrong}", file=out)
    about: dict[str, Any] = {
        "schema_version": 1,
        "inputs": {name: list(inputs[name].shape) for name in module.names},
        "robot": checkpoint.robot,
        "action": checkpoint.action.model_dump(),
        "observation": checkpoint.observation.to_dict(),
        "policy": checkpoint.config.to_dict(),
        "sentences": {text: row.tolist() for text, row in zip(checkpoint.sentences, checkpoint.table, strict=True)},
    }
    if checkpoint.action.kind == "keypose":
        about["points_order"] = order_of_points(checkpoint.observation.cloud.points).tolist()
        about["classes"] = [*(way.model_dump() for way in read_ways(Path(folder), checkpoint)), None]
    write_json(out.with_name(out.name + ".json"), about)
    return {"schema_version": 1, "file": str(out), "format": to, "inputs": about["inputs"], "difference": difference}


def exported(file: Path, to: Format) -> Callable[[dict[str, torch.Tensor]], torch.Tensor]:
    """Load an exported policy as a function that takes the inputs as keyword arguments."""
    if to == "torch":
        module = torch.export.load(io.BytesIO(file.read_bytes())).module()
        return lambda inputs: module(*inputs.values())
    session = required("onnxruntime", "export").InferenceSession(str(file), providers=["CPUExecutionProvider"])

    def run(inputs: dict[str, torch.Tensor]) -> torch.Tensor:
        return torch.from_numpy(session.run(None, {name: value.numpy() for name, value in inputs.items()})[0])

    return run


def _write_onnx(graph: Any, values: tuple[torch.Tensor, ...], names: list[str], buffer: io.BytesIO) -> None:
    required("onnxruntime", "export")
    required("onnxscript", "export")  # torch.onnx needs it
    torch.onnx.export(
        graph, values, buffer, input_names=names, output_names=[OUTPUT], dynamo=True, external_data=False, verbose=False
    )
