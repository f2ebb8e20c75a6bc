"""Generated objects without a joint: everyday kinds with the names, sizes and masses of the YCB set."""
