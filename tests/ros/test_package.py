"""The ROS 2 package has the files that ament expects."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree
from distutils.core import run_setup
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[2] / "plugins/gensim2_ros"


def test_setup_installs_code_index_and_manifest(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(PACKAGE)
    built = run_setup("setup.py", stop_after="init")
    root = ElementTree.parse(PACKAGE / "package.xml").getroot()
    assert (root.findtext("name"), root.findtext("version")) == ("gensim2_ros", built.get_version())
    assert root.findtext("export/build_type") == "ament_python"
    assert built.packages == ["gensim2_ros"]
    assert dict(built.data_files) == {
        "share/ament_index/resource_index/packages": ["resource/gensim2_ros"],
        "share/gensim2_ros": ["package.xml"],
    }
    assert all((PACKAGE / file).is_file() for _, files in built.data_files for file in files)
    assert built.entry_points == {"console_scripts": ["planner = gensim2_ros.node:main"]}
    assert "def main(" in (PACKAGE / "gensim2_ros/node.py").read_text(encoding="utf-8")


def test_the_manifest_names_every_ros_package_that_the_code_uses() -> None:
    root = ElementTree.parse(PACKAGE / "package.xml").getroot()
    sources = "".join(path.read_text(encoding="utf-8") for path in (PACKAGE / "gensim2_ros").glob("*.py"))
    made = set(re.findall(r'make\(\s*"(\w+)/msg/', sources))
    imported = set(re.findall(r"^(?:from|import) (rclpy|\w+_msgs|\w+_interfaces)\b", sources, re.M))
    assert {each.text for each in root.iter("exec_depend")} == made | imported
