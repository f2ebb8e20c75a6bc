"""Physics by a name for its switches: presets, combinations, files."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import pytest

from gensim2.core.errors import InputError
from gensim2.objects import ArticulatedObject, Library, RigidObject, open_library
from gensim2.objects.types import Hulls
from gensim2.scenes import initial_state
from gensim2.scenes.physics import PRESETS, SWITCHES, physics_name, physics_switches
from gensim2.scenes.sampler import SceneSampler
from gensim2.tasks.library import load_task


def test_presets_are_called_by_their_names() -> None:
    for name, switches in PRESETS.items():
        assert physics_switches(name) == switches
        assert physics_name(name) == name
    assert physics_name("ours") == "default"
    assert PRESETS["original"].redraw == "none"


def test_every_switch_is_one_change_away_and_its_word_says_so() -> None:
    for (name, preset), (switch, values) in itertools.product(PRESETS.items(), SWITCHES.items()):
        for value in values:
            word = f"{name}+{switch}={value}"
            found = physics_switches(physics_name(word))
            assert getattr(found, switch) == value
            assert found == physics_switches(word)
            assert physics_name(word) == (name if getattr(preset, switch) == value else word)


def test_a_mixture_is_called_after_the_nearer_preset_whatever_it_was_given_as(tmp_path: Path) -> None:
    changes = ("joint_friction", "densities", "materials", "solver", "poses")
    word = "+".join(["default", *(f"{name}=original" for name in changes), "gripper=soft"])
    assert physics_name(word) == "original+redraw=placement"
    for name, text in {
        "mix.yaml": "base: original\nredraw: placement\n",
        "mix.json": '{"base": "original", "redraw": "placement"}',
        "plain.yml": "".join(f"{name}: original\n" for name in changes) + "gripper: soft\n",
    }.items():
        file = tmp_path / name
        file.write_text(text)
        assert physics_name(str(file)) == "original+redraw=placement"


@pytest.mark.parametrize(
    ("word", "message"),
    [
        ("theirs", "no physics 'theirs'"),
        ("original+grip=default", "no switch 'grip'"),
        ("original+gripper=hard", "no gripper 'hard'"),
        ("original+gripper", "no gripper ''"),
        ("", "no physics ''"),
    ],
)
def test_what_there_is_not_is_refused(word: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        physics_name(word)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("base: theirs\n", "base: no physics 'theirs'"),
        ("grip: default\n", "grip: no switch 'grip'"),
        ("solver: 3\n", "solver: no solver 3"),
        ("solver: [original]\n", "solver: no solver"),
        ("- solver\n", "must be a mapping from field names to values"),
    ],
)
def test_a_file_of_switches_is_refused_by_file_and_field(tmp_path: Path, text: str, message: str) -> None:
    file = tmp_path / "mix.yaml"
    file.write_text(text)
    with pytest.raises(InputError, match=message) as caught:
        physics_name(str(file))
    assert str(file) in str(caught.value)
    with pytest.raises(InputError, match=r"nowhere\.yaml"):
        physics_name(str(tmp_path / "nowhere.yaml"))


def test_the_first_draw_counts_where_nothing_is_drawn_again() -> None:
    """It is the same draw if it would have been kept anyway."""
    near = load_task("SecureGoldInSafe").model_dump(mode="json", by_alias=True)
    near["objects"]["gold"]["place"]["at"] = [-0.05, -0.25]
    words = ("original+redraw=placement", "original")
    again, once = (SceneSampler(near, assets="builtin", physics=word) for word in words)
    counts = []
    for seed in range(12):
        kept, first = again.sample(seed), once.sample(seed)
        counts.append(kept.draws)
        assert first.draws == 1
        same = all((kept.objects[name].position == thing.position).all() for name, thing in first.objects.items())
        assert same == (kept.draws == 1)
    assert max(counts) > 1


def test_what_has_no_room_on_its_support_is_drawn_again_even_so(monkeypatch: pytest.MonkeyPatch) -> None:
    """Such a draw cannot be simulated, and a benchmark with one would never end."""
    stand_all, left = initial_state._stand_all, [2]

    def without_room(*arguments: Any) -> Any:
        left[0] -= 1
        return None if left[0] >= 0 else stand_all(*arguments)

    monkeypatch.setattr(initial_state, "_stand_all", without_room)
    sampler = SceneSampler("SecureGoldInSafe", assets="builtin", physics="original")
    assert sampler.sample(0).draws == 3
    assert sampler.sample(0).draws == 1


def test_hulls_are_taken_as_the_physics_says() -> None:
    """Only real meshes differ; the test checks what the switch requests of the library."""
    asked = []

    class Asked(Library):  # records the requests
        def load(self, asset_class: str, instance_id: str, hulls: Hulls = "default") -> ArticulatedObject | RigidObject:
            asked.append(hulls)
            return super().load(asset_class, instance_id, hulls)

    library = open_library("builtin")
    library.__class__ = Asked
    for word, expected in (("default", "default"), ("original", "default"), ("original+hulls=original", "original")):
        asked.clear()
        SceneSampler("CloseBox", assets=library, physics=word).sample(0)
        assert set(asked) == {expected}
