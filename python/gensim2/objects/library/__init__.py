"""Provide object libraries: GenSim2's released layout, a cache of prepared objects, export and import."""
