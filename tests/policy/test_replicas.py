"""Data-parallel training: gradients equal those of the whole batch, also after a resume; errors are reported."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import made_up
import pytest
import torch
from disks import can_mount, on_disk
from test_train import Interrupting, files

from gensim2.core.errors import InputError
from gensim2.core.seeding import rng
from gensim2.policy.checkpoint import PolicyCheckpoint
from gensim2.policy.gradient_step import GradientStep, training_batch
from gensim2.policy.network import fresh_network
from gensim2.policy.replicas import Replicas
from gensim2.policy.teachers import seconds_a_step
from gensim2.policy.text import prepare
from gensim2.policy.train import train_policy


def test_gradients_are_those_of_the_whole_batch() -> None:
    config = made_up.policy(points=made_up.POINTS)
    source, training = made_up.MadeUpSource(config), made_up.training(dropout=0.0)
    table = prepare(source.sentences, config)
    network = fresh_network(config, 7, table.shape[1:], 0).train()
    devices = [torch.device("cpu")] * 2
    with Replicas(network, source, config, training, table, 2, devices) as others:
        for step in (0, 7):
            others.begin(step)
            loss = others.mean_with(GradientStep(network, source, config, training, table, 2)(step))
            mean = [parameter.grad.clone() for parameter in network.parameters() if parameter.grad is not None]
            shares = []
            for purpose in ("policy/step", "policy/step/1", "policy/step/2"):
                draw = rng(training.seed, purpose, step)
                generator = torch.Generator().manual_seed(int(draw.integers(2**62)))
                shares.append(training_batch(source, config, table, draw, 2, training, generator))
            network.zero_grad()
            whole = network.loss(
                {name: torch.cat([share[name] for share in shares]) for name in shares[0]}, torch.Generator()
            )
            whole.backward()
            assert loss == pytest.approx(float(whole.detach()), rel=1e-5)
            for mine, its in zip(mean, [p for p in network.parameters() if p.grad is not None], strict=True):
                assert torch.allclose(mine, its.grad, atol=1e-6)
            with torch.no_grad():  # other weights for the next step
                for parameter in network.parameters():
                    parameter.add_(0.01)
    assert others.cpu_s > 0


def test_a_training_on_two_goes_on_bit_for_bit_and_is_another_than_on_one(tmp_path: Path) -> None:
    config = made_up.policy(head="flow")
    source = made_up.MadeUpSource(config)
    train_policy(source, config, made_up.training(), tmp_path / "whole", device="cpu,cpu")
    with pytest.raises(KeyboardInterrupt):
        train_policy(source, config, made_up.training(), tmp_path / "parts", device="cpu,cpu", progress=Interrupting())
    train_policy(source, config, made_up.training(), tmp_path / "parts", device="cpu,cpu", resume=True)
    train_policy(source, config, made_up.training(), tmp_path / "one")
    assert files(tmp_path / "whole") == files(tmp_path / "parts")
    assert files(tmp_path / "whole") != files(tmp_path / "one")
    assert PolicyCheckpoint.load(tmp_path / "whole").training.steps == 2


NO_MEMORY = f"""
import sys
sys.path.insert(0, {str(Path(__file__).parent)!r})
import made_up
from pathlib import Path
from gensim2.core.errors import InputError
from gensim2.policy.train import train_policy

if __name__ == "__main__":
    config = made_up.policy()
    try:
        train_policy(made_up.MadeUpSource(config), config, made_up.training(), Path(sys.argv[1]), device="cpu,cpu")
    except InputError as error:
        print(error)
