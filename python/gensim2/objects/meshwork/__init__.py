"""Mesh processing: convex decomposition, overlap of two links, and free space around meshes."""
