"""The doctor really tries."""

from __future__ import annotations

from pathlib import Path

import pytest

from gensim2.doctor import doctor, vulkan


def test_all_that_is_promised_is_looked_at() -> None:
    names = [check.name for check in doctor("builtin").checks]
    assert names == [
        "Python",
        "Rust",
        "Solver",
        "Simulation",
        "Vulkan driver",
        "ffmpeg",
        "Assets",
        "Cache",
        "Cores",
        "Memory",
    ]


def test_no_driver_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("VK_DRIVER_FILES", "VK_ICD_FILENAMES"):
        monkeypatch.setenv(name, "/nonexistent.json")
    check = vulkan()
    assert check.status == "limited"
    assert "Mesa" in check.remedy


def test_missing_assets_are_named(tmp_path: Path) -> None:
    diagnosis = doctor(tmp_path / "nowhere")
    assert not diagnosis.healthy
    (assets,) = (check for check in diagnosis.checks if check.name == "Assets")
    assert assets.status == "missing"
    assert "nowhere" in assets.value
