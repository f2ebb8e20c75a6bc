"""The config language: valid configs load, and errors name the invalid part."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import gensim2_kpam as kpam

from .kpam_scenes import config


def broken(change: Any) -> dict[str, Any]:
    out = config()
    change(out)
    return out


@pytest.mark.parametrize(
    ("change", "field"),
    [
        (lambda c: c.update(speed=2), "speed"),
        (lambda c: c.pop("constraint_list"), "constraint_list"),
        (lambda c: c.update(constraint_list=[]), "constraint_list"),
        (lambda c: c["constraint_list"][0].update(tolerance=float("nan")), r"constraint_list\[0\].tolerance"),
        (lambda c: c["constraint_list"][0].update(tolerance="1e-4"), r"constraint_list\[0\].tolerance.*1.0e-4"),
        (lambda c: c["constraint_list"][0].update(tolerance=-1), r"constraint_list\[0\].tolerance"),
        (lambda c: c["constraint_list"][0].pop("target_keypoint_name"), r"\[0\].target_keypoint_name"),
        (lambda c: c["constraint_list"][0].update(type="glue"), r"constraint_list\[0\].type"),
        (lambda c: c["constraint_list"][1].update(target_axis=[0, 0, 0]), r"constraint_list\[1\].target_axis"),
        (lambda c: c["constraint_list"][1].update(target_axis=[0, 1]), r"constraint_list\[1\].target_axis"),
        (lambda c: c["constraint_list"][1].update(target_axis_frame="hand"), r"\[1\].target_axis_frame"),
        (lambda c: c["constraint_list"][1].update(target_inner_product=1.5), r"\[1\].target_inner_product"),
        (lambda c: c["constraint_list"][1].update(axis_to_keypoint_name="tool_head"), r"\[1\].axis_to_keypoint_name"),
        (lambda c: c.update(post_actuation_motions=[["translate_w", 1]]), r"post_actuation_motions\[0\]"),
        (lambda c: c.update(post_actuation_motions=["move-sideways"]), r"post_actuation_motions\[0\]"),
        (lambda c: c.update(post_actuation_motions=[["rotate"]]), r"post_actuation_motions\[0\]"),
        (lambda c: c.update(pre_actuation_motions=[["follow_joint", 1]]), r"pre_actuation_motions\[0\]"),
        (lambda c: c.update(pre_actuation_times=[1, 2]), "pre_actuation_times"),
        (lambda c: c.update(actuation_time=5, pre_actuation_times=[6]), "actuation_time"),
        (lambda c: c.update(gripper="ajar"), "gripper.*hold or release"),
        (lambda c: c.update(let_go=0.005), "let_go: must be 0.01 to 0.3 m"),
        (lambda c: c.update(let_go=0.31), "let_go: must be 0.01 to 0.3 m"),
        (lambda c: c.update(let_go="far"), "let_go: must be a finite number"),
        (lambda c: c.update(pre_actuation_motions=[["translate_z", -1e300]]), r"pre_actuation_motions\[0\]"),
        (lambda c: c.update(post_actuation_motions=["move-up"] * 2000), "post_actuation_motions"),
        (lambda c: c.update(constraint_list=c["constraint_list"] * 2000), "constraint_list"),
        (lambda c: c.update({1: 2}), "key 1"),
    ],
)
def test_what_is_wrong_is_named(change: Any, field: str) -> None:
    with pytest.raises(kpam.ConfigError, match=field):
        kpam.SolverConfig(broken(change))


def test_round_trip() -> None:
    settings = kpam.SolverConfig(config(gripper="grasp"))
    assert settings.gripper == "grasp"
    assert settings.to_dict() == config(gripper="grasp")
    assert pickle.loads(pickle.dumps(settings)).to_dict() == settings.to_dict()
    assert settings.let_go is None


def test_holding_and_letting_go_load() -> None:
    for word in ("hold", "release"):
        given_config = config(gripper=word, let_go=0.05)
        settings = pickle.loads(pickle.dumps(kpam.SolverConfig(given_config)))
        assert (settings.gripper, settings.let_go, settings.to_dict()) == (word, 0.05, given_config)
    assert kpam.SolverConfig(config(let_go=None)).let_go is None


def test_numpy_values_load() -> None:
    out = config()
    out["constraint_list"][1]["target_axis"] = np.array([0.0, 0.0, 1.0])
    out["constraint_list"][0]["tolerance"] = np.float64(0.001)
    assert kpam.SolverConfig(out).gripper == "open"


leaves = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8)
values = st.recursive(
    leaves, lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner, max_size=4)
)


@given(st.sampled_from(["constraint_list", "pre_actuation_motions", "gripper", "let_go", "actuation_time"]), values)
def test_no_value_does_worse_than_a_config_error(field: str, value: Any) -> None:
    given_config = config(**{field: value})
    try:
        settings = kpam.SolverConfig(given_config)
    except kpam.ConfigError:
        return
    assert settings.to_dict()["constraint_list"] == given_config["constraint_list"]
