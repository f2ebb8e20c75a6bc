"""A few damaged exports; the script ``exports.py`` tries thousands."""

from __future__ import annotations

from pathlib import Path

import exports
import pytest

COUNT = 30


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> dict[exports.Format, Path]:
    from gensim2.rollout import worker

    exports.MODULES = ("exports", *exports.PRELOAD)
    with pytest.MonkeyPatch.context() as patch:
        for name in ("PRELOAD", "prepare", "screen_scene", "episode", "trial", "demonstrate", "record"):
            patch.setattr(worker, name, getattr(worker, name))  # remove the fake world after the exports
        return exports.prepare(Path(tmp_path_factory.mktemp("good")).resolve())


def test_damaged_exports_are_accepted_or_refused_in_one_line(good: dict[exports.Format, Path], tmp_path: Path) -> None:
    faults: list[str] = []
    tally = exports.run(False, good, range(COUNT), 7, tmp_path.resolve(), faults.append)
    assert not faults
    assert sum(tally.ended.values()) == COUNT
    for kind in exports.FORMATS:
        assert any(name.startswith(f"{kind}: refused") for name in tally.ended), kind
