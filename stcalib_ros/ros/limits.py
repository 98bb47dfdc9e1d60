"""Every number of the live side that decides something: its value, unit, meaning and origin.

Times are by this machine's steady clock unless they are said to be of stamps.
"""

from __future__ import annotations

MIN_CAMERAS = 2
"""Cameras. With fewer, no run is started and nothing is checked: a camera is calibrated against
others."""

MAX_CAMERAS = 64
"""Cameras. Parameters and results with more are refused, so that what a message or a parameter file
asks for stays bounded. Chosen, far above the rigs of the benchmarks; not measured."""

# What is accepted of a message ------------------------------------------------------------------

MAX_TEXT = 256
"""Characters. A name in a message (layout, joint, frame, camera, run) that is longer is refused, or
cut where it is only printed. ROS 2 limits topic names to about as many; otherwise chosen."""

MAX_LINE = 400
"""Characters. A warning made of what a message held is cut here, so that no sender fills the log.
Chosen: one name within `MAX_TEXT` and what is said about it fit; not measured."""

MAX_PARAMETER_TEXT = 10_000
"""Characters. A longer text is refused as the value of a parameter. A hundred distances in YAML's
short form have as many. Chosen; not measured."""

MAX_PARAMETER_VALUES = 1000
"""Values of the YAML text of a parameter, those that anchors repeat counted each time: a hundred
distances have as many. They are read within 10 ms. Chosen."""

MAX_SEQUENCE_GAP = 1_000_000
"""Messages. A jump of a publisher's sequence number that is at least so large is another publisher
and not a loss. Nine hours at 30 Hz, longer than any gap that this node would live through."""

MAX_PUBLISHERS = 8
"""Publishers of one topic, count, whose sequence numbers are followed; of more, the one that has
not sent for longest is forgotten. Chosen: two are a mistake already."""

PROBLEM_S = 60.0
"""Seconds since the last dropped message for which a camera's status is a warning: as long as the
span of the figures of load (LOAD_SPAN_S). The count stays."""

MAX_CHECKED_IMAGES = 30
"""Images. Whether keypoints can be those of people in pixels is judged by so many of the window at
most, every second. Chosen: they are either all in one unit, or none of use."""

# Images that do not continue a stream -----------------------------------------------------------

MAX_STAMP_STEP_S = 1.0
"""Seconds of stamps. An image further than this from the newest one, either way, does not continue
the stream. Chosen: above the hiccups of a busy machine; its effect is tested with simulated senders
(test/ros/test_streams.py), not verified on real drivers."""

MAX_ASIDE_STEP_S = 10.0
"""Seconds of stamps. Images that were set aside continue each other over gaps up to this, so that a
bag that is played again with losses is one stream. Chosen; not verified on real drivers."""

MAX_ASIDE_STREAMS = 3
"""Streams. So many that do not continue the camera's are kept beside it; with one more the shortest
is dropped. They share the memory of the camera (`Limits.max_mb`), a third each, so that strangers
cannot exhaust it: two strangers, and the camera itself after a change. Chosen."""

QUIET_S = 1.0
"""Seconds. Another stream replaces the camera's only if nothing has come of the latter for this
long: a camera that is sending cannot be displaced. Chosen: ten periods at 10 Hz."""

CONFIRMING_IMAGES = 10
"""Images. So many must continue each other before they replace what is there, so that no single
message empties a buffer. Chosen: a third of a second at 30 Hz."""

LENS_QUIET_S = 3.0
"""Seconds. Another CameraInfo counts if the one in force has not come for this long. Chosen: three
periods of a driver that repeats it every second; most send it with every image."""

MAX_OTHER_LENSES = 3
"""CameraInfos. So many that differ from the one in force are kept until it is clear which one is
the camera's; as `MAX_ASIDE_STREAMS`."""

# Where every person has a topic of their own -----------------------------------------------------

GATHER_S = 0.5
"""Seconds of stamps. An image is complete when a person of one so much newer has come: a pose
estimator takes the persons of an image one after the other. Chosen; not verified on real nodes."""

MAX_GATHERED = 100
"""Images. So many wait at most for their other persons; of more, the oldest is taken as it is.
Chosen: `GATHER_S` at 200 Hz."""

# Whether it is worth a calibration --------------------------------------------------------------

SAMPLE_S = 0.5
"""Seconds of stamps. Images this far apart are compared to see whether somebody moves: about one
step of a walking person, whose displacement is far above the noise of keypoints. Chosen."""

MAX_SAMPLE_GAP_S = 1.5
"""Seconds of stamps. Over a longer gap no motion is counted, as it is not known when it happened.
Derived: three times `SAMPLE_S`."""

MIN_MOTION = 0.05
"""Fraction of the height of a person in the image. A median displacement of the keypoints within
`SAMPLE_S` above this counts as moving: 9 cm for an adult. Noise of 3 px per axis alone reaches it
at a height of 100 px (3 sqrt(2) times 1.18, the Rayleigh median, is 5 px). The limit below which
the calibration itself refuses (core/lifting) is lower, 0.03: that one is compared with the range of
smoothed keypoints over a whole recording and decides whether anybody moves at all, this one with
two single images, and it decides when to calibrate unasked. Not verified on real recordings."""

MIN_MOVING_JOINTS = 3
"""Joints. The displacement of a person is the median of at least so many: the fewest of which one
outlier does not decide. Derived."""

GATHERING_S = 3.0
"""Seconds of stamps. A camera that saw motion within this and has not enough of it yet is waited
for. Chosen: short beside `min_motion_s`; not measured."""

# What is shown ----------------------------------------------------------------------------------

GRID_COLUMNS, GRID_ROWS = 8, 6
"""Cells of an image, count, of which is shown whether the window has seen people there: squares of
an image of 4:3, and of 60 px where it has 640 x 480, about a head at 3 m. Chosen."""

