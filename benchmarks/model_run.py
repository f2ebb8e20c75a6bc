"""A whole run with a model that sees, over HTTP, in physics; what it is shown is kept for people to look at.

    python benchmarks/model_run.py --out runs/model

No model is asked: a script on loopback answers with strategies of our library (`tests/common`), so this says nothing
of how good anybody's tasks are, but every stage, picture, search, episode and replay is real. It proposes to open a
drawer, put a golf ball into it and close it; that is taken apart, written as code, planned, tried and
verified, and then once more from the recorded answers. Whether the task is kept is up to physics. Needs a Vulkan
driver, and minutes of CPU on a software one.
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

#: What of a report says when and where.
WHEN_AND_WHERE = re.compile(r"started [^ ]+|finished [^ <]+|<pre class=\"command\">.*?</pre>", re.DOTALL)


def main(arguments: list[str] | None = None) -> int:
    """Command line; returns 1 where a run did not get to its end, or the replay ends in another report."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--seed", type=int, default=2)
    parser.add_argument("--verify", type=int, default=20)
    options = parser.parse_args(arguments)
    os.environ |= {"OPENAI_API_KEY": KEY, "GENSIM2_LIBRARY": "none"}
    common = ["--num-tasks", "1", "--assets", "builtin", "--seed", str(options.seed), "--from-empty", "--workers", "1"]
    common += ["--verify", str(options.verify), "--episodes", "0", "--videos", "0"]
    # What answers are kept by has the model's name in it: a new name is asked anew.
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
    print(f"kept: {kept}; the replay ends in the same report: {first == second}")
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
