"""Run a ``gensim2`` command whose small trainings take long enough to be killed; see ``test_trainings.py``."""

from __future__ import annotations

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
    data.SHARD, teachers.PORTION, teachers.LEAST_STEPS = 2, 1, STEPS
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
    return run(arguments)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
