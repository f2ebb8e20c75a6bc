"""Calibrate cameras from images of the robot or of a calibration board, and store the result in a dated file."""
