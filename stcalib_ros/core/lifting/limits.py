"""Limits of lifting and of the checks of the input, with their origin."""

from __future__ import annotations

MIN_JOINTS = 6
"""Joints. Frames with fewer that have a keypoint and a 3D position are not lifted, and two poses
with fewer in common are not compared: root and rotation have six unknowns, and twelve coordinates
determine them twice. Derived."""

NEAREST_M = 0.3
"""Metres. A person whose joints would be closer to the plane of the camera, or behind it, is not
there. Chosen; people do not come closer to a camera that is to be calibrated."""

MAX_ROTATION = 0.3
"""rad per step. Longer rotations of a pose are cut: keypoints of a wrong person turn poses far.
Chosen on simulated scenes of benchmarks.accuracy.level; not verified on real recordings."""

KEYPOINT_SCALE = 0.02
"""Units of the plane z = 1. Scale of the robust loss: a joint error of 8 cm at 4 m. Derived from
the joint errors (30 to 60 mm) of lifters."""

ROTATION_PRIOR = 0.003
"""Squared units of the plane z = 1 per rad^2. Weight of the squared rotation of a pose; a standard
deviation of about ten degrees. Chosen on simulated scenes of benchmarks.accuracy.level; not
verified on real recordings."""

MIN_MOVEMENT = 0.03
"""Fraction of the height of the body in the image. Where no keypoints move more than this, slowly,
nobody moves, and the recording is refused: noise that remains after smoothing is below. Chosen on
simulated scenes of benchmarks.accuracy.level; not verified on real recordings."""

PERIOD_SLACK = 1.02
"""Ratio. Reading out an image may take longer than the frame period by this, since periods are
medians of stamps that may be rounded. Derived: a rounding to 1 ms at 20 to 50 Hz."""

MIN_CAMERAS = 2
"""Cameras, count. As many must be comparable. Derived: one has nothing to be calibrated against."""

MIN_DETERMINANT = 1e-6
"""Determinant of the normal equations of the root, sums of squared sines. With less all keypoints
are in one direction, and the position is not determined. Numerical."""

FACING_LIMBS = 0.8
"""Quantile, of the limbs of a person ordered by how long they appear for their length. The limb at
it counts as seen from the side: fewer would count noise, more would count limbs that point at the
camera. Chosen; on the walks of benchmarks.accuracy.level depths are right to about a tenth."""

ONE_PLACE_PX = 1.0
"""px. A pose whose keypoints are no further apart, in both axes, is that of nobody, and is left
out. Derived: keypoints have errors of pixels, so that nothing could be estimated from such a pose;
people of whom something can are tens of px tall."""

MAX_OFF_CENTRE = 0.2
"""Fraction of the size of the sensor. A camera whose principal point is further from its middle is
rejected. Measured: 16 real lenses have up to 0.05; K that is divided by the binning twice has 0.25,
K of an image of 1920 x 1080 beside a size of 1280 x 720 has 0.25, coordinates that are shares or
exchanged have 0.28 and more."""

EXPLAINED_OFF_CENTRE = 0.1
"""The same where it would be in the middle if its coordinates were exchanged, or if K were that of
an image of another size. Chosen between 0.05 of real lenses, and 0.125 of K of three quarters of
the image."""

NEAR_CENTRE = 0.03
"""Fraction of the size of the sensor. How near the middle such an explanation has to bring it.
Chosen: most real lenses are within."""

VIEW_RANGE_DEG = (3.0, 175.0)
"""Degrees. Fields of view, of the whole sensor, that a lens may have. Chosen: a long tele lens has
5; plane images of more than 150 cannot be used. K in millimetres or as a share of the size is
beyond."""

FISHEYE_DEG = 360.0
"""Degrees. The same of an equidistant lens at most, corners included: real ones have up to 250.
Derived."""

MAX_PIXEL_RATIO = 2.2
"""Ratio of fx and fy, either way. Derived: 2 where only one direction is binned; pixels are nearly
square else."""

MAX_OUTSIDE = 0.1
"""Fraction of the poses of a camera. With more that have half of their keypoints outside of the
image, keypoints and CameraInfo are of different images. Measured: none in simulated scenes and
0.0 % on real ones; chosen so that estimators that guess what the edge cuts off do no harm."""

