"""Teach a small network to close boxes by what the planner did, and let the benchmark judge it; about three minutes."""

import sys
import tempfile
from pathlib import Path

import numpy as np
import torch
from torch import nn

import gensim2

SPEC = gensim2.ObservationSpec.of({"points": 128, "candidates": 1024})
CHUNK = 16  # actions that are foretold at once; half of them are executed before the network looks again


class Policy:
    """A controller: made with keywords, then ``reset`` and ``act``; what it sees has the names that exports have."""

    observation_spec = SPEC

    def __init__(self, weights: str) -> None:
        self.net = network()
        self.net.load_state_dict(torch.load(weights))

    def reset(self, observation, seed):
        self.plan = []

    def act(self, observation):
        if not self.plan:
            cloud, state = torch.from_numpy(observation["point_cloud"])[None], torch.from_numpy(observation["state"])
            with torch.no_grad():
                arm, grip = foretold(self.net, cloud, state[None])
            self.plan = list(torch.cat([arm, grip], -1)[0, : CHUNK // 2].numpy())
        return self.plan.pop(0)


def network():
    points = nn.Sequential(nn.Linear(6, 64), nn.LayerNorm(64), nn.GELU(), nn.Linear(64, 128), nn.LayerNorm(128))
    head = nn.Sequential(nn.Linear(128 + 9, 256), nn.GELU(), nn.Linear(256, 256), nn.GELU(), nn.Linear(256, 8 * CHUNK))
    return nn.ModuleDict({"points": points, "head": head})


def foretold(net, cloud, state):
    seen = net["points"](cloud).amax(1)
    out = net["head"](torch.cat([seen, state], -1)).unflatten(-1, (CHUNK, 8))
    return state[:, None, :7] + 0.3 * out[..., :7], out[..., 7:]  # the arm's targets relative to where it stands


if __name__ == "__main__":  # the simulator's worker processes import this file
    torch.manual_seed(0)
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(tempfile.mkdtemp()) / "run"
    gensim2.collect(["CloseBox"], episodes=50, out=folder / "data", assets="builtin")
    gensim2.render(folder / "data", spec=SPEC)
    frames = gensim2.DataSet.open(folder / "data").frames(horizon=CHUNK).torch()
    data = [torch.stack(each) for each in zip(*((f["point_cloud"], f["state"], f["action"]) for f in frames))]
    net, draw = network(), np.random.default_rng(0)
    optimizer = torch.optim.AdamW(net.parameters(), 1e-3)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, 1200)
    for step in range(1200):
        rows = draw.integers(len(frames), size=64)
        cloud, state, action = (each[rows] for each in data)
        arm, grip = foretold(net, cloud, state)
        loss = (arm - action[..., :7]).abs().mean() + 0.1 * (grip - action[..., 7:]).abs().mean()
        optimizer.zero_grad(), loss.backward(), optimizer.step(), schedule.step()
    torch.save(net.state_dict(), folder / "policy.pt")
    given = {"arguments": {"weights": str(folder / "policy.pt")}, "data": folder / "data", "assets": "builtin"}
    result = gensim2.evaluate(Policy, "CloseBox", episodes=10, videos=1, out=folder / "evaluation", **given)
    print(f"loss {loss.item():.4f}; held {result.held_mean:.2f} of 10", *result.videos["CloseBox"])
