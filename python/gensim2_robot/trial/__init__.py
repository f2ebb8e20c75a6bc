"""Trials on a real or simulated arm by protocols: seeded placements, verdicts, causes, a table."""