OUTSIDE_MARGIN = 0.02
"""Fraction of the image. Keypoints are outside that are further from it. Chosen: errors of
keypoints at the edge are smaller."""

IN_CORNER = 0.52
"""Fraction of the image, in both directions. A camera all of whose keypoints are within this of
the corner at (0, 0) has those of a smaller image. Derived: usual sizes are 1/2, 1/3 and less, and
detectors go a little beyond the edge. People who walk in one half of the view fill the other
direction; on 12 real cameras and 92 simulated scenes they reach to 0.72 and more in one of them."""

FILLS_CORNER = 0.5
"""Fraction of that part. People who move through less of it in either direction may just as well
stand there. Chosen."""

MIN_POSES_PLACED = 60
"""Poses of a camera, count. With fewer nothing is said about where in the image they are. Chosen
like `MIN_TRACKED_POSES`."""

NORMALISED_PX = 2.0
"""px from the centre of the top left pixel. A camera with no keypoint beyond has them in fractions
of the image, 0..1 or -1..1, and is rejected. Derived: those of joints that are guessed outside of
the image go to about 1.5; nobody stays within two pixels of the corner of an image."""

NORMALISED_EXTENT = 0.01
"""Fraction of the image. Keypoints of such a camera are taken for fractions if half of its poses
are at least as large, else for poses that are all at one place (`ONE_PLACE_PX`). Derived: people of
whom something can be estimated are larger."""

MIN_CONTINUED = 0.7
"""Fraction of the poses of a camera. With fewer that go on from the pose before of the same id, ids
are no tracks: of two people whose ids are shuffled half go on, with a new id in every image none.
Trackers that lose somebody every 15 images keep 0.93. Chosen between."""

TRACK_JUMP = 0.4
"""Ratio to the size of a person in the image. A pose further from the one before than this, and
than `TRACK_SPEED` allows, is of somebody else. Chosen: people are usually further from each
other."""

TRACK_SPEED = 3.0
"""Sizes of a person per second. See `TRACK_JUMP`. Derived: a run of 5 m/s."""

LONGEST_BREAK_S = 0.5
"""Seconds. A track that was lost for longer, and for `LONGEST_BREAK_FRAMES`, does not go on.
Chosen, like the longest gap within which registration keeps a track."""

LONGEST_BREAK_FRAMES = 3.0
"""Frame periods. See `LONGEST_BREAK_S`: cameras of two images a second have tracks as well.
Chosen."""

MAX_ASTRAY = 0.2
"""Ratio to the size of a person in the image. Where poses are linked to tracks, one that is further
from where the track would have gone, and than `STRAY_SPEED` allows, begins another. Chosen: of
eight people who cover each other a third as many are exchanged as with `TRACK_JUMP` alone."""

STRAY_SPEED = 2.0
"""Sizes of a person per second. See `MAX_ASTRAY`. Derived: people who turn round within a
second."""

MIN_TRACKED_POSES = 60
"""Poses of a camera, count. With fewer nothing is said about its ids. Chosen: two seconds of one
person at 30 Hz."""

MAX_BODY_SIZE = 1.6
"""Ratio to the size of an adult, either way. Metric 3D poses of people who are larger, or smaller
by that, are not in metres. Chosen between: poses of half the size (0.5), in units of the trunk (2),
of the height of the body (0.58) or of millimetres, and those of lifters, 0.89 to 1.10 in simulated
scenes and in the demo recording."""

SURE_PROJECTION = 0.95
"""Correlation of keypoints with x and y of the 3D poses, median over poses. Poses with as much
project onto their keypoints; other axes have to reach it to be named. Measured: 0.956 to 1 in
scenes of benchmarks.accuracy.level with joint errors of up to 120 mm and tilts of 15 degrees, 0.99
in the demo recording; poses in other axes have at most 0.94 before, and as much as sound ones
after."""

MIN_PROJECTION = 0.75
"""Correlation as in `SURE_PROJECTION`. Poses with less are not used though no other axes fit.
Chosen below those that are tilted by 45 degrees (rms, about all axes: 0.81 to 0.96, one in twenty
less), and above poses of somebody else or in another order of joints (0.6 and less)."""

AXES_MARGIN = 1.0 / 3.0
"""Ratio of what is missing to a correlation of one. Other axes are named where they leave less than
this of what the given ones leave. Chosen between: 0.06 to 0.2 where the axes are others, 0.37 and
more where they are right and the poses are tilted by 45 degrees."""

