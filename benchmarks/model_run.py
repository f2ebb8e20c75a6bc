"""Test a complete design run with a scripted vision-language model over HTTP, including simulation and replay.

    python benchmarks/model_run.py --out runs/model

No real model is used. A script on localhost answers with strategies of the task library (`tests/common`), so the result
says nothing about the quality of a model's tasks. All other parts are real: prompts, pictures, search, episodes and
replay. The script proposes to open a drawer, put a golf ball into it, and close it. The pipeline decomposes this task,
requests it as code, plans, simulates and verifies it, and then repeats the run from the recorded answers. Simulation
decides whether the task is kept. The pictures that the model receives are saved for inspection. The test needs a Vulkan
driver, and takes some minutes of CPU time with a software driver.
"""

from __future__ import annotations

import argparse
import os
import re
import resource
import sys
import time
from collections import Counter
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1] / "tests" / "common"))

from llm_answers import LONG, Learner
from llm_server import KEY, ModelServer

from gensim2.cli.main import run as gensim2

#: Parts of a report that contain times and paths, which differ between two runs.
WHEN_AND_WHERE = re.compile(r"started [^ ]+|finished [^ <]+|<pre class=\"command\">.*?</pre>", re.DOTALL)


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; return 1 if a run fails, or if the replay writes a different report."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--seed", type=int, default=2)
    parser.add_argument("--verify", type=int, default=20)
    options = parser.parse_args(arguments)
    os.environ |= {"OPENAI_API_KEY": KEY, "GENSIM2_LIBRARY": "none"}
    common = ["--num-tasks", "1", "--assets", "builtin", "--seed", str(options.seed), "--from-empty", "--workers", "1"]
    common += ["--verify", str(options.verify), "--episodes", "0", "--videos", "0"]
    # Stored answers are found by the model's name. A new name prevents the use of answers from earlier runs.
    with ModelServer(Learner(LONG)) as server:
        asking = ["--mode", "topdown", "--target-object", "drawer", "--trials", "1", "--visual", "--code"]
        asked = [
            "--designer",
            f"script-{time.time_ns()}",
            "--base-url",
            server.url,
            *asking,
        ]
        done = gensim2(["run-pipeline", *common, *asked, "--out", str(options.out / "run")])
    _keep_pictures(server, options.out / "pictures")
    print(", ".join(f"{stage} {count}" for stage, count in Counter(server.stages()).items()))
    used = resource.getrusage(resource.RUSAGE_SELF).ru_utime + resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
    print(f"CPU so far: {used:.0f} s")
    again = gensim2(
        ["run-pipeline", *common, "--replay", str(options.out / "run"), "--out", str(options.out / "again")]
    )
    first, second = (
        WHEN_AND_WHERE.sub("", (options.out / name / "report.html").read_text()) for name in ("run", "again")
    )
    kept = (options.out / "run" / "tasks" / "StowGolfBall" / "verification.json").exists()
    print(f"kept: {kept}; the replay writes the same report: {first == second}")
    return int(done != 0 or again != 0 or first != second)


def _keep_pictures(server: ModelServer, folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for number, asked in enumerate(server.asked):
        for index, picture in enumerate(asked.pictures):
            path = folder / f"{number:02d}_{asked.stage}_{index + 1}.png"
            path.write_bytes(picture)
            print(f"{path.name}: {len(picture)} bytes")


if __name__ == "__main__":
    sys.exit(main())
