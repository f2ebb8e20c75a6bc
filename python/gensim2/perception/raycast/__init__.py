"""Depth, colour and segmentation without a GPU, by casting rays from cameras at the scene's links."""
