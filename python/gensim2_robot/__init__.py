"""Run a controller on an arm with cameras: limits, a watchdog, one control loop, a log (docs/guides/robot.md)."""
