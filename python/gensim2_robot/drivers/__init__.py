"""Drivers of arms and cameras, one extra each; none has been tried on hardware (docs/guides/robot.md)."""
