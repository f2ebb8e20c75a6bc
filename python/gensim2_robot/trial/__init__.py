"""Run trials on a real or simulated arm as a protocol file describes, with object placements drawn from a seed, and
record the results.
"""
