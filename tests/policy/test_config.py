"""Settings are validated in one place, and errors name the setting."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import click
import pytest

from gensim2.cli.train import train
from gensim2.core.errors import InputError
from gensim2.policy.config import HEADS, OF_KEYPOSES, PolicyConfig, TrainConfig, configs, read_config


def test_yaml_and_flags_are_one(tmp_path: Path) -> None:
    file = tmp_path / "policy.yaml"
    file.write_text("head: flow\nsteps: 7\nlearning_rate: 1\n")
    policy, training = read_config(file, steps=9)
    assert (policy.head, training.steps, training.learning_rate) == ("flow", 9, 1.0)
    assert configs({**policy.to_dict(), **training.to_dict()}) == (policy, training)


@pytest.mark.parametrize(
    ("given", "field"),
    [
        ({"head": "mlp"}, "head"),
        ({"history": 5}, "history"),
        ({"history": 2.5}, "history"),
        ({"colour": 1}, "colour"),
        ({"width": 90}, "width"),
        ({"execute": 99}, "execute"),
        ({"points": 0}, "points"),
        ({"ema": float("nan")}, "ema"),
        ({"learning_rate": 10**400}, "learning_rate"),
        ({"steps": True}, "steps"),
        ({"layer": 3}, "layer"),
        ({"blocks": 1}, "blocks"),
    ],
)
def test_what_cannot_be_is_refused_by_name(given: dict[str, object], field: str) -> None:
    with pytest.raises(InputError) as caught:
        configs(given, file="policy.yaml")
    assert caught.value.field == field
    assert "policy.yaml" in str(caught.value)


def test_every_setting_is_documented() -> None:
    for kind in (PolicyConfig, TrainConfig):
        for each in fields(kind):
            assert each.metadata["help"].endswith((".", "]")), each.name


def test_settings_of_keyposes_are_no_options_of_training_on_demonstrations() -> None:
    by_name = {option.name: option for option in train.params}
    assert not set(OF_KEYPOSES) & set(by_name)
    head = by_name["head"].type
    assert isinstance(head, click.Choice)
    assert list(head.choices) == [each for each in HEADS if each != "keypose"]
