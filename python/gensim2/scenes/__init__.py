"""Configure and sample initial scenes, independently of the simulator."""
