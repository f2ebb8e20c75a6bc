"""Objects that the project makes itself: a blueprint drawn by a class, and the model that it becomes."""
