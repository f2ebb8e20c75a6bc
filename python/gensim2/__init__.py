"""Articulated objects in, verified manipulation tasks and demonstrations out."""
