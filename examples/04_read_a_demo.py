"""Record demonstrations of a task, then read actions and objects from their files with h5py and json."""

import json
import sys
import tempfile
from pathlib import Path

import h5py

import gensim2

if __name__ == "__main__":  # the simulator's worker processes import this file
    out = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(tempfile.mkdtemp()) / "run"
    result = gensim2.demo("CloseBox", episodes=2, seed=0, assets="builtin", out=out, videos=0)
    folder = Path(result.run_dir) / "tasks" / result.name

    about = json.loads((folder / "trajectory.json").read_text())
    print("environment:", about["env_info"]["env_id"])
    with h5py.File(folder / "trajectory.h5") as file:
        for episode in about["episodes"]:
            actions = file[f"traj_{episode['episode_id']}"]["actions"][:]
            box = episode["episode"]["objects"]["box"]
            moved = f"openness {box['openness_start']:.2f} to {box['openness_end']:.2f}"
            print(f"seed {episode['episode_seed']}, box {box['id']}:", actions.shape, moved)
    print(f"replay: python -m mani_skill.trajectory.replay_trajectory --traj-path {folder / 'trajectory.h5'}")
