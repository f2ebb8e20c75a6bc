"""The stages: each fills in a prompt, and reads and validates the answer."""
