"""Run a controller on an arm with cameras: control loop, command limits, watchdog and log (docs/guides/robot.md)."""
