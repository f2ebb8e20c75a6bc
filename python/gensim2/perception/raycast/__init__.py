"""Depth, colour and segmentation without a GPU: rays from the environment's cameras at its links."""
