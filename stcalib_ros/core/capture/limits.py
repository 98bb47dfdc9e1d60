"""Every number of `capture` that decides something: value, unit, meaning, origin."""

MAX_OUTSIDE = 0.5
"""Fraction of the size of an image. A joint that is projected further outside is not drawn: lenses
are known where there are images, and further out distortion may turn points back in. Chosen."""

SAME_PERSON = 0.25
"""Heights of a person in the image. Keypoints whose median distance from where somebody is
projected is smaller are theirs, for the residual that is shown. Chosen: as wide as a person."""

MAX_MOMENTS = 200
"""Times of a recording among which the one to draw is chosen, count. Chosen: a second's work."""
