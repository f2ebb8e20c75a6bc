"""Limits for untrusted files of objects and robots; larger files are refused.

Limits that apply to a file format in general are in its reader: ``tree``, ``hdf5``, ``archive``, ``tensors``,
``geometry``.
"""

from __future__ import annotations

MIB = 2**20

# Folders of objects: URDF, Wavefront OBJ, info.json.
MAX_OBJECT_FILES = 20_000
MAX_OBJECT = 512 * MIB  # bytes of all files of an object
MAX_OBJECT_JSON = MIB  # bytes of one file
MAX_OBJ, MAX_MATERIALS = 32 * MIB, 4 * MIB  # bytes of one file
MAX_LOOKS = 2_000  # groups of one file: each becomes a mesh of its own
MAX_TRIANGLES = 2_000_000  # of all elements of an object
FARTHEST_VERTEX = 1e6  # units
LARGEST_VALUE = 1e6  # units or radians: squares of larger numbers would lose all digits
MAX_MIMICS = 64  # joints that mimic each other in a row
LONGEST_LINK_NAME = 100
MAX_KEYPOINTS = 256
LONGEST_TEXT = 2_000

# Logs of a robot: MCAP files.
MAX_MESSAGE = 64 * MIB
MAX_HEAD = MIB  # bytes of a message's header
MAX_CHUNK = MAX_MESSAGE + 2 * MIB  # bytes, compressed or not: a message, and the MiB that waited for it
MAX_CHANNELS = 100
MAX_CAMERA_PIXELS = 8 * MIB  # of all cameras of a log together: their rays take 500 MB of memory
MAX_JOINTS = 100
MAX_STATES = MAX_PICTURES = 2**19  # kept of a log for a calibration: at 100 a second, those of 87 minutes
MAX_POSES = 200  # read of a log for a calibration
MAX_POSE_BYTES = 1024 * MIB  # of the pictures of these poses
