"""Run trials on a real or simulated arm by a protocol, with seeded placements, and record the results."""
