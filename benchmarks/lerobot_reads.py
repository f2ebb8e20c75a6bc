"""Test an export with LeRobot's loader, editing tools and visualizer; run this script with a Python that has LeRobot.

    uv venv lerobot --python 3.11
    uv pip install --python lerobot/bin/python torch==2.13.0 torchvision torchcodec accelerate safetensors einops \\
        "datasets>=4,<5" "huggingface-hub<0.36" "packaging<26" "av<16" "gymnasium<2" "rerun-sdk<0.27" jsonlines \\
        draccus==0.10.0 deepdiff termcolor opencv-python-headless "imageio[ffmpeg]"
    uv pip install --python lerobot/bin/python --no-deps lerobot==0.4.4
    gensim2 data export runs/night --to lerobot --out runs/lerobot
    lerobot/bin/python benchmarks/lerobot_reads.py runs/lerobot

The script reads every frame (images need the FFmpeg libraries), a shuffled batch, and one episode with the visualizer.
It creates an empty data set with the same features, and a copy of the data set without the first episode. It prints the
results. The exit code is 1 if a check fails.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from pathlib import Path
from typing import Any


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    folder = parser.parse_args().folder.resolve()
    os.environ["HF_HUB_OFFLINE"] = "1"
    import torch
    from lerobot.datasets.lerobot_dataset import LeRobotDataset
    from lerobot.scripts.lerobot_dataset_viz import visualize_dataset

    dataset = LeRobotDataset("local/export", root=folder)
    print(f"{dataset.num_episodes} episodes, {len(dataset)} frames, {dataset.fps} a second")
    print(f"tasks: {list(dataset.meta.tasks.index)}")
    lengths = [0] * dataset.num_episodes
    for frame in (dataset[index] for index in range(len(dataset))):
        number = int(frame["episode_index"])
        if int(frame["frame_index"]) != lengths[number] or not torch.isfinite(frame["observation.state"]).all():
            print(f"frame {lengths[number]} of episode {number} is wrong")
            return 1
        lengths[number] += 1
    told = [dataset.meta.episodes[number]["length"] for number in range(dataset.num_episodes)]
    if lengths != told:
        print("episode lengths differ from the metadata of the data set")
        return 1
    batch = next(iter(torch.utils.data.DataLoader(dataset, batch_size=8, shuffle=True)))
    print({name: tuple(value.shape) for name, value in batch.items() if hasattr(value, "shape")})
    with tempfile.TemporaryDirectory() as out:
        shown = visualize_dataset(dataset, 0, num_workers=0, batch_size=8, save=True, output_dir=Path(out))
        print(f"visualizer: {shown.stat().st_size} bytes")
    return edited(dataset)


def edited(dataset: Any) -> int:
    """Test the editing tools, which refuse names with a slash; return 1 if a result is wrong, else 0."""
    from lerobot.datasets.dataset_tools import delete_episodes
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    with tempfile.TemporaryDirectory() as name:
        made = LeRobotDataset.create(
            "local/made", fps=dataset.fps, features=dataset.meta.features, root=Path(name) / "made"
        )
        print(f"create: {len(made.meta.features)} features")
        left = delete_episodes(dataset, [0], output_dir=Path(name) / "left", repo_id="local/left")
        print(f"delete_episodes: {left.num_episodes} episodes, {len(left)} frames")
        expected = len(dataset) - dataset.meta.episodes[0]["length"]
        if left.num_episodes != dataset.num_episodes - 1 or len(left) != expected:
            return 1
        first, same = left[0], dataset[dataset.meta.episodes[0]["length"]]
        for key, value in same.items():
            if key.startswith(("observation.", "action")) and first[key].shape != value.shape:
                print(f"{key} has a different shape")
                return 1
        if not (first["action"] == same["action"]).all():
            print("the actions differ")
            return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
