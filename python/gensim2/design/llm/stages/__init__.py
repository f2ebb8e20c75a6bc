"""The stages of designing with a language model; each fills in a prompt, then parses and validates the answer."""
