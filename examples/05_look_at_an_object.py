"""Generate a new object and print its joint, keypoints and collision shapes."""

import numpy as np

import gensim2

library = gensim2.open_library("builtin")
print("with a joint:", ", ".join(library.classes("articulated")))
print("rigid:", ", ".join(library.classes("rigid")))

drawer = library.load_articulated("drawer", "4711")  # any number up to a million
joint = drawer.joint
print(f"drawer/{drawer.id}: {drawer.mass:.2f} kg, {joint.type} joint, {joint.lower:.2f} to {joint.upper:.2f}")
for name, keypoint in drawer.keypoints.items():
    print(f"  {name} on {keypoint.link} at {np.round(keypoint.position, 3)}: {keypoint.description}")
print("convex parts:", {link: len(hulls) for link, hulls in drawer.hulls.items()})
print("URDF:", drawer.urdf.name, "mass, inertia, friction and limits included;", drawer.license)
