"""Drivers of arms and cameras, one extra each; none has been tested on hardware (docs/guides/robot.md)."""
