"""Run trials on a real or simulated arm, and record the results. A protocol file describes the trials, and the seed
determines where the objects are placed.
"""
