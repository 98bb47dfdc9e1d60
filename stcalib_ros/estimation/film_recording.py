"""From films to a `Recording`: the poses of all images, with their times."""

from __future__ import annotations

import hashlib
import shutil
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.keypoint_layouts import Layout
from stcalib_ros.core.model.recording import (
    CameraRecording,
    Intrinsics,
    Recording,
    Track,
    unknown_intrinsics,
)
from stcalib_ros.estimation.film_poses import (
    FilmProgress,
    FilmTask,
    MakeEstimator,
    estimate_films,
)
from stcalib_ros.estimation.parts import FilmParts, TimedPoses
from stcalib_ros.estimation.poses import ImagePoses
from stcalib_ros.estimation.tracking import PersonTracker
from stcalib_ros.io.convert_options import ConvertOptions
from stcalib_ros.io.files import make_folder
from stcalib_ros.io.film_files import film_id
from stcalib_ros.io.film_header import FilmHeader
from stcalib_ros.io.films import Film, open_film
from stcalib_ros.io.messages import NS
from stcalib_ros.io.plausible import require_name

DEFAULT_HZ = 10.0
"""Images a second. Of people who walk, more cost time and say little: joints move by some cm in
between. Chosen, as the node that estimates poses has it."""
MIN_READ = 0.9
"""Fraction of the duration of a film. If the last image is earlier, something is missing: sound may
be longer than the images, but not by a tenth. Chosen."""
_STOP = "stop"


@dataclass(frozen=True, slots=True)
class FilmOptions:
    """How films become a recording.

    Attributes
    ----------
    limit_hz : float
        Images a second of each film that are used, at most.
    lenses : mapping of str to Intrinsics
        Lenses that are known, by the name of the camera.
    estimator_name : str
        Tells estimators, and their options, apart in `parts`.
    parts : Path or None
        Folder in which poses are kept, so that a second call goes on after an interruption; made if
        it is not there. None: nothing is kept.
    """

    limit_hz: float = DEFAULT_HZ
    lenses: Mapping[str, Intrinsics] = field(default_factory=dict)
    estimator_name: str = ""
    parts: Path | None = None


def read_films(
    films: Mapping[str, Path | str],
    make_estimator: MakeEstimator,
    options: FilmOptions | None = None,
    *,
    executor: Executor | None = None,
    progress: FilmProgress | None = None,
    warn: Callable[[str], None] | None = None,
) -> Recording:
    """Estimate the poses of the people in films, one of each camera.

    Images without people are part of the recording. Their times are those of the container, after
    the time at which the film was made, by its header; unless all films say it, they are taken to
    have begun at one time.

    Parameters
    ----------
    films : mapping of str to Path or str
        Film of each camera, by its name.
    make_estimator : callable
        Returns a `stcalib_ros.estimation.poses.PoseEstimator`.
    options : FilmOptions, optional
    executor : Executor, optional
        Its processes take a film each, and call `make_estimator`. Default: this process does all.
    progress : callable, optional
        Called with the images done, about how many there are, and about the seconds left (NaN:
        unknown).
    warn : callable, optional
        Called with what is wrong with a film that can still be used.

    Raises
    ------
    InputError
        A film cannot be read, or nobody is in any of them.

    Examples
    --------
    Of films that are there, with an estimator that is installed::

        from stcalib_ros.estimation.registry import load_estimator
        films = {"cam0": "cam0.mp4", "cam1": "cam1.mp4"}
        calibration = st.calibrate(st.read_films(films, load_estimator))

    Here, an estimator of one's own finds the spot in each image:

    >>> import cv2
    >>> import numpy as np
    >>> import stcalib_ros as st
    >>> from stcalib_ros.estimation.poses import ImagePoses
    >>> for name, x in (("cam0.avi", 100), ("cam1.avi", 200)):
    ...     film = cv2.VideoWriter(name, cv2.VideoWriter.fourcc(*"MJPG"), 10, (320, 240))
    ...     for k in range(20):
    ...         black = np.zeros((240, 320, 3), np.uint8)
    ...         _ = film.write(cv2.circle(black, (x + k, 90), 5, (255, 255, 255), -1))
    ...     film.release()
    >>> class Spots:
    ...     layout = st.find_layout("coco_17")
    ...
    ...     def poses(self, image):
    ...         rows, columns = np.nonzero(image[..., 1] > 128)
    ...         spot = np.array([columns.mean(), rows.mean()])
    ...         everywhere = spot + 20 * np.arange(17)[:, None] * [0, 0.1]
    ...         return ImagePoses(everywhere[None], np.ones((1, 17)), np.full((1, 17, 3), np.nan))
    >>> recording = st.read_films({"cam0": "cam0.avi", "cam1": "cam1.avi"}, Spots)
    >>> [(camera.name, len(camera.stamps), len(camera.tracks)) for camera in recording.cameras]
    [('cam0', 20, 1), ('cam1', 20, 1)]
    """
    options = options or FilmOptions()
    opened = [open_film(require_name(name, "a camera"), Path(path)) for name, path in films.items()]
    layout = make_estimator().layout
    with _folder(options.parts) as folder:
        tasks = [_task(film, options, folder) for film in opened]
        tasks[0].stop.unlink(missing_ok=True)
        estimate_films(tasks, make_estimator, executor=executor, progress=progress)
        images = [task.parts.read() for task in tasks]
    for film, found in zip(opened, images, strict=True):
        if (problem := _problem(film, found)) and warn is not None:
            warn(problem)
    if not any(len(one.poses.keypoints) for film in images for one in film):
        raise InputError(
            f"nobody was found in {', '.join(str(film.path) for film in opened)}: films have to "
            "show people at full length"
        )
    return _recording(opened, images, layout, options)


