"""Drivers of arms and cameras. Each driver has its own extra; none has been tested on hardware."""
