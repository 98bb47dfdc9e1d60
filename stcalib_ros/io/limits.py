"""Every number of reading and writing that decides something: value, unit, meaning, origin."""

from __future__ import annotations

MAX_FILES = 1000
"""Files. Nothing is exported to a folder of the history that holds as many, so that a caller of the
service cannot fill the disk with names. Chosen; not measured."""

MAX_YAML_LENGTH = 32_000_000
"""Characters. A longer file is not read as YAML. The result of 64 cameras has 5 million: 448 x 448
numbers of 20 characters in its covariance. Chosen."""

MAX_YAML_NODES = 1_000_000
"""Values of a YAML text, those that an anchor repeats counted each time. The result of 64 cameras
has 210,000; a million are read in some seconds and 100 MB. Chosen."""

MAX_YAML_DEPTH = 20
"""Levels of lists and mappings in a YAML text. Result files, configurations and metadata of bags
have at most 8. Chosen."""

MAX_YAML_NUMBER = 64
"""Characters. A longer scalar of a YAML text is not looked at as a number: float64 has at most 24.
Chosen."""

MAX_JSON_BYTES = 1 << 30
"""Bytes. A larger JSON file is not read: AlphaPose's results of half an hour with five people have
0.4 GB. Chosen."""

MAX_NPZ_BYTES = 1 << 30
"""Bytes. An .npz file that has more when it is unpacked is not read: a million detections of 26
joints in 2D and 3D have 1.2 GB in float64, 0.6 GB in float32. Chosen."""

MAX_TABLE = 3_000_000
"""Persons times frames of a data set, for which there is one table of joints: an hour at 30 Hz with
28 people. It takes 1.8 GB. Chosen; not measured."""

MAX_KEYPOINT_PX = 1e6
"""Pixels. A keypoint that is further from the corner of its image is none. Chosen, ten times
`MAX_IMAGE_SIDE`."""

MAX_COORDINATE = 1e9
"""Pixels, or the unit of 3D poses. A coordinate of a message beyond this counts as infinite, and so
as not observed: squares of such numbers leave the range of float32. Chosen, above millimetres."""

MIN_FRAME_RATE, MAX_FRAME_RATE = 0.1, 1000.0
"""Images per second, from time lapse to high-speed cameras; others are mistakes. Chosen."""

MAX_NAME = 256
"""Characters. A name in a file (camera, frame, joint) that is longer is refused. ROS 2 limits topic
names to about as many."""

MAX_MESSAGE = 100_000
"""Characters. A text for people in a file that is longer is refused. That of 64 cameras, each left
out with a reason, has 20,000. Chosen."""

MAX_NUMBER = 1e30
"""No unit. A pose, a lens or a keypoint with a larger number is none: squares of these numbers stay
finite in float64, and the numbers in the float32 of messages. Chosen."""

MAX_TIME_S = 2.0**31 - 1.0
"""Seconds. Times and offsets that are larger do not fit into ``builtin_interfaces/Time``, whose
seconds are an int32. By definition."""

MAX_COUNT = 2**32 - 1
"""No unit. Ids and counts in messages are uint32. By definition."""

MAX_IMAGE_SIDE = 100_000
"""Pixels. An image that is wider or higher is none. Ten times the largest sensors; not measured."""

MIN_VIEW_DEG = 5.0
"""Degrees. No smaller horizontal field of view is taken from a data sheet: a person who fills it is
20 m away. Chosen."""

MAX_VIEW_DEG = 180.0
"""Degrees. No larger horizontal field of view is taken from a data sheet: keypoints are brought to
a plane before the camera. By definition of that plane."""

MAX_DISTANCE = 1e6
"""Metres, or distances of the first two cameras. Cameras are nearer to each other. Chosen."""

ROTATION_TOLERANCE = 1e-2
"""No unit: largest deviation of R R^T from the identity. Calibrations of data sets that are written
with three digits pass, what is scaled or mirrored does not. Chosen; not measured."""

