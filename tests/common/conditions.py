"""The plain condition of a benchmark, as files hold it."""

PLAIN = {
    "physics": "ours",
    "robot": "panda",
    "instances": "all",
    "randomization": "paper",
    "attempts": 1,
    "open_loop": False,
    "disturbance": None,
}
