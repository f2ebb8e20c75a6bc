"""Ctrl-C while a model thinks ends the run at once and keeps every answer."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from llm_answers import GoodModel
from llm_server import KEY, Asked, ModelServer

COMMAND = [sys.executable, "-m", "gensim2", "run-pipeline", "--designer", "test-model", "--num-tasks", "1"]
SCENE = ["--assets", "builtin", "--target-object", "box_rotate", "--library", "none", "--episodes", "0", "--from-empty"]


@pytest.mark.parametrize("stage", ["constraints", "motions"])
def test_ctrl_c_during_a_question_ends_the_run(tmp_path: Path, stage: str) -> None:
    good, reached = GoodModel(), []

    def slow(asked: Asked) -> str:
        if asked.stage == stage:
            reached.append(time.monotonic())
            time.sleep(30.0)
        return good(asked)

    environment = {**os.environ, "OPENAI_API_KEY": KEY, "XDG_CACHE_HOME": str(tmp_path / "cache")}
    with ModelServer(slow) as server:
        process = subprocess.Popen(
            [*COMMAND, "--base-url", server.url, *SCENE, "--out", str(tmp_path / "run")],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            env=environment,
        )
        deadline = time.monotonic() + 240.0
        while not reached and process.poll() is None and time.monotonic() < deadline:
            time.sleep(0.05)
        assert reached, process.communicate()[0] if process.poll() is not None else "no question"
        process.send_signal(signal.SIGINT)
        said, _ = process.communicate(timeout=20.0)
    assert process.returncode == 130, said
    assert "Traceback" not in said
    assert "what was finished is kept" in said
    kept = list((tmp_path / "run/model/answers").glob("*.json"))
    assert len(kept) == {"constraints": 2, "motions": 3}[stage]
