"""The plain condition of a benchmark, as it is written in files."""

PLAIN = {
    "physics": "ours",
    "robot": "panda",
    "instances": "all",
    "randomization": "paper",
    "attempts": 1,
    "open_loop": False,
    "disturbance": None,
}