MIN_HANDEDNESS = 0.5
"""Share of the bending of knees, elbows and toes to the wrong side, less that to the right one,
from which 3D poses are mirror images. Chosen: bodies have +0.28 (hands raised, straight legs) to +1
in simulated scenes and in the demo recording, mirrored ones the same below zero."""

MIN_COMMON_NAMES = 8
"""Joints, count. Another layout is compared by the joints that both have, and must have as many.
Chosen: the limbs have twelve."""

MIN_SAMPLED_POSES = 20
"""Poses of a camera, count. With fewer nothing is said about their axes. Chosen: medians over fewer
would hang on one or two people in one moment."""

CLOSEST_IMAGES_S = 1e-3
"""Seconds. Images are taken no closer to each other: stamps that are, are not those of exposures.
Derived: pose estimators run at 300 Hz at most."""

SHORT_INTERVAL = 0.5
"""Ratio to the mean period. Intervals below it are short, and within a bunch. Derived: jitter of a
tenth of the period makes one of 5,000."""

VERY_SHORT_INTERVAL = 0.25
"""Ratio to the mean period. See `SOME_SHORT`. Derived: jitter of a sixth of the period makes one of
1,000 intervals so short."""

SOME_SHORT = 0.02
"""Fraction of the intervals. With as many very short ones, stamps may come in bunches now and then,
and the keypoints are asked. Chosen: a buffer that is held up once in 15 s, for ten images."""

MANY_SHORT = 0.25
"""Fraction of the intervals. Stamps with as many short ones come in bunches; if they cannot be made
even, the camera is left out. Derived: bunches of two have 0.5; with fewer most stamps are right."""

EVEN_RATIO = 0.7
"""Ratio of the squared roughness of the motion of keypoints by even stamps over that by the stamps.
Below it images were taken evenly. Measured on bunches of two to five: 0.05 to 0.38 in simulated
scenes, 0.11 to 0.55 in benchmarks/data, up to 1.3 in the demo's 1.7 s, where people hardly move;
1.8 and more, mostly over 100, where a camera pauses or images are lost."""

IMPOSSIBLE_RATIO = 1.5
"""Ratio. Takes the place of `EVEN_RATIO` where images of a bunch are within `CLOSEST_IMAGES_S`,
as none are taken: below it even times are taken. Measured: see there; where a driver sends images
twice, motion by even stamps is many times as rough."""

UNEVEN_POSITION = 0.15
"""Fraction of the time from the image before to that after. Images as near to the middle by their
stamps do not show whether these are right. Chosen: a third of it for one lost image."""

MOVING_QUANTILE = 0.75
"""Quantile of the ways of keypoints. See `EVEN_RATIO`: only noise is seen of those who stand still.
Chosen."""

OVERLAP_MARGIN_S = 1.0
"""Seconds. Images are near those of another camera within twice the range of offsets and this more:
what a person is seen for at least. Chosen."""

MAX_GRID_FACTOR = 50.0
"""Ratio of the time from the first to the last image of all cameras over the time for which the
camera with most images has them. With more, images that no other camera can share, and all
but the fullest stretch, are left out. Chosen: two clips of 10 s that are 15 minutes apart have 46;
time and memory of the association grow with it."""

MIN_PERCENT = 30.0
"""Score. A camera whose largest score is between this and 100 has them in percent. Derived: scores
are 0..1, and heat maps or logits that are given instead of them reach about ten."""

MIN_REPEATED_VALUE = 0.005
"""Fraction of the keypoints of a camera. A place that as many have, to the last bit, may stand for
keypoints that were not detected. Chosen: keypoints of people who stand still repeat in whole
pixels, but by one joint at a place."""

MIN_REPEATING_JOINTS = 0.5
"""Fraction of the joints of a layout. A place within the image stands for what was not detected
where as many joints are at it at times; one at or beyond the left or upper border, where two are.
Chosen: of people in motion no two joints are often at one place."""

ONE_PLACE_FRACTION = 0.95
"""Fraction of the keypoints of a camera. Where more are at one place, nobody was detected, which is
said as such. Chosen."""

FROZEN_FRACTION = 0.9
"""Fraction of the images with persons. A camera in which more repeat the image before, to the last
bit, shows a picture that stands still. Chosen: a stream that has three times the rate of its camera
repeats two of three."""

