"""Design with a language model in stages. Each stage fills in a prompt, then parses and validates the answer."""
