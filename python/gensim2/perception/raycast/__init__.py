"""Render depth, colour and segmentation without a GPU, by casting rays from cameras."""