PLUMB_BOB_COEFFICIENTS = 5
"""Distortion coefficients. Those of plumb_bob in OpenCV's order are k1 k2 p1 p2 k3; a longer list
is of the rational model. By definition."""

MAX_REPEATED_IDS = 0.5
"""Fraction of the images with several persons. Where an id repeats in more of them, nobody tracks
people, and ids are not used. Chosen: trackers repeat one in an image now and then at most, and an
estimator without a tracker that sends zeros does in all."""

SAME_PERSON = 0.15
"""Fraction of the height of the person in the image. A detection is of the true person whose joints
are nearest if their median distance is below this. It decides only which true identity a detection
gets. Chosen on the data sets that are read; not measured."""

MIN_COMMON_JOINTS = 4
"""Joints. A detection is compared with a true pose by at least so many. Chosen; not measured."""

MIN_BOX_OVERLAP = 0.3
"""Intersection over union. A detection is of the true person whose box overlaps best, from this on.
Chosen: boxes around keypoints are tighter than labelled ones; not measured."""

MAX_CHUNK_BYTES = 256 << 20
"""Bytes. Larger chunks of an MCAP file are not unpacked. rosbag2 writes chunks of .8 MB, the mcap
command 4 MB; one that holds a single uncompressed image of 100 megapixels has 300 MB. Chosen."""

MAX_MESSAGE_BYTES = 16 << 20
"""Bytes. A packed message that becomes longer is not unpacked: 1,000 people of 133 keypoints with
3D poses have 3.3 MB. Chosen."""

FREE_CHUNK_BYTES = 1 << 30
"""Bytes. The chunks of a file may unpack to so many, whatever its size, and to `MAX_EXPANSION` of
its size more. Chosen: a second of work."""

MAX_EXPANSION = 1000
"""Ratio of all that a file unpacks to and its size. Bags of poses have 1.2 to 3, of poses and raw
images 1 to 4; a bomb of zeros has 30,000. Chosen."""

FREE_POSE_BYTES = 32 << 20
"""Bytes. The messages that are kept may have so many, whatever the size of the file, and
`MAX_POSE_EXPANSION` of its size more. Chosen: 350,000 images without a person."""

MAX_POSE_EXPANSION = 100
"""Ratio of the messages that are kept and the size of the file. Bags of poses have 1.2 to 3, and of
images without a person 10; a bomb of equal messages has more than 1,000. Chosen."""

FREE_FILE_BYTES = 64 << 20
"""Bytes. A file that is packed as a whole may unpack to so many, whatever its size, and to
`MAX_FILE_EXPANSION` of its size more. Chosen."""

MAX_FILE_EXPANSION = 100
"""Ratio of the unpacked size of a file that is packed as a whole and its size: bags of poses have
1.2 to 3, and unpacking writes to the disk of temporary files. Chosen."""

MAX_UNSTAMPED = 0.5
"""Fraction of a camera's images. Where more have a stamp of zero, the publisher does not stamp, and
the recording is refused; fewer are those before the first /clock. Chosen."""

MAX_PADDING_BYTES = 7
"""Bytes. So many may follow the last field of a message: CDR pads to 4, some writers to 8. By
definition of the encodings."""

MAX_QUOTED = 200
"""Characters of the text of an error that others made; the rest is what they have read. Chosen."""

MAX_SOURCE_FILES = 1_000_000
"""Files of a source of poses, which has one for each image: an hour of eight cameras at 30 Hz has
864,000. Chosen; not measured."""

MAX_LABELS_BYTES = 10_000_000
"""Bytes of a file of labels of one image, of which 100 people have 60,000. Chosen."""

MAX_CSV_BYTES = 1 << 28
"""Bytes. A larger table is not read: points of three people in four cameras for ten minutes have
0.2 GB. Chosen."""
