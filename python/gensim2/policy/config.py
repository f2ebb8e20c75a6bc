"""Define the settings of a policy's network and of its training."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any, ClassVar, Literal, Self

from gensim2.core.errors import InputError, near


def setting(
    default: Any, text: str, *, choices: Sequence[str] = (), low: float | None = None, high: float | None = None
) -> Any:
    """Return a dataclass field with its help text and its allowed values.

    Args:
        default: default value and so type of the field; None allows an integer or None.
        text: help text of the field and of its command-line option.
        choices: allowed strings.
        low, high: inclusive bounds of a number.
    """
    return field(default=default, metadata={"help": text, "choices": tuple(choices), "low": low, "high": high})


@dataclass(frozen=True)
class Settings:
    """Base class of settings; the fields are defined with :func:`setting`.

    Raises:
        InputError: a value has the wrong type or is out of range; the message names the field.
    """

    of_what: ClassVar[str] = "settings"

    def __post_init__(self) -> None:
        for each in fields(self):
            object.__setattr__(
                self, each.name, _checked(getattr(self, each.name), each.default, each.metadata, each.name)
            )

    @classmethod
    def of(cls, values: Mapping[str, Any], *, file: str | None = None) -> Self:
        """Return settings from plain data.

        Raises:
            InputError: a field is unknown or invalid; the message names ``file`` and the field.
        """
        known = {each.name for each in fields(cls)}
        for name in values:
            if name not in known:
                remedy = near(name, sorted(known))
                raise InputError(f"is not a field of the {cls.of_what}", file=file, field=str(name), remedy=remedy)
        try:
            return cls(**values)
        except InputError as error:
            raise InputError(error.message, file=file, field=error.field, remedy=error.remedy) from error

    def to_dict(self) -> dict[str, Any]:
        return asdict(self)


def _checked(value: Any, default: Any, metadata: Mapping[str, Any], name: str) -> Any:
    if default is None:
        if value is None:
            return None
        default = 0
    kind = type(default)
    if kind is float and type(value) is int and abs(value) <= sys.float_info.max:
        value = float(value)
    if type(value) is not kind:
        words = {int: "a whole number", float: "a number", bool: "true or false", str: "text"}
        raise InputError(f"must be {words[kind]}, but is {value!r}", field=name)
    if metadata["choices"] and value not in metadata["choices"]:
        raise InputError(f"must be one of {', '.join(metadata['choices'])}, but is {value!r}", field=name)
    low, high = metadata["low"], metadata["high"]
    if (low is not None and not value >= low) or (high is not None and not value <= high):
        bounds = " and ".join(
            text for text in (low is not None and f"at least {low}", high is not None and f"at most {high}") if text
        )
        raise InputError(f"must be {bounds}, but is {value}", field=name)
    return value


Source = Literal["depth", "keypoints"]
ENCODERS = ("mlp", "pointnet", "pointnext", "state")
PRETRAINED = ("clip", "sentence")
TEXTS = ("none", "small", *PRETRAINED)
CLIP = "openai/clip-vit-base-patch32"
"""Name of the text encoder on the Hugging Face hub."""
SENTENCE = "sentence-transformers/all-MiniLM-L6-v2"
"""Name of a small sentence encoder on the Hugging Face hub."""
HEADS = ("chunk", "transformer", "diffusion", "flow", "keypose")
FRAMES = ("turned", "base")
OF_KEYPOSES = ("ways", "hears", "spread_points")
"""Names of the settings that apply only to the keypose head."""


@dataclass(frozen=True)
class PolicyConfig(Settings):
    """Settings of a policy's network: its inputs, its encoders and its head."""

    of_what: ClassVar[str] = "policy settings"

    encoder: str = setting(
        "mlp",
        "Point cloud encoder. state is an MLP on keypoints (known only in simulation) for privileged baselines.",
        choices=ENCODERS,
    )
    blocks: int = setting(
        0, "Inverted residual blocks per stage of the encoder pointnext; 0 is PointNeXt-S.", low=0, high=16
    )
    text: str = setting(
        "small", "Text encoder of the instruction. With none the policy gets no instruction.", choices=TEXTS
    )
    text_model: str = setting(CLIP, "Folder or hub name of the weights for --text clip or sentence.")
    head: str = setting("chunk", "Network that computes actions from the trunk's tokens.", choices=HEADS)
    frame: str = setting(
        "turned",
        "Frame of point clouds and poses. base is the frame of the robot's base. turned is this frame rotated by the "
        "angle of the first joint, so that the policy is exactly equivariant to a yaw of the scene about the base.",
        choices=FRAMES,
    )
    points: int | None = setting(
        None, "Number of points of a point cloud.  [default: number in the data]", low=1, high=49152
    )
    colour: bool = setting(True, "Use the colours of the points as input.")
    tool_frame: bool = setting(True, "Use each point's position in the tool frame as an additional input.")
    joints: bool = setting(True, "Use the joint positions as input, in addition to the tool pose.")
    velocity: bool = setting(False, "Use the joint velocities as input.")
    history: int = setting(1, "Number of frames that the policy observes, including the present one.", low=1, high=4)
    stride: int = setting(4, "Control steps between two frames of the history.", low=1, high=100)
    width: int = setting(192, "Width of the trunk's tokens.", low=8, high=4096)
    layers: int = setting(2, "Layers of the trunk.", low=0, high=48)
    attention: int = setting(4, "Attention heads of the trunk and of the decoders.", low=1, high=64)
    decoder_layers: int = setting(2, "Decoder layers of the heads transformer, diffusion and flow.", low=1, high=48)
    hidden: int = setting(384, "Width of the MLP of the head chunk.", low=8, high=8192)
    horizon: int = setting(16, "Number of actions of a prediction.", low=1, high=256)
    execute: int = setting(8, "Number of actions that are executed before the next prediction.", low=1, high=256)
    noise_levels: int = setting(100, "Number of noise levels of the head diffusion in training.", low=2, high=10000)
    ways: int = setting(
        2, "Number of classes of the keypose head: one for each strategy, and one for done.", low=1, high=10000
    )
    hears: bool = setting(
        False, "Add class scores that depend only on the instruction, not on the point cloud, to the keypose head."
    )
    seen_points: int = setting(
        128,
        "Number of random points of the cloud over which a keyframe or keypose heatmap is computed.",
        low=1,
        high=49152,
    )
    spread_points: int = setting(
        0,
        "Number of additional points, chosen far from each other so that small objects get some of them.",
        low=0,
        high=49152,
    )
    keyframes: int = setting(
        0,
        "Number of keyframes to predict as an input of the action head. Keyframes are the next poses in which the "
        "hand stands still; they are learned from the demonstrations, and predicted by heatmaps over --seen-points.",
        low=0,
        high=8,
    )
    denoise_steps: int = setting(
        4, "Inference steps: of DDIM for the head diffusion, of Euler's method for the head flow.", low=1, high=1000
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.width % self.attention or self.width % 2:
            wrong = f"must be even and a multiple of the setting 'attention', which is {self.attention}"
            raise InputError(wrong, field="width")
        if self.execute > self.horizon:
            raise InputError(f"must be at most the setting 'horizon', which is {self.horizon}", field="execute")
        if self.denoise_steps > self.noise_levels:
            wrong = f"must be at most the setting 'noise_levels', which is {self.noise_levels}"
            raise InputError(wrong, field="denoise_steps")
        if self.keyframes and self.head == "keypose":
            raise InputError("this setting applies only to action-chunk policies", field="keyframes")
        if self.encoder == "state":
            if self.head == "keypose":
                wrong = "the encoder 'state' is available only for policies that predict action chunks"
                raise InputError(wrong, field="encoder", remedy="use another --head")
            if self.keyframes and self.points is not None and self.seen_points < self.points:
                message = f"must be all points, at least {self.points}, of the encoder state"
                raise InputError(message, field="seen_points")
        if self.blocks and self.encoder != "pointnext":
            message = f"this setting applies only to the encoder pointnext, but the encoder is {self.encoder}"
            raise InputError(message, field="blocks")

    @property
    def source(self) -> Source:
        """Value of ``CloudSettings.source`` that the encoder needs: ``"depth"`` or ``"keypoints"``."""
        return "keypoints" if self.encoder == "state" else "depth"


@dataclass(frozen=True)
class TrainConfig(Settings):
    """Settings of a training run. Each field has its own help text."""

    of_what: ClassVar[str] = "training settings"

    steps: int = setting(3000, "Number of gradient steps.", low=1, high=10**9)
    batch: int = setting(64, "Number of samples per gradient step.", low=1, high=65536)
    learning_rate: float = setting(1e-3, "Maximum learning rate.", low=0.0, high=1.0)
    warmup: int = setting(
        100, "Steps until the maximum learning rate, which then decays to zero as a cosine.", low=0, high=10**9
    )
    weight_decay: float = setting(
        1e-4, "Weight decay of AdamW, which applies to weight matrices only.", low=0.0, high=1.0
    )
    clip: float = setting(1.0, "Maximum norm of the gradient.", low=1e-6, high=1e6)
    ema: float = setting(
        0.999, "Decay of the moving average of the weights; the policy uses the average.", low=0.0, high=0.999999
    )
    jitter: float = setting(0.002, "Standard deviation of random offsets of the points, in metres.", low=0.0, high=0.1)
    dropout: float = setting(
        0.2, "Maximum fraction of points that are dropped; no effect with the encoder state.", low=0.0, high=0.95
    )
    colour_jitter: float = setting(
        0.05, "Standard deviation of a random shift of all colours of a point cloud.", low=0.0, high=1.0
    )
    yaw: float = setting(
        0.0, "Maximum random yaw of a scene about the base, in rad; no effect with frame turned.", low=0.0, high=3.2
    )
    arm_noise: float = setting(
        0.0,
        "Maximum standard deviation, in rad, of random joint offsets in half of the samples. Their actions lead back "
        "to the demonstration. Needs point clouds without the robot (--keep-robot none of gensim2 render).",
        low=0.0,
        high=0.5,
    )
    seed: int = setting(0, "Seed of all random numbers.", low=0, high=2**32 - 1)
    threads: int = setting(
        1,
        "Number of threads of PyTorch; 0 uses PyTorch's default. On a busy machine more threads are much slower.",
        low=0,
        high=1024,
    )
    amp: bool = setting(True, "Use mixed precision (bfloat16) on a GPU.")
    compile: bool = setting(False, "Compile the network with torch.compile.")
    save_every: int = setting(
        500, "Steps between saved states, from which a training run can be resumed.", low=1, high=10**9
    )
    log_every: int = setting(50, "Steps between two points of the training curves.", low=1, high=10**9)


def read_config(path: Path, **flags: Any) -> tuple[PolicyConfig, TrainConfig]:
    """Read network and training settings from one YAML file.

    Args:
        path: the YAML file.
        flags: fields whose values override the values in the file.

    Raises:
        InputError: the file cannot be read, or a field is unknown or invalid; the message names file and field.
    """
    from gensim2.core.yaml_files import read_yaml  # import late, so that `gensim2 --help` stays fast

    return configs({**read_yaml(path), **flags}, file=str(path))


def configs(values: dict[str, Any], *, file: str | None = None) -> tuple[PolicyConfig, TrainConfig]:
    """Split plain data into network settings and training settings.

    Raises:
        InputError: a field is unknown or invalid.
    """
    training = {each.name for each in fields(TrainConfig)}
    policy = PolicyConfig.of({name: value for name, value in values.items() if name not in training}, file=file)
    return policy, TrainConfig.of({name: value for name, value in values.items() if name in training}, file=file)
