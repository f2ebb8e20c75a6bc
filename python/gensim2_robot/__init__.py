"""Run a controller on an arm with cameras, with command limits, a watchdog and a log (docs/guides/robot.md)."""
