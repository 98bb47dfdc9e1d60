"""The frames of videos of the cameras of a bag, by the clocks of these cameras."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from stcalib_ros.core.geometry.interpolation import frame_period
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.recording import CameraRecording, Recording
from stcalib_ros.io.bag_origin import film_key
from stcalib_ros.io.convert_options import ConvertOptions
from stcalib_ros.io.film_files import film_id
from stcalib_ros.io.films import Film, frame_times_s, open_film

_SAME_LENGTH = 1.5
"""Periods of a camera's images in the bag. By more, its video lasts longer or less long than these.
The last image of a period may be left out, and clocks and containers round; chosen."""


@dataclass(frozen=True, slots=True)
class VideoPlaces:
    """What is known of where the images of a bag are in the videos.

    Attributes
    ----------
    origin : mapping of str to str
        What the bag was made from, as `stcalib_ros.io.bag_origin.read_origin` returns it.
    begins_s : mapping of str to float
        By camera, the time in its video at which the first image of the bag was taken, seconds
        after the first frame.
    warn : callable
        Called where the images of the bag do not account for a video.
    """

    origin: Mapping[str, str]
    begins_s: Mapping[str, float]
    warn: Callable[[str], None]


def with_frames(recording: Recording, videos: Mapping[str, Path], places: VideoPlaces) -> Recording:
    """Return a recording that has the frames of videos as images, without people.

    A video that has as many frames as the bag has images of its camera has these. Of others, frames
    have the times of the container. The first image of the bag is the first frame, unless
    `begins_s` says else, or the bag was made from this video.

    Parameters
    ----------
    recording : Recording
    videos : mapping of str to Path
        By camera; the other cameras stay as they are.
    places : VideoPlaces

    Raises
    ------
    InputError
        A video cannot be read.
    """
    cameras = (
        replace(camera, tracks=(), received=None, stamps=_stamps(camera, recording, film, places))
        if (film := videos.get(camera.name)) is not None
        else camera
        for camera in recording.cameras
    )
    return replace(recording, cameras=tuple(cameras))


def _stamps(
    camera: CameraRecording, recording: Recording, path: Path, places: VideoPlaces
) -> Float64Array:
    """Return the stamps of all frames of a video."""
    film = open_film(camera.name, path)
    frames_s = frame_times_s(film)
    if len(frames_s) == len(camera.stamps) and camera.name not in places.begins_s:
        return camera.stamps
    if (begin_s := places.begins_s.get(camera.name)) is None:
        if places.origin.get(film_key(camera.name)) == film_id(path):
            first_s = float(camera.stamps[0]) + recording.epoch_ns * 1e-9
            begin_s = _after_first_frame_s(film, frames_s, first_s)
        else:
            begin_s = 0.0
            _compare(camera, path, frames_s, places.warn)
    return np.asarray(camera.stamps[0] - begin_s + frames_s)


def _after_first_frame_s(film: Film, frames_s: Float64Array, unix_s: float) -> float:
    """Return when in a film an image was taken, by its stamp in a bag made from the film."""
    made_s = film.header.made_s
    if made_s is not None and 0.0 <= unix_s - made_s <= frames_s[-1]:
        return unix_s - made_s
    after_s = unix_s - ConvertOptions().start_s
    return after_s if 0.0 <= after_s <= frames_s[-1] else 0.0


def _compare(
    camera: CameraRecording, path: Path, frames_s: Float64Array, warn: Callable[[str], None]
) -> None:
    """Warn of a video that is longer or shorter than the images of its camera."""
    longer_s = float(frames_s[-1] - (camera.stamps[-1] - camera.stamps[0]))
    most_s = _SAME_LENGTH * frame_period(camera.stamps)
    name = camera.name
    if longer_s > most_s:
        warn(
            f"{path} is {longer_s:.2f} s longer than the images of {name} in the bag, the first of "
            f"which is taken as its first frame; if images are missing at the begin of the bag, "
            f"say for how many seconds, as in --bag-begins {name}={longer_s:.2f}"
        )
    elif longer_s < -most_s:
        warn(
            f"{path} is {-longer_s:.2f} s shorter than the images of {name} in the bag: it is cut, "
            "or that of another recording"
        )
