"""The notebook runs from its first cell to its last in a Jupyter kernel, whose event loop runs beside its cells."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

nbclient = pytest.importorskip("nbclient")
nbformat = pytest.importorskip("nbformat")

NOTEBOOK = Path(__file__).parents[2] / "examples/first_look.ipynb"


def _text(cell: Any) -> str:
    """Return the text that a cell printed and the value of its last line."""
    return "".join(each.get("text") or each.get("data", {}).get("text/plain", "") for each in cell.outputs)


def test_the_notebook_runs(tmp_path: Path) -> None:
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    assert not any(cell.get("outputs") for cell in notebook.cells), "outputs are not kept in the repository"
    client = nbclient.NotebookClient(notebook, timeout=600, resources={"metadata": {"path": str(tmp_path)}})
    client.execute()
    by_text = {cell.source: _text(cell) for cell in notebook.cells if cell.cell_type == "code"}

    def said(word: str) -> str:
        (text,) = (text for source, text in by_text.items() if word in source)
        return text

    assert "TqdmWarning" not in "".join(by_text.values())
    assert "solved" in said("plans = ")
    assert "'point_cloud': (1024, 6)" in said("obs, info")
    assert "image/png" in str([cell.outputs for cell in notebook.cells if "scatter" in cell.source])
    assert said("measured = ").strip().endswith("0.0")
    assert said("to_thread").strip() == "True"
    assert (tmp_path / "runs/box/report.html").is_file()
    assert [path.name for path in tmp_path.iterdir()] == ["runs"]
