"""The doctor really tries."""

from __future__ import annotations

from pathlib import Path

import pytest

from gensim2.doctor import doctor, language_model, vulkan


def test_all_that_is_promised_is_looked_at() -> None:
    names = [check.name for check in doctor("builtin").checks]
    assert names == [
        "Python",
        "Rust",
        "Solver",
        "Simulation",
        "Vulkan driver",
        "ffmpeg",
        "Sandbox",
        "Language model",
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


def test_a_language_model_is_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("openai")
    from llm_server import KEY, ModelServer

    for variable in ("OPENAI_API_KEY", "OPENAI_BASE_URL"):
        monkeypatch.delenv(variable, raising=False)
    assert language_model().value == "not asked: no endpoint is named"
    with ModelServer(lambda asked: "yes", key=None) as server:
        assert language_model(base_url=server.url).value == f"{server.url}/ offers test-model"
        assert language_model("test-model", server.url).status == "ok"
        assert [asked.prompt for asked in server.asked] == ["Answer with the one word: yes"]
        server.key = KEY
        refused = language_model("test-model", server.url)
    assert (refused.status, "$OPENAI_API_KEY: is not set" in refused.value) == ("limited", True)
    assert "cannot be reached" in language_model("test-model", server.url).value