"""


@pytest.mark.skipif(not can_mount(), reason="mounts a file system of its own")
@pytest.mark.parametrize("mounted", ["ro", "size=4k"])
def test_two_devices_without_shared_memory_are_refused_in_one_line(mounted: str, tmp_path: Path) -> None:
    (tmp_path / "script.py").write_text(NO_MEMORY)
    command = [*on_disk(mounted, Path("/dev/shm")), sys.executable, str(tmp_path / "script.py"), str(tmp_path / "out")]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    remedy = "free memory in /dev/shm, or train on one device"
    assert done.stdout == f"device: the machine has too little shared memory ({remedy})\n"
    assert "Traceback" not in done.stderr


def test_a_replica_that_fails_says_of_what(tmp_path: Path) -> None:
    config = made_up.policy()
    source = made_up.FailsElsewhere(config)
    source.home = os.getpid()
    with pytest.raises(InputError, match="device: number 2 cannot be used: RuntimeError: CUDA out of memory"):
        train_policy(source, config, made_up.training(), tmp_path, device="cpu,cpu")


def test_a_replica_that_is_killed_ends_the_training_which_goes_on_from_there_on_one(tmp_path: Path) -> None:
    config = made_up.policy()
    source = made_up.KilledElsewhere(config)
    source.home = os.getpid()
    told = made_up.training(steps=6, save_every=100)
    with pytest.raises(InputError, match=r"device: number 2 was lost, its process ended with .*--resume"):
        train_policy(source, config, told, tmp_path, device="cpu,cpu")
    state = json.loads((tmp_path / "training" / "state.json").read_text())
    assert state["step"] == 3
    before = (tmp_path / "training" / "curves.jsonl").read_text().splitlines()
    assert train_policy(source, config, told, tmp_path, resume=True).steps == 6
    after = (tmp_path / "training" / "curves.jsonl").read_text().splitlines()
    assert len(before) == 3
    assert after[:3] == before
    assert len(after) == 6


@pytest.mark.parametrize("which", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_to_all_processes_ends_the_training_once_its_state_is_written(
    which: signal.Signals, tmp_path: Path
) -> None:
    script = tmp_path / "train.py"
    script.write_text(
        f"""import signal
import sys
# Child processes inherit ignored signals; nohup ignores SIGHUP.
signal.signal({which.value}, signal.default_int_handler if {which.value} == signal.SIGINT else signal.SIG_DFL)
sys.path.insert(0, {str(Path(made_up.__file__).parent)!r})
import made_up
from pathlib import Path
from gensim2.policy.train import train_policy

if __name__ == "__main__":
    config = made_up.policy()
    told = made_up.training(steps=100_000, save_every=100_000)
    train_policy(made_up.MadeUpSource(config), config, told, Path({str(tmp_path / "policy")!r}), device="cpu,cpu")
"""
    )
    process = subprocess.Popen([sys.executable, str(script)], start_new_session=True, stderr=subprocess.PIPE, text=True)
    curves = tmp_path / "policy" / "training" / "curves.jsonl"
    until = time.monotonic() + 120
    while not (curves.exists() and curves.read_text()):
        assert process.poll() is None
        assert time.monotonic() < until
        time.sleep(0.1)
    os.killpg(process.pid, which)
    _, errors = process.communicate(timeout=60)
    assert "was lost" not in errors
    assert json.loads((tmp_path / "policy" / "training" / "state.json").read_text())["step"] > 0


def test_the_time_of_a_step_counts_all_devices() -> None:
    config = made_up.policy()
    source, training = made_up.MadeUpSource(config), made_up.training()
    one = seconds_a_step(source, config, training)
    two = seconds_a_step(source, config, training, [torch.device("cpu")] * 2)
    assert two > one > 0  # each replica has fixed costs


@pytest.mark.parametrize(
    ("device", "message"),
    [
        ("cpu,cpu,cpu", "batch: is 4, which 3 devices cannot share"),
        ("cpu,nowhere", "device: 'nowhere' cannot be used"),
        ("cpu,meta", "device: 'cpu,meta' mixes CPU and GPU devices"),
        ("", "device: '' cannot be used"),
    ],
)
def test_devices_that_cannot_be(device: str, message: str, tmp_path: Path) -> None:
    config = made_up.policy()
    with pytest.raises(InputError, match=message):
        train_policy(made_up.MadeUpSource(config), config, made_up.training(), tmp_path, device=device)
