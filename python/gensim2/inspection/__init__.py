"""Whether objects are sound, and what they look like; with the simulator where it is installed."""
