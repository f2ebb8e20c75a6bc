"""Build the ROS 2 package with colcon, or a wheel with pip."""

from setuptools import setup

NAME = "gensim2_ros"

setup(
    name=NAME,
    version="0.1.0",
    description="Motion planning for MoveIt's messages with the solver of gensim2",
    license="Apache-2.0",
    python_requires=">=3.11",
    packages=[NAME],
    install_requires=["gensim2-kpam", "numpy", "setuptools"],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
    ],
    entry_points={"console_scripts": [f"planner = {NAME}.node:main"]},
    zip_safe=True,
)
