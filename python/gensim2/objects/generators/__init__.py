"""Procedurally generated objects: each class draws a blueprint, which becomes a model."""
