"""Provide object libraries. This package reads folders in the layout of the GenSim2 release, caches objects that are
ready for simulation, and exports and imports objects.
"""
