"""Train a policy on demonstrations and write its checkpoint (``gensim2 train``)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from gensim2.core.errors import InputError
from gensim2.core.progress import NULL_PROGRESS, Progress
from gensim2.policy.config import configs, read_config


def train(
    data: Sequence[Path | str] | Path | str,
    *,
    out: Path | str,
    config: Path | None = None,
    settings: Mapping[str, Any] | None = None,
    tasks: Sequence[str] = (),
    start: Path | str | None = None,
    resume: bool = False,
    device: str = "auto",
    dagger: int = 0,
    dagger_episodes: int = 20,
    workers: int = 1,
    assets: Path | str | None = None,
    progress: Progress = NULL_PROGRESS,
) -> Any:
    """Train a policy on rendered data sets and return a :class:`~gensim2.policy.train.TrainResult`.

    Args:
        data: folders of the data sets.
        out: folder of the checkpoint.
        config: YAML file of settings (:mod:`gensim2.policy.config`).
        settings: settings by name, which override the settings in the file.
        tasks: names of the tasks; empty for all tasks of the data.
        start: checkpoint whose weights training starts from; network settings default to those of the checkpoint.
        resume: whether to continue an interrupted run in ``out``.
        device: as for :func:`~gensim2.policy.devices.read_devices`.
        dagger: number of DAgger rounds (:mod:`gensim2.policy.dagger`), each with the same number of gradient steps.
        dagger_episodes: number of rollouts of each task in a DAgger round.
        workers: simulator processes of the DAgger rounds.
        assets: folder of the objects in the DAgger rounds; None: the folder recorded in the data sets.

    Raises:
        InputError: a setting, the data or a checkpoint cannot be used.
        MissingExtraError: a package is not installed.

    Example:
        ```python
        result = train("night", out="policy", tasks=["CloseBox"], settings={"steps": 2000})
        print(result.loss)
        ```
    """
    from gensim2.policy.checkpoint import PolicyCheckpoint
    from gensim2.policy.demonstrations import Demonstrations
    from gensim2.policy.train import train_policy

    given = dict(settings or {})
    begun = PolicyCheckpoint.load(start) if start is not None else None
    if begun is not None:
        given = {**(read_flat(config) if config is not None else {}), **given}
        begun.require_text_model(given.get("text_model"), "--from")
        policy, training = configs({**begun.config.to_dict(), **given})
    else:
        policy, training = read_config(config, **given) if config is not None else configs(given)
    if policy.head == "keypose":
        wrong = "a keypose policy learns from plans, not from demonstrations"
        raise InputError(wrong, field="head", remedy="use `gensim2 learn --policy keypose`")
    if assets is not None and not dagger:
        raise InputError("can be given only together with --dagger", field="assets", remedy="leave it out")
    folders = [Path(each) for each in ((data,) if isinstance(data, str | Path) else data)]
    source = Demonstrations.open(folders, policy, tasks, progress=progress)
    if dagger:
        from gensim2.policy.dagger import train_rounds

        return train_rounds(
            source,
            folders,
            policy,
            training,
            Path(out),
            rounds=dagger,
            episodes=dagger_episodes,
            start=begun,
            resume=resume,
            device=device,
            workers=workers,
            assets=assets,
            progress=progress,
        )
    return train_policy(
        source, policy, training, Path(out), start=begun, resume=resume, device=device, progress=progress
    )


def read_flat(path: Path) -> dict[str, Any]:
    """Return the settings that a file contains, without defaults."""
    from gensim2.core.yaml_files import read_yaml

    read_config(path)
    return read_yaml(path)
