"""Trials on a real or simulated arm by protocols: seeded placements, results, causes of failure, a table."""
