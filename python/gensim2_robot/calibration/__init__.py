"""Calibrate cameras by images of the robot or of a board, and store the result in a dated file."""
