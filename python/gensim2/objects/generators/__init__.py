"""Procedurally generated objects: each class builds a random blueprint, which is converted to a model."""
