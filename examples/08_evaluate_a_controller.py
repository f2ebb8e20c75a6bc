"""Train a small network on demonstrations of CloseBox, then evaluate it. Arguments: [FOLDER] [EPISODES]."""

import sys
from pathlib import Path

import torch
from torch import nn

import gensim2

SPEC, CHUNK = gensim2.ObservationSpec.of({"points": 128, "candidates": 1024}), 16  # CHUNK: predicted actions


class Net(nn.Module):
    def __init__(self):
        super().__init__()
        self.points = nn.Sequential(nn.Linear(6, 64), nn.LayerNorm(64), nn.GELU(), nn.Linear(64, 128))
        self.head = nn.Sequential(nn.Linear(137, 256), nn.GELU(), nn.Linear(256, 256), nn.GELU(), nn.Linear(256, 128))

    def forward(self, cloud, state):
        out = self.head(torch.cat([self.points(cloud).amax(1), state], -1)).unflatten(-1, (CHUNK, 8))
        return torch.cat([state[:, None, :7] + 0.3 * out[..., :7], out[..., 7:]], -1)  # relative to the current joints


class Policy:
    observation_spec = SPEC

    def __init__(self, weights):
        self.net = Net()
        self.net.load_state_dict(torch.load(weights))

    def reset(self, observation, seed):
        self.plan = []

    def act(self, observation):
        if not self.plan:  # the network predicts again after half of a chunk
            seen = (torch.from_numpy(observation[name])[None] for name in ("point_cloud", "state"))
            self.plan = list(self.net(*seen)[0, : CHUNK // 2].detach().numpy())
        return self.plan.pop(0)


if __name__ == "__main__":  # the simulator's worker processes import this file
    torch.manual_seed(0)
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else "runs/taught")
    episodes = int(sys.argv[2]) if len(sys.argv) > 2 else 50
    gensim2.collect(["CloseBox"], episodes=episodes, out=folder / "data", assets="builtin")
    gensim2.render(folder / "data", spec=SPEC)
    frames = gensim2.DataSet.open(folder / "data").frames(horizon=CHUNK).torch()
    data = [torch.stack([each[name] for each in frames]) for name in ("point_cloud", "state", "action")]
    optimizer = torch.optim.AdamW((net := Net()).parameters(), 1e-3)
    for _ in range(24 * episodes):
        rows = torch.randint(len(frames), (64,))
        cloud, state, action = (each[rows] for each in data)
        net.zero_grad()
        (net(cloud, state) - action).abs().mean().backward()
        optimizer.step()
    torch.save(net.state_dict(), weights := str(folder / "policy.pt"))
    given = {"arguments": {"weights": weights}, "data": folder / "data", "assets": "builtin", "videos": 1}
    result = gensim2.evaluate(Policy, "CloseBox", episodes=max(2, episodes // 5), out=folder / "evaluation", **given)
    print(f"CloseBox: {result.held_mean:.2f} held, trained on {len(frames)} frames", *result.videos["CloseBox"])
