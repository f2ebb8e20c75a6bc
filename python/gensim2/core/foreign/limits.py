"""Define size limits for untrusted files, most of which are larger than any real file; larger files are refused."""

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
# Maximum coordinate or joint limit, in the unit of the file or rad. The squares of larger values lose precision.
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
# Maximum number of pixels of all cameras in a log. The rays of these pixels take 500 MB of memory.
MAX_CAMERA_PIXELS = 8 * MIB
MAX_JOINTS = 100
# Maximum number of arm states and of images that a calibration reads. At 100 states per second, this is 87 minutes.
MAX_STATES = MAX_PICTURES = 2**19
MAX_POSES = 200  # maximum number of arm poses read from a log for a calibration
MAX_POSE_BYTES = 1024 * MIB  # maximum total size of the images at the arm poses of a calibration, bytes

# Limits for folders of exports, and for JSON files.
MAX_FILES = 1_000_000  # maximum number of files in an export; 10,000 episodes with images have about 140,000 files
MAX_FOLDER_DEPTH = 12  # maximum number of levels of nested folders; exports of gensim2 have 5
MAX_FILE_BYTES = 64 * 2**30  # maximum size of a file, bytes; ManiSkill stores all episodes of a task in one file
MAX_RECORD = 512 * MIB  # maximum size of one JSON file, bytes
# Maximum size of a file copied with demonstrations, bytes, which their reader limits as well.
MAX_COPIED = 1024 * MIB

# Limits for other formats.
MAX_HDF5_ARRAY = 1024 * MIB  # maximum size of one array in memory, bytes
MAX_HDF5_MEMBERS = 10_000  # maximum number of members of a group; only ManiSkill's trajectory files may have more
MAX_ARCHIVE = 256 * MIB  # maximum size of a zip archive, bytes
MAX_ENTRIES = 100_000  # maximum number of entries of a zip archive
MAX_TENSOR_HEADER = 4 * MIB  # maximum size of the header, bytes; that of a thousand tensors has about 100,000 bytes
MAX_MESH = 512 * MIB  # maximum size of a mesh and of each file that it names, bytes
MAX_ZARR_EPISODES = 10_000_000
MAX_ZARR_JSON = 64 * MIB  # maximum size of a JSON file, bytes; one file contains the instructions of all tasks
MAX_ZARR_CHUNK = 256 * MIB  # maximum uncompressed size of a chunk, bytes
MAX_ZARR_ARRAY = 1024 * MIB  # maximum size of one array of an episode, bytes
MAX_LEROBOT_INFO = 16 * MIB  # maximum size of meta/info.json, bytes
MAX_LEROBOT_ROWS = 10_000_000  # maximum number of frames in a row group, which is read as a whole
MAX_LEROBOT_GROUP = 1024 * MIB  # maximum uncompressed size of a row group, bytes
MAX_LEROBOT_TASKS = 1_000_000
MAX_STRATEGIES = 1000  # maximum number of strategy files of a task

# Limits for USD and MJCF files of objects.
MAX_USD_LAYERS = 100  # maximum number of USD files of an object
MAX_USD_PRIMS = 100_000  # maximum number of prims of a scene
MAX_MJCF_INCLUDES = 100