MIN_FROZEN_IMAGES = 20
"""Images with persons, count. With fewer nothing is said about repeated ones. Chosen."""

MAX_PROPORTIONS = 0.35
"""Standard deviation of the logarithm of limb lengths over those of an adult. With more, joints may
be in the order of another layout. Chosen between: 0.03 to 0.14 in simulated scenes, to 0.29 in real
ones with hidden legs (benchmarks/data), and 0.35 to 1.4 in the order of another layout."""

ORDER_MARGIN = 0.5
"""Ratio. The joints of a camera are in the order of another layout if its proportions are off by
less than this of what those of its own layout are off by. Chosen: 0.04 to 0.4 where they are."""

MIN_LYING = 0.7
"""Cosine. People whose trunk points to the right of the image by more, from shoulders to hips,
lie with their heads to the left, as keypoints with x and y exchanged do. Chosen: 45 degrees."""

MIN_OUTSIDE = 0.02
"""Fraction of keypoints. With more beyond the right or lower border, and people who lie, x and y
may be exchanged. Chosen: estimators guess joints of people at the border beyond it."""

MAX_OUTSIDE_IF_SWAPPED = 0.2
"""Ratio. x and y are exchanged if that leaves less of the keypoints beyond the border. Chosen."""

MAX_TRUNK_BEND_RAD = 0.21
"""rad. Angle in the image between the lines from ankles to hips and from hips to shoulders up to
which somebody is upright, 12 degrees. Measured on simulated people who walk, box, jump and dance
(scenes of benchmarks.accuracy.level): with 20 degrees 1 % of the focal lengths were off by more
than three standard deviations, with 12 degrees none."""

MAX_LEG_BEND_RAD = 0.52
"""rad. Angle in the image between shank and thigh up to which a leg is straight, 30 degrees.
Measured like `MAX_TRUNK_BEND_RAD`: with 60 degrees 2 % were off by so much."""

UPRIGHT_PROPORTION = (0.35, 1.0)
"""Ratio of the trunk to the legs in the image, of people who are upright. Derived: 0.6 in an adult,
with room for cameras that look down steeply; legs of people who sit or lean towards the camera are
shorter."""

MIN_UPRIGHT_PLACES = 8
"""Places at which upright people are, count. With fewer nothing is said about the focal length.
Measured on the same scenes: of the focal lengths by 6 and more places 0.6 % were off by more than
three standard deviations, by 8 and more half as many. The demo has 3 and 4, in 1.7 s."""

MAX_POSTURE_ERROR = 1.4
"""Ratio to the errors of people who stand and walk. Where upright poses leave more, people do
something else, and nothing is said. Measured: walkers of simulated scenes and of the demo have 0.5
to 1.0, those who box, dance and jump up to 2.9; of nine focal lengths that were off by more than
35 % six were beyond."""

MIN_CAMERA_TILT_RAD = 0.1
"""rad, 6 degrees. Cameras that are tilted less do not see the focal length: its error grows as the
square of the tilt becomes small. Measured: of five simulated cameras at the height of the hips that
said something one was off by 60 %; with this one of forty says something, off by 8 %."""

NEW_PLACE = 0.25
"""Ratio to the height of the shoulders in the image, and logarithm of the ratio of such heights.
Somebody who has moved further is at another place, and leans otherwise. Chosen: half a step."""

NEW_PLACE_S = 1.0
"""Seconds. See `NEW_PLACE`: and has walked for as long. Chosen: a step of either leg."""

MAX_FOCAL_STDDEV = 0.25
"""Standard deviation of the logarithm of a focal length. With more, upright people say nothing of
it. Chosen: fields of view of 40 to 100 degrees are within 0.5 of the middle one, and with more the
error is not Gaussian."""

MAX_LOG_FOCAL = 1.4
"""Logarithm of the ratio to the focal length of the start. What is beyond is no lens. Derived:
views of 30 to 120 degrees are at 0.85 and -1.02 from the assumed one of 64 degrees."""

MIN_RECEIPT_DELAY_S = 1e-3
"""Seconds. Times of receipt that are nowhere later or earlier than stamps by as much are copies of
the stamps, as bags have that were made of files: they say nothing of clocks. Chosen: messages take
longer from a camera to a recorder."""
