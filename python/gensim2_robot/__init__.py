"""From a controller to an arm and its cameras: limits, a watch, one loop, a log that replays (docs/guides/robot.md)."""
