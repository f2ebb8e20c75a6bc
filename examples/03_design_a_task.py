"""Let the offline designer find a strategy for a library task, verify it in physics, and write a report."""

import sys
from pathlib import Path

import gensim2
from gensim2.core.progress import ConsoleProgress

if __name__ == "__main__":  # the simulator's worker processes import this file
    out = Path(sys.argv[1]) if len(sys.argv) > 1 else None
    with ConsoleProgress() as progress:
        result = gensim2.run_pipeline(
            target_task="PushDrawerClose",  # the designer does not see the stored solution of this task
            episodes=2,
            seed=0,
            assets="builtin",
            out=out,
            videos=0,
            progress=progress,
        )
    for task in result.tasks:
        fresh = task.verification
        print(f"{task.name}: {fresh.held}/{fresh.episodes} new episodes succeed, {task.demos} demonstrations")
    print("look at", Path(result.run_dir) / "report.html")
