"""Many objects at once, in worker processes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from gensim2.core.errors import InputError
from gensim2.core.processes import WorkerPool, enumerated, in_order
from gensim2.objects.library.catalogue import Library


def load_all(
    library: Library, items: Sequence[tuple[str, str]], workers: int = 0
) -> Iterator[tuple[tuple[str, str], str | None]]:
    """Prepare (class, id) pairs in worker processes; each comes back with why it cannot be used, or None."""
    with WorkerPool(workers) as pool:
        for outcome in in_order(pool.map_unordered(_prepare, enumerated((library, *item) for item in items))):
            if isinstance(outcome.error, InputError):
                yield items[outcome.index], str(outcome.error)
            elif outcome.failures:
                yield items[outcome.index], outcome.failures[-1].reason
            else:
                outcome.unwrap()
                yield items[outcome.index], None


def _prepare(library: Library, asset_class: str, instance_id: str) -> None:
    library.load(asset_class, instance_id)
