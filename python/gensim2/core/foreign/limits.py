"""Define size limits for untrusted files of objects and robots; larger files are refused.

Limits of whole formats are in their readers: ``tree``, ``hdf5``, ``archive``, ``tensors``, ``geometry``.
"""

from __future__ import annotations

MIB = 2**20

# Limits for the folder of one object, which contains URDF, Wavefront OBJ and info.json files.
MAX_OBJECT_FILES = 20_000  # maximum number of files in the folder
MAX_OBJECT = 512 * MIB  # maximum total size of an object's files, bytes
MAX_OBJECT_JSON = MIB  # maximum size of a JSON file of an object, bytes
MAX_OBJ, MAX_MATERIALS = 32 * MIB, 4 * MIB  # maximum size of an OBJ file and of a file of materials, bytes
MAX_LOOKS = 2_000  # maximum number of materials in a mesh file; the reader makes a separate mesh for each material
MAX_TRIANGLES = 2_000_000  # maximum number of triangles in all elements of an object
FARTHEST_VERTEX = 1e6  # maximum absolute coordinate of a vertex, in units of the file
# Maximum coordinate or joint limit (file's unit or rad); squares of larger values lose precision.
LARGEST_VALUE = 1e6
MAX_MIMICS = 64  # maximum length of a chain of mimic joints
LONGEST_LINK_NAME = 100
MAX_KEYPOINTS = 256
LONGEST_TEXT = 2_000

# Limits for robot logs, which are MCAP files.
MAX_MESSAGE = 64 * MIB  # maximum size of a message, bytes
MAX_HEAD = MIB  # maximum size of a message's header, bytes
# maximum size of a chunk, bytes, before and after decompression: a message of maximum size plus a margin
MAX_CHUNK = MAX_MESSAGE + 2 * MIB
MAX_CHANNELS = 100
# Maximum number of pixels of all cameras in a log; their rays take 500 MB of memory.
MAX_CAMERA_PIXELS = 8 * MIB
MAX_JOINTS = 100
# Maximum number of arm states and of images that a calibration reads: 87 minutes at 100 states per second.
MAX_STATES = MAX_PICTURES = 2**19
MAX_POSES = 200  # maximum number of arm poses read from a log for a calibration
MAX_POSE_BYTES = 1024 * MIB  # maximum total size of the images at the arm poses of a calibration, bytes
