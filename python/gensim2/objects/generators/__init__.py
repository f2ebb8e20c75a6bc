"""Procedurally generated objects: a class draws a random blueprint (geometry and joint), which becomes a model."""
