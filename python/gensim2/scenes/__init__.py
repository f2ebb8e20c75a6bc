"""Initial scenes and their configuration, independent of the simulator."""
