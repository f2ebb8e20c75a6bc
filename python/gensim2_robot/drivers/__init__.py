"""Arms and cameras of makers, each behind an extra of its own; none was ever tried on hardware (docs/robot.md)."""
