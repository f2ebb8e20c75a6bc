"""Drivers of arms and cameras. Each driver has a pip extra for the manufacturer's library. No driver has been tested on
hardware."""
