"""Generated rigid objects: everyday items with the names, sizes and masses of the YCB set."""
