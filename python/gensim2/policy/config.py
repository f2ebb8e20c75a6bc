"""Define the settings of a policy's network and of its training."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, ClassVar, Literal

from gensim2.core.errors import InputError
from gensim2.policy.settings import Settings, setting

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
    """Architecture and inputs of a policy. Each field has its own help text."""

    of_what: ClassVar[str] = "policy settings"

    encoder: str = setting(
        "mlp",
        "Point encoder; state: an MLP on keypoints that only a simulator knows, a privileged baseline.",
        choices=ENCODERS,
    )
    blocks: int = setting(0, "Inverted residual blocks a stage of pointnext; 0 is PointNeXt-S.", low=0, high=16)
    text: str = setting("small", "Text encoder; none: the sentence is not looked at.", choices=TEXTS)
    text_model: str = setting(CLIP, "Folder or hub name of the weights of --text clip or sentence.")
    head: str = setting("chunk", "What makes actions of the trunk's tokens.", choices=HEADS)
    frame: str = setting(
        "turned",
        "Frame of clouds and poses: the robot's base turned by the first joint's angle, or the base. The first "
        "makes the policy exactly equivariant to a yaw of the scene about the base.",
        choices=FRAMES,
    )
    points: int | None = setting(None, "Points of a cloud.  [default: as the data have]", low=1, high=49152)
    colour: bool = setting(True, "See the colours of the points.")
    tool_frame: bool = setting(True, "See each point in the tool's frame, too.")
    joints: bool = setting(True, "See the joints' angles beside the tool's pose.")
    velocity: bool = setting(False, "See the joints' velocities.")
    history: int = setting(1, "Frames that are seen, the present one included.", low=1, high=4)
    stride: int = setting(4, "Control steps between the frames of the history.", low=1, high=100)
    width: int = setting(192, "Width of the trunk's tokens.", low=8, high=4096)
    layers: int = setting(2, "Layers of the trunk.", low=0, high=48)
    attention: int = setting(4, "Attention heads of the trunk and of the decoders.", low=1, high=64)
    decoder_layers: int = setting(2, "Layers of the decoders of transformer, diffusion and flow.", low=1, high=48)
    hidden: int = setting(384, "Width of the MLP of the chunk head.", low=8, high=8192)
    horizon: int = setting(16, "Actions that are predicted at once.", low=1, high=256)
    execute: int = setting(8, "Actions of them that are executed before the policy looks again.", low=1, high=256)
    noise_levels: int = setting(100, "Noise levels of diffusion in training.", low=2, high=10000)
    ways: int = setting(2, "Strategies that the keypose head tells apart, and one for done.", low=1, high=10000)
    hears: bool = setting(
        False, "The keypose head has a term of the sentence alone, which says what is meant whatever the cloud is like."
    )
    seen_points: int = setting(128, "Points that a keypose or keyframe heatmap is made over: any.", low=1, high=49152)
    spread_points: int = setting(
        0, "Points beside them that lie far from each other, so that small things have some.", low=0, high=49152
    )
    keyframes: int = setting(
        0,
        "Keyframes of the hand, the next ones at which it stands still, that heads of action chunks are told: pointed "
        "at on seen_points of the cloud, and learned from demonstrations beside the actions.",
        low=0,
        high=8,
    )
    denoise_steps: int = setting(4, "Steps of DDIM, or of Euler's rule for flow, at inference.", low=1, high=1000)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.width % self.attention or self.width % 2:
            raise InputError(f"must be even and a multiple of the setting 'attention', {self.attention}", field="width")
        if self.execute > self.horizon:
            raise InputError(f"must be at most the setting 'horizon', {self.horizon}", field="execute")
        if self.denoise_steps > self.noise_levels:
            raise InputError(f"must be at most the setting 'noise_levels', {self.noise_levels}", field="denoise_steps")
        if self.keyframes and self.head == "keypose":
            raise InputError("applies to action-chunk policies only", field="keyframes")
        if self.encoder == "state":
            if self.head == "keypose":
                raise InputError(
                    "state applies to action-chunk policies only", field="encoder", remedy="use another --head"
                )
            if self.keyframes and self.points is not None and self.seen_points < self.points:
                message = f"must be all points, at least {self.points}, of the encoder state"
                raise InputError(message, field="seen_points")
        if self.blocks and self.encoder != "pointnext":
            raise InputError(f"applies to the encoder pointnext, not to {self.encoder}", field="blocks")

    @property
    def source(self) -> Source:
        """Value of ``CloudSettings.source`` that the encoder needs: ``"depth"`` or ``"keypoints"``."""
        return "keypoints" if self.encoder == "state" else "depth"


@dataclass(frozen=True)
class TrainConfig(Settings):
    """Settings of a training run. Each field has its own help text."""

    of_what: ClassVar[str] = "training settings"

    steps: int = setting(3000, "Gradient steps.", low=1, high=10**9)
    batch: int = setting(64, "Samples a step.", low=1, high=65536)
    learning_rate: float = setting(1e-3, "Peak of the learning rate.", low=0.0, high=1.0)
    warmup: int = setting(
        100, "Steps until the peak; then a cosine to zero one step after the last.", low=0, high=10**9
    )
    weight_decay: float = setting(1e-4, "AdamW's, of weight matrices alone.", low=0.0, high=1.0)
    clip: float = setting(1.0, "Largest norm of the gradient.", low=1e-6, high=1e6)
    ema: float = setting(0.999, "Decay of the averaged weights, which are those that are used.", low=0.0, high=0.999999)
    jitter: float = setting(0.002, "Standard deviation of noise on the points, m.", low=0.0, high=0.1)
    dropout: float = setting(
        0.2, "Largest share of points that are dropped; of no effect with the encoder state.", low=0.0, high=0.95
    )
    colour_jitter: float = setting(0.05, "Standard deviation of a shift of all colours of a cloud.", low=0.0, high=1.0)
    yaw: float = setting(
        0.0, "Largest yaw of a scene about the base, rad; of no effect where frame is turned.", low=0.0, high=3.2
    )
    arm_noise: float = setting(
        0.0,
        "Largest standard deviation by which the arm's joints are shown elsewhere than they were, rad: half of the "
        "samples, with actions that lead back. Clouds without the robot alone can be shown so.",
        low=0.0,
        high=0.5,
    )
    seed: int = setting(0, "Of everything that is drawn.", low=0, high=2**32 - 1)
    threads: int = setting(
        1, "Threads of PyTorch; 0: as it likes. More cost far more where others are at work.", low=0, high=1024
    )
    amp: bool = setting(True, "Mixed precision (bfloat16) where there is a GPU.")
    compile: bool = setting(False, "Compile the network by torch.compile.")
    save_every: int = setting(500, "Steps between the states that a training can be resumed from.", low=1, high=10**9)
    log_every: int = setting(50, "Steps between the points of the curves.", low=1, high=10**9)


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
