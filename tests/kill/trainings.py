"""Run a ``gensim2`` command whose small trainings take long enough to be killed; see ``test_trainings.py``."""

from __future__ import annotations

import os
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

STEPS = 40


def main(arguments: list[str]) -> int:
    """Run a command line with a pause whenever a training saves its state."""
    from gensim2.cli.main import run
    from gensim2.policy import learn_settings, teachers
    from gensim2.policy.keypose import data
    from gensim2.policy.train_state import TrainState

    small: dict[str, Any] = {"width": 16, "layers": 1, "attention": 2, "hidden": 16}
    data.SHARD, teachers.PORTION, teachers.LEAST_STEPS, teachers.MAX_STEPS = 2, 1, STEPS, STEPS
    learn_settings.POLICY = replace(learn_settings.POLICY, **small)
    learn_settings.CHUNK_POLICY = replace(learn_settings.CHUNK_POLICY, **small)
    often: dict[str, Any] = {"batch": 4, "save_every": 2, "log_every": 1, "threads": 1}
    learn_settings.TRAINING = replace(learn_settings.TRAINING, **often)
    learn_settings.CHUNK_TRAINING = replace(learn_settings.CHUNK_TRAINING, **often)
    save = TrainState.save

    def slowly(self: TrainState, folder: Path, identity: Any) -> None:
        save(self, folder, identity)
        time.sleep(0.3)

    TrainState.save = slowly  # type: ignore[method-assign]
    if "START_TOGETHER" in os.environ:
        lock_together(Path(os.environ["START_TOGETHER"]))
    return run(arguments)


def lock_together(started: Path) -> None:
    """Let the first lock of this process wait until two processes have come that far.

    Args:
        started: empty folder for one file of each process.
    """
    from gensim2.core.resumable import FolderLock

    lock = FolderLock.__init__

    def together(self: FolderLock, *arguments: Any) -> None:
        FolderLock.__init__ = lock  # type: ignore[method-assign]
        (started / str(os.getpid())).touch()
        while len(list(started.iterdir())) < 2:
            time.sleep(0.0005)
        lock(self, *arguments)

    FolderLock.__init__ = together  # type: ignore[method-assign]


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
