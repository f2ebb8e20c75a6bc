"""Episodes of two source trees, compared bit for bit: states, verdicts and CPU seconds, task by task in turn.

    python benchmarks/same_episodes.py BEFORE_PYTHON [AFTER_PYTHON] [--assets DIR] [--episodes 3] [--json FILE]

Each tree runs in a process of its own interpreter; this file is all that both share. An episode is run in both before
the next one, the order changing each time. States are compared by the digest of every recorded array, verdicts by
the whole record of the episode. ``NAMED`` is what may differ.
"""

from __future__ import annotations

import argparse
import hashlib
import importlib
import json
import subprocess
import sys
import time
from pathlib import Path
from typing import Any, NamedTuple

ANY = None
NAMED: dict[str, dict[Any, Any] | None] = {
    "objects.*.default_pose": {"ours": "default"},
    "objects.*.content_hash": ANY,
    "cause": {"happens with a still arm": "happens in the no-op baseline"},
}
"""Fields of an episode's record that may differ, and how: a content hash of a generated object digests the code that
prepares it, too."""


class Job(NamedTuple):
    """One episode: task, folder of objects or ``builtin``, physics (``ours`` is understood by all trees), seed."""

    task: str
    assets: str
    physics: str
    seed: int


# ------------------------------------------------------------------ in either tree


def _first(*names: str) -> Any:
    """Return the object of the first of several full names that this tree has."""
    for name in names:
        module, _, attribute = name.rpartition(".")
        try:
            return getattr(importlib.import_module(module), attribute)
        except (ImportError, AttributeError):
            continue
    raise ImportError(f"this tree has none of {', '.join(names)}")


def serve() -> None:
    """Run episodes that standard input names, one JSON list a line, and answer each with one line."""
    answers = sys.stdout
    sys.stdout = sys.stderr
    make = _first("gensim2.sim.headless.HeadlessEnv", "gensim2.sim.lane.Lane")
    chain = _first("gensim2.rollout.chain.ChainController", "gensim2.episodes.chain.ChainController")
    run = _first("gensim2.rollout.run.run", "gensim2.episodes.run.run")
    load_task = _first("gensim2.tasks.library.load_task")
    load_strategies = _first("gensim2.tasks.library.load_strategies")
    parse = _first("gensim2.planning.strategies.parse_strategy")
    known: dict[tuple[str, str, str], Any] = {}
    for line in sys.stdin:
        job = Job(*json.loads(line))
        key = job[:3]
        if key not in known:
            known.clear()
            known[key] = make(load_task(job.task), assets=job.assets, physics=job.physics)
        env = known[key]
        ways = {name: parse(data, name) for name, data in load_strategies(job.task).items()}
        # Once before: the first episode with an object pays for its files.
        run(env, chain(load_task(job.task), ways, env.profile), seed=job.seed, record=True)
        begin = time.process_time()
        result = run(env, chain(load_task(job.task), ways, env.profile), seed=job.seed, record=True)
        cpu = time.process_time() - begin
        states, actions = result.recording.env_states, result.recording.actions
        told = {"states": digest(states), "actions": digest(actions), "episode": result.episode.to_dict(), "cpu_s": cpu}
        answers.write(json.dumps(told) + "\n")
        answers.flush()


def digest(tree: Any) -> str:
    """Return the digest of nested arrays: names, types, shapes and bytes."""
    import numpy as np

    found = hashlib.sha256()
    if isinstance(tree, dict):
        for name in sorted(tree):
            found.update(f"{name}:{digest(tree[name])};".encode())
    else:
        array = np.ascontiguousarray(tree)
        found.update(f"{array.dtype}{array.shape}".encode() + array.tobytes())
    return found.hexdigest()


# ------------------------------------------------------------------- the comparison


class Tree:
    """A process of one tree."""

    def __init__(self, python: str) -> None:
        self._process = subprocess.Popen(
            [python, str(Path(__file__).resolve()), "--serve"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )

    def run(self, job: Job) -> dict[str, Any]:
        """Return the answer for one episode."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(json.dumps(job) + "\n")
        self._process.stdin.flush()
        line = self._process.stdout.readline()
        if not line:
            raise SystemExit(f"a tree came to an end at {job}")
        answer: dict[str, Any] = json.loads(line)
        return answer

    def close(self) -> None:
        """End the process."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait()


def differences(before: Any, after: Any, path: str = "") -> list[str]:
    """Return the fields in which two records differ, those that are ``NAMED`` apart."""
    if isinstance(before, dict) and isinstance(after, dict):
        names = sorted({*before, *after})
        missing = object()
        return [
            each
            for name in names
            for each in differences(before.get(name, missing), after.get(name, missing), f"{path}.{name}".lstrip("."))
        ]
    for pattern, words in NAMED.items():
        if _matches(path, pattern) and (words is ANY or words.get(before) == after):
            return []
    return [] if before == after else [path]


def _matches(path: str, pattern: str) -> bool:
    parts, wanted = path.split("."), pattern.split(".")
    return len(parts) == len(wanted) and all(w in ("*", p) for p, w in zip(parts, wanted, strict=True))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("before", help="interpreter of the tree before")
    parser.add_argument("after", nargs="?", default=sys.executable, help="interpreter of the tree after")
    parser.add_argument("--assets", help="folder of real objects; generated ones alone where it is not given")
    parser.add_argument("--episodes", type=int, default=2, help="of each task, physics and kind of objects")
    parser.add_argument("--tasks", nargs="*")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    from gensim2.core.seeding import scene_seeds
    from gensim2.tasks.library import task_names

    jobs = [
        Job(name, assets, physics, seed)
        for name in options.tasks or task_names("paper")
        for assets in ("builtin", *([options.assets] if options.assets else []))
        for physics, count in (("ours", options.episodes), ("original", max(options.episodes // 2, 1)))
        for seed in scene_seeds(7, name, "same_episodes", count)
    ]
    trees = Tree(options.before), Tree(options.after)
    rows: list[dict[str, Any]] = []
    for number, job in enumerate(jobs):
        answers: dict[int, dict[str, Any]] = {}
        for index in (0, 1) if number % 2 else (1, 0):
            answers[index] = trees[index].run(job)
        before, after = answers[0], answers[1]
        differing = [name for name in ("states", "actions") if before[name] != after[name]]
        differing += differences(before["episode"], after["episode"])
        rows.append({**job._asdict(), "differs": differing, "held": after["episode"]["held"]})
        rows[-1] |= {"cpu_before_s": before["cpu_s"], "cpu_after_s": after["cpu_s"]}
        print(f"{number + 1}/{len(jobs)} {job.task} {job.physics} {job.seed}: {differing or 'same'}", flush=True)
    for tree in trees:
        tree.close()
    spent = [sum(row[name] for row in rows) for name in ("cpu_before_s", "cpu_after_s")]
    same = sum(not row["differs"] for row in rows)
    print(f"{same} of {len(rows)} episodes are the same bit for bit; {sum(row['held'] for row in rows)} held")
    print(f"CPU: {spent[0]:.1f} s before, {spent[1]:.1f} s after, {spent[1] / spent[0]:.3f}")
    if options.json:
        options.json.write_text(json.dumps({"rows": rows, "same": same, "cpu_ratio": spent[1] / spent[0]}, indent=1))
    sys.exit(same < len(rows))


if __name__ == "__main__":
    if "--serve" in sys.argv:
        serve()
    else:
        main()
