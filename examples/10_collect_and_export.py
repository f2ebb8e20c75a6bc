"""Collect demonstrations, render their point clouds, and export them to zarr, LeRobot and ManiSkill."""

import sys
import tempfile
from pathlib import Path

import zarr

import gensim2
from gensim2.data.formats.export import export

if __name__ == "__main__":  # the simulator's worker processes import this file
    out = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(tempfile.mkdtemp()) / "run"
    gensim2.collect(["CloseBox"], episodes=2, out=out / "data", assets="builtin")
    gensim2.render(out / "data", spec=gensim2.ObservationSpec.of({"points": 128, "candidates": 1024}))

    data = gensim2.DataSet.open(out / "data")
    frames = data.frames(horizon=8)  # frames[i] has the observation and the next 8 actions
    shapes = {name: frames[3][name].shape for name in ("state", "tool_pose", "point_cloud", "action")}
    print(f"{len(frames)} frames of {shapes}; instruction: {frames[3]['language']}")

    for to in ("zarr", "lerobot", "maniskill"):
        print(f"{export(out / 'data', out / to, to)} episodes in {out / to}")
    arrays = zarr.open(out / "zarr", mode="r")["data"]
    for name in ("state", "tool_pose", "action", "point_cloud"):
        print(f"zarr: {name} {arrays[name].shape}")
