"""Drivers of arms and cameras. Each driver has its own pip extra, and none has been tested on hardware."""
