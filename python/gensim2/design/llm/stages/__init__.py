"""The stages of a language-model design; each fills in a prompt, then reads and validates the answer."""
