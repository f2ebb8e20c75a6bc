"""``gensim2 doctor`` runs its checks."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from gensim2.doctor import doctor, extra, language_model, mujoco_renderer, ray_casting, vulkan


def test_all_that_is_promised_is_looked_at() -> None:
    names = [check.name for check in doctor("builtin").checks]
    assert names == [
        "Python",
        "Rust",
        "Solver",
        "SAPIEN",
        "MuJoCo",
        "Vulkan driver",
        "MuJoCo's renderer",
        "Ray casting",
        "ffmpeg",
        "Language model",
        "USD files",
        "Data sets",
        "Ray",
        "Sentences",
        "Plans in the browser",
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


def test_the_renderer_and_its_reason_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("mujoco")
    pytest.importorskip("OpenGL")
    monkeypatch.setenv("MUJOCO_GL", "glfw")
    check = mujoco_renderer()
    assert check.status == "limited"
    assert check.value == "the ray caster draws, because MUJOCO_GL: is 'glfw' (set it to egl or osmesa)"


def test_a_package_that_is_not_there_and_one_that_does_not_load_are_told_apart(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "broken_peer.py").write_text("raise ImportError('libpeer.so: cannot open shared object file')")
    monkeypatch.syspath_prepend(tmp_path)
    absent = extra("Ray", "ray", ("json", "no_such_peer"), "all else works")
    assert (absent.status, absent.value) == ("limited", "not installed: no_such_peer")
    assert absent.remedy == "pip install 'gensim2[ray]'; all else works"
    broken = extra("Ray", "ray", ("broken_peer",), "")
    assert (broken.status, "libpeer.so" in broken.value) == ("limited", True)
    assert extra("Numbers", "sim", ("numpy", "scipy"), "").status == "ok"


def test_a_ray_is_cast(monkeypatch: pytest.MonkeyPatch) -> None:
    assert ray_casting().status == "ok"
    monkeypatch.setitem(sys.modules, "embreex.rtcore_scene", None)
    assert (ray_casting().status, "embreex" in ray_casting().remedy) == ("limited", True)


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
    assert (refused.status, "$OPENAI_API_KEY: is not set" in refused.value) == ("missing", True)
    gone = language_model("test-model", server.url)
    assert (gone.status, "cannot be reached" in gone.value) == ("missing", True)
    assert "start the server" in gone.remedy
