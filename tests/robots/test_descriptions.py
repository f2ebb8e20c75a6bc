"""Untrusted robot descriptions: invalid URDFs are refused first by the planner's reader."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from gensim2.core.errors import InputError
from gensim2.core.foreign.geometry import read_xml
from gensim2.robots import read_description
from gensim2_kpam import UrdfError

#: Expands to 3 GB if entities are replaced.
ENTITIES = f"<!DOCTYPE robot [<!ENTITY a '{'x' * 100_000}'>]><robot name='{'&a;' * 30_000}'><link name='l'/></robot>"


def test_what_is_no_regular_file_of_bounded_size_is_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "large").touch()
    os.truncate(tmp_path / "large", 2**40)
    for read in (read_description, read_xml):
        for name, said in (("pipe", "is a pipe"), ("large", "is larger than 16 MiB"), ("gone", "No such file")):
            with pytest.raises(InputError, match=said):
                read(tmp_path / name)


@pytest.mark.parametrize("text", [ENTITIES, "<robot>" * 10_000, "<robot", "<robot name='a'/>"])
def test_what_is_no_urdf_is_one_line(tmp_path: Path, text: str) -> None:
    (tmp_path / "a.urdf").write_text(text)
    with pytest.raises(UrdfError) as refused:
        read_description(tmp_path / "a.urdf")
    assert len(str(refused.value).splitlines()) == 1


def test_xml_that_is_damaged_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "a.srdf").write_text("<robot")
    with pytest.raises(InputError, match="correct its XML"):
        read_xml(tmp_path / "a.srdf")
