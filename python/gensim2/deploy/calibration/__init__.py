"""Calibration of camera poses: against the robot's own meshes, or against a board; written down with its date."""