SHOWN_HZ = 5.0
"""Hertz. People move this often in RViz and Foxglove, and in so many images a second it is shown
which keypoints are theirs. Enough to follow a walk; of 4 cameras and 3 people, each message takes
10 ms of CPU. Chosen."""

SIGHT_S = 2.0
"""Seconds of stamps. People are triangulated from so much at a time: at least a slot of the
association (1.7 s), which compares whole strides. Chosen."""

SIGHT_EVERY_S = 1.0
"""Seconds of stamps. From one such look to the next; with `SIGHT_S`, half of each is known from the
one before, so that people keep their numbers. Chosen: 4 cameras and 3 people take 0.1 s of CPU a
look, while somebody has subscribed, for which messages have to wait."""

MAX_DELAY_S = 2.0
"""Seconds. People are shown no later than this behind the newest look. Chosen: two looks."""

SAME_PERSON = 0.3
"""Fraction of the extent of a body, half a metre. People of two looks whose joints are nearer at
the same times are the same: both see the same images then, and two people are rarely so close."""

TRACK_MEMORY_S = 10.0
"""Seconds. So long the number of a person is kept by their id in a camera while they are not
triangulated, as when only one camera sees them. Chosen."""

VIEW_PEOPLE_S = 10.0
"""Seconds of stamps. People who are shown are collected so long, once for each calibration, before
they say where up and the floor is: leaning forward cancels as far as they have turned. Chosen."""

MIN_LEVEL = 1e-3
"""Length of a horizontal direction, or of the mean of unit vectors, count. Below it there is none:
the camera looks straight down, or cameras contradict each other. Numerical."""

MAX_MISSED_WIDTH = 0.05
"""Fraction of the width of an image, 32 px of 640. Persons of an image whose keypoints are further
(median) from where somebody in 3D projects to are not that person. Chosen: above the errors of a
camera that has moved a little, whose residuals are to be seen."""

HOLD_S = 0.5
"""Seconds. So long before and after the part of a look in which a person is triangulated they stay
where they were: the filters at its ends leave out some samples, and the next look has them. Chosen:
half of `SIGHT_EVERY_S`."""

GONE_S = 1.0
"""Seconds. Lifetime of what moves: it disappears that long after the last message. Chosen: five
periods of `SHOWN_HZ`."""

# The watch --------------------------------------------------------------------------------------

LATE_S = 3.0
"""Seconds of stamps. Images that come up to this much later than those of other cameras are waited
for; a camera further behind or ahead raises the alarm that its stamps are off. Chosen: above the
latency of pose estimators that keep up; not verified on real recordings."""

ARRIVING_S = 1.5
"""Seconds. A camera of which nothing has come for longer is not waited for by the watch. Chosen."""

BACKWARDS_S = 1.0
"""Seconds of stamps. If the newest images are older than what was looked at by more than this, time
has started again, as with a bag that is played in a loop. Chosen."""

# Warnings ---------------------------------------------------------------------------------------

STARVED_S = 5.0
"""Seconds. A camera or topic of which nothing came for so long is reported as starved. Chosen:
above what discovery takes; not measured."""

REPEAT_S = 5.0
"""Seconds. A warning about one subject is repeated no sooner; the log stays readable."""

ASIDE_WARN_S = 2.0
"""Seconds. Images that were set aside are reported after so long: by then a camera that has changed
is known as such (`QUIET_S` and `CONFIRMING_IMAGES` at 10 Hz), and all cameras of a bag that begins
again have done so."""

REPEAT_RESTART_S = 300.0
"""Seconds. A warning that time begins again is repeated no sooner: a bag of 10 s that is played in
a loop all day gives one line every five minutes."""

REPEAT_STARVED_S = 30.0
"""Seconds. The same for a camera or topic that is starved, which can last for hours."""

# Periods and patience ---------------------------------------------------------------------------

CHECK_S = 1.0
"""Seconds. Diagnostics are published, and it is considered whether to calibrate, this often: the
usual rate of /diagnostics."""

SAVE_AGAIN_S = 10.0
"""Seconds. A calibration that could not be saved is saved again after so long: writing takes up to
a second for 64 cameras. Chosen."""

DRIVER_S = 5.0
"""Seconds. A driver that has not answered ``set_camera_info`` by then is reported: it may have died
meanwhile. camera_info_manager answers as soon as its file is written. Chosen; not measured."""

LOOK_S = 0.5
"""Seconds. The relay looks this often for publishers of its topics and for their reliability."""

LOAD_SPAN_S = 60.0
"""Seconds. Delays and durations on /diagnostics are those of the last so many."""

SOLVER_MB = 1000
"""Megabytes. The solver's process may take so much beside the images that it is given; with more,
the run fails and says so. Simulated runs take 60 MB (4 cameras, 3 people, 10 s), 150 MB (8 cameras,
5 people, 30 s), 170 MB (3 cameras, 12 people, 30 s): measured as the growth of VmData."""

PAIR_MB = 4
"""Megabytes. What each pair of cameras adds to `SOLVER_MB`, so that large rigs are not refused: 12
cameras and 6 people took 245 MB in 30 s, 3.7 MB for each of their 66 pairs."""

STOP_S = 1.0
"""Seconds. A run is given this long to end when the node stops; then the process leaves it. Below
the 5 s that launch waits between SIGINT and SIGTERM."""

SPIN_S = 0.2
"""Seconds. SIGINT and SIGTERM are acted on within this."""

WAIT_S = 5.0
"""Seconds. ``replay --play`` waits at most this long for subscriptions by default."""

LINGER_S = 0.5
"""Seconds. After the last message the player stays this long, for it to arrive before the process
ends."""
