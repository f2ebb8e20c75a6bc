"""Calibrate cameras against the robot's meshes or a board, and store the result as a dated file."""
