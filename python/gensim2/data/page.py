"""``report.html`` of a collection: what is there, why the rest is not, how fast it went."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from gensim2.core.files import write_atomic
from gensim2.core.pages import template
from gensim2.data.dataset import DataSet
from gensim2.data.folder import REPORT
from gensim2.data.status import Status


def write_page(dataset: DataSet, status: Status, run: Mapping[str, Any]) -> Path:
    """Write ``report.html`` and return its path.

    Args:
        status: how far the collection is.
        run: what ``run.json`` says.

    Raises:
        WriteError: the folder cannot be written to.
    """
    licenses: dict[str, list[str]] = {}
    for name, used in dataset.record.objects.items():
        licenses.setdefault(used.license, []).append(name)
    page = template("gensim2.data", "collection.html.j2").render(
        record=dataset.record.model_dump(), status=status, run=dict(run), licenses=licenses
    )
    path = dataset.path / REPORT
    write_atomic(path, page)
    return path
