"""Initial scenes: their configuration and what is drawn for them; knows no simulator."""
