"""Copy and check the original episodes that an export contains. The export may be untrusted."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from gensim2.core.errors import InputError
from gensim2.core.foreign.limits import MAX_RECORD, MAX_STRATEGIES
from gensim2.core.foreign.names import is_name
from gensim2.core.foreign.tree import ForeignTree
from gensim2.core.progress import Progress
from gensim2.core.sealed_file import MAX_BYTES
from gensim2.core.yaml_files import MAX_BYTES as MAX_YAML
from gensim2.data.dataset import DATASET_JSON, DataSet
from gensim2.data.formats.seen_table import NAME as SEEN
from gensim2.data.store import ROWS, TaskStore
from gensim2.rollout.record import Episode
from gensim2.rollout.recording import EpisodeResult
from gensim2.tasks.library import STRATEGIES, TASK_FILE, load_strategies_beside

REMEDY = "export again"

Read = tuple[TaskStore, Episode, EpisodeResult]


def copy_native(source: Path, out: Path) -> None:
    """Copy the records, tasks and strategies of a data set and the episodes in ``episodes.jsonl``, but no other files.

    Raises:
        InputError: a file is missing, lies outside the folder, is not a regular file, is too large, or cannot be read.
    """
    tree = ForeignTree(source)
    dataset = DataSet.open(source)
    tree.copy(DATASET_JSON, out / DATASET_JSON, MAX_RECORD)
    if tree.has(SEEN):
        tree.copy(SEEN, out / SEEN, MAX_RECORD)
    for name in dataset.tasks:
        store = dataset.task(name)
        (out / name / STRATEGIES).mkdir(parents=True)
        (out / name / "episodes").mkdir()
        tree.copy(f"{name}/{TASK_FILE}", out / name / TASK_FILE, MAX_YAML)
        strategies = ForeignTree(store.folder / STRATEGIES).names()
        if len(strategies) > MAX_STRATEGIES:
            wrong = f"holds over {MAX_STRATEGIES} files"
            raise InputError(wrong, file=store.folder / STRATEGIES, remedy="keep only strategies that the task names")
        for file in strategies:
            if file.endswith(".yaml") and is_name(file):
                tree.copy(f"{name}/{STRATEGIES}/{file}", out / name / STRATEGIES / file, MAX_YAML)
        tree.copy(f"{name}/{ROWS}", out / name / ROWS, MAX_RECORD)
        for row in store.rows():
            file = str(store.path(row.index, row.held).relative_to(source))
            if row.held:
                tree.copy(file, out / file, MAX_BYTES)


def read_back(dataset: DataSet, progress: Progress) -> Iterator[Read]:
    """Yield every episode of a copied data set, and check that each is valid and successful.

    Raises:
        InputError: a task, strategy, row or episode is missing or invalid, or an episode failed.
    """
    for name in dataset.tasks:
        store = dataset.task(name)
        spec = store.spec()
        if spec.name != name:
            wrong = f"must be {name!r}, the name of the folder, but is {spec.name!r}"
            raise InputError(wrong, file=store.folder / TASK_FILE, field="name")
        load_strategies_beside(store.folder, spec)
        progress.start(f"read back {name}")
        for row in store.rows():
            if not row.held:
                wrong = f"has episode {row.index}, which failed"
                raise InputError(wrong, file=store.folder / ROWS, remedy=REMEDY)
            yield store, row, store.read(row)
            progress.advance()
