"""Provide object libraries.

The package reads GenSim2's released layout, caches prepared objects, and exports and imports objects.
"""
