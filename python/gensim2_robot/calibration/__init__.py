"""Calibration of cameras against the robot's own meshes or a board, as a dated file."""