def film_starts_s(headers: Mapping[str, FilmHeader]) -> dict[str, float]:
    """Return the Unix time at which each film was made, by camera; empty unless all say it."""
    made = {camera: header.made_s for camera, header in headers.items()}
    known = {camera: made_s for camera, made_s in made.items() if made_s is not None}
    return known if len(known) == len(made) else {}


def _problem(film: Film, images: Sequence[TimedPoses]) -> str:
    """Return what is wrong with a film; empty: nothing."""
    last_s, duration_s = images[-1].stamp_s, film.header.duration_s
    if duration_s is not None and last_s < MIN_READ * duration_s:
        cause = "is cut off" if film.header.missing_bytes else "is damaged"
        return f"{film.path} {cause}: {last_s:.1f} s of {duration_s:.1f} s can be read"
    if not any(len(image.poses.keypoints) for image in images):
        return f"nobody was found in {film.path}: {film.camera} will not be calibrated"
    return ""


@contextmanager
def _folder(given: Path | None) -> Iterator[Path]:
    if given is not None:
        make_folder(given)
        yield given
        return
    temporary = Path(tempfile.mkdtemp(prefix="stcalib_films_"))
    try:
        yield temporary
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def _task(film: Film, options: FilmOptions, folder: Path) -> FilmTask:
    identity = film_id(film.path)
    what = f"{identity} {options.estimator_name} {options.limit_hz!r}"
    name = f"{film.camera}_{hashlib.sha256(what.encode()).hexdigest()[:16]}"
    return FilmTask(film, identity, FilmParts(folder / name), options.limit_hz, folder / _STOP)


def _recording(
    films: Sequence[Film],
    images: Sequence[Sequence[TimedPoses]],
    layout: Layout,
    options: FilmOptions,
) -> Recording:
    starts = film_starts_s({film.camera: film.header for film in films})
    epoch_s = int(min(starts.values(), default=ConvertOptions().start_s))
    cameras = tuple(
        _camera(film, one, layout, starts.get(film.camera, float(epoch_s)) - epoch_s, options)
        for film, one in zip(films, images, strict=True)
    )
    return Recording(cameras, epoch_s * NS)


def _camera(
    film: Film,
    images: Sequence[TimedPoses],
    layout: Layout,
    start_s: float,
    options: FilmOptions,
) -> CameraRecording:
    return CameraRecording(
        name=film.camera,
        frame_id=f"{film.camera}_optical_frame",
        intrinsics=_lens(film, options.lenses.get(film.camera)),
        layout=layout,
        stamps=start_s + np.array([image.stamp_s for image in images], dtype=np.float64),
        tracks=_tracks(images, layout),
    )


def _lens(film: Film, lens: Intrinsics | None) -> Intrinsics:
    if lens is None:
        return unknown_intrinsics(*film.size)
    if (lens.width, lens.height) != film.size:
        raise InputError(
            f"the lens of {film.camera} is for images of {lens.width} x {lens.height} px, but "
            f"{film.path} has {film.size[0]} x {film.size[1]}"
        )
    return lens


def _tracks(images: Sequence[TimedPoses], layout: Layout) -> tuple[Track, ...]:
    """Return the persons, followed from image to image."""
    tracker = PersonTracker(layout)
    seen: dict[int, list[tuple[int, ImagePoses, int]]] = {}
    for number, (stamp_s, poses) in enumerate(images):
        mended, ids = tracker.follow(stamp_s, poses)
        for row, person in enumerate(ids):
            seen.setdefault(int(person), []).append((number, mended, row))
    return tuple(
        Track(
            person,
            np.array([number for number, _, _ in rows]),
            np.stack([poses.keypoints[row] for _, poses, row in rows]),
            np.stack([poses.joints[row] for _, poses, row in rows]),
            np.stack([poses.scores[row] for _, poses, row in rows]),
        )
        for person, rows in seen.items()
    )
