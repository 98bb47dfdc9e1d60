"""``stcalib draw``: the people of a result, drawn into the films of all cameras."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from stcalib_ros.commands.film_arguments import named_path
from stcalib_ros.commands.result_and_bag import add_result_and_bag_arguments
from stcalib_ros.core.errors import InputError

if TYPE_CHECKING:
    from stcalib_ros.core.capture.reprojection import ImageOfPeople, PeopleInImages
    from stcalib_ros.core.model.calibration import Calibration
    from stcalib_ros.estimation.poses import UInt8Array
    from stcalib_ros.io.films import Film
    from stcalib_ros.report.undistort import Undistortion

# What computes is imported by the functions that need it, for `--help` to be quick.

DESCRIPTION = """\
Draw the people of a result into the images of all cameras at one time.

  stcalib draw walk.yaml walk.mcap --films cam0.mp4 cam1.mp4 cam2.mp4 --output walk.png
  stcalib draw walk.yaml walk.mcap --films cam0.mp4 cam1.mp4 cam2.mp4 --output walk_drawn.mp4
  stcalib draw walk.yaml walk.mcap --films cam0.mp4 cam1.mp4 cam2.mp4 --output walk.png --undistort

A coloured figure is a person in 3D, triangulated from all cameras and projected into each of them.
White dots are the keypoints of the pose estimator in that image. Where poses, lenses and clocks are
right, dots and figures coincide. Above each image are its camera, its time on the clock of the
reference, and the distance between dots and joints (rms).
"""

DEFAULT_DURATION_S = 5.0
"""Seconds of a film that are drawn if nothing else is said."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    add_result_and_bag_arguments(parser, "bag with the poses of the films")
    parser.add_argument(
        "--films",
        nargs="+",
        type=named_path,
        required=True,
        metavar="[CAM=]FILM",
        help="a film of each camera, named by its file unless CAM= does; or a folder with them",
    )
    parser.add_argument(
        *("-o", "--output"),
        type=Path,
        required=True,
        metavar="OUT.{png,jpg,mp4}",
        help="picture or film to write",
    )
    parser.add_argument(
        "--at",
        type=float,
        metavar="S",
        help="time of the picture, or of the start of the film, in seconds after the first image "
        "of the reference camera (default: where most joints are seen; of a film, 0)",
    )
    parser.add_argument(
        "--duration",
        type=float,
        metavar="S",
        help=f"seconds of the film (default: {DEFAULT_DURATION_S:g})",
    )
    parser.add_argument(
        "--undistort",
        action="store_true",
        help="remove the distortion of the lenses: what is straight in the room is straight in the "
        "picture where a lens is right",
    )


def run(args: argparse.Namespace) -> None:
    """Draw people.

    Raises
    ------
    InputError
        An argument or file is unusable.
    CalibrationError
        What the bag shows does not agree with the calibration.
    """
    from stcalib_ros.commands.people import captured
    from stcalib_ros.commands.terminal import tell
    from stcalib_ros.core.capture.reprojection import people_in_images
    from stcalib_ros.core.options import Options
    from stcalib_ros.io.picture_files import require_picture_writable, write_picture
    from stcalib_ros.io.results import read_usable_result

    is_film = require_picture_writable(args.output)
    if args.duration is not None and not is_film:
        raise InputError(f"--duration is for films: name one, {args.output.with_suffix('.mp4')}")
    calibration = read_usable_result(args.result)
    films = _films(args, calibration)
    recording, capture = captured(args, calibration)
    seen = people_in_images(recording, calibration, capture.people, min_score=Options().min_score)
    times_s = _times_s(args, seen, is_film)
    lenses = _undistortions(calibration, films) if args.undistort else {}
    pictures = _pictures(seen, films, times_s, lenses)
    n = write_picture(args.output, pictures, rate_hz=_rate_hz(seen))
    begin_s = times_s[0] - float(seen.times_s()[0])
    what = f"{n} images from {begin_s:.2f} s on" if is_film else f"{begin_s:.2f} s"
    tell(
        args,
        f"{len(films)} cameras at {what} are drawn in {args.output}",
        {"written": str(args.output), "cameras": list(films), "begin_s": begin_s},
    )


def _films(args: argparse.Namespace, calibration: Calibration) -> dict[str, Film]:
    from stcalib_ros.io.film_files import films_by_camera
    from stcalib_ros.io.films import open_film

    given = films_by_camera(args.films)
    known = [camera.name for camera in calibration.cameras]
    if not set(given) & set(known):
        raise InputError(
            f"the films are of {', '.join(given)}, but {args.result} has {', '.join(known)}: name "
            f"them, as in {known[0]}={next(iter(given.values())).name}"
        )
    films = {name: open_film(name, path) for name, path in given.items() if name in known}
    for camera in calibration.cameras:
        size = (camera.intrinsics.width, camera.intrinsics.height)
        if camera.name in films and films[camera.name].size != size:
            shown = films[camera.name]
            raise InputError(
                f"{shown.path} has images of {shown.size[0]} x {shown.size[1]} px, but "
                f"{args.result} is of {size[0]} x {size[1]}: give the film that was calibrated"
            )
    return films


def _times_s(args: argparse.Namespace, seen: PeopleInImages, is_film: bool) -> list[float]:
    """Return the times to draw, by the reference clock."""
    times_s = seen.times_s()
    lasts_s = float(times_s[-1] - times_s[0])
    if args.at is not None and not 0 <= args.at <= lasts_s:
        raise InputError(f"--at: expected 0 to {lasts_s:.2f} s, which is recorded, got {args.at:g}")
    if not is_film:
        return [seen.best_time_s() if args.at is None else float(times_s[0]) + args.at]
    duration_s = DEFAULT_DURATION_S if args.duration is None else args.duration
    if not duration_s > 0:
        raise InputError(f"--duration: expected seconds, got {duration_s:g}")
    first_s = float(times_s[0]) + (args.at or 0.0)
    chosen = times_s[(times_s >= first_s) & (times_s < first_s + duration_s)]
    return [float(time_s) for time_s in chosen]


def _rate_hz(seen: PeopleInImages) -> float:
    from stcalib_ros.core.geometry.interpolation import frame_period

    return 1.0 / frame_period(seen.times_s())


def _undistortions(calibration: Calibration, films: Mapping[str, Film]) -> dict[str, Undistortion]:
    from stcalib_ros.report.undistort import undistortion_of

    cameras = [camera for camera in calibration.cameras if camera.name in films]
    return {camera.name: undistortion_of(camera) for camera in cameras}


def _pictures(
    seen: PeopleInImages,
    films: Mapping[str, Film],
    times_s: Sequence[float],
    lenses: Mapping[str, Undistortion],
) -> Iterator[UInt8Array]:
    """Yield the pictures of all times, with one image of each film in memory."""
    from stcalib_ros.core.reconstruction.trajectories import bones
    from stcalib_ros.io.films import images_at
    from stcalib_ros.report.overlay import mosaic

    moments = [seen.at(time_s) for time_s in times_s]
    lines = bones(seen.people[0].layout) if seen.people else ()
    begin_s = float(seen.times_s()[0])
    images = {name: images_at(film, _stamps_s(moments, name)) for name, film in films.items()}
    for moment in moments:
        shown: list[tuple[ImageOfPeople, UInt8Array]] = []
        for one in moment:
            image = next(images.get(one.camera.name, iter(())), None)
            if image is not None:
                lens = lenses.get(one.camera.name)
                shown.append((lens.people(one), lens.image(image)) if lens else (one, image))
        if shown:
            yield mosaic(shown, lines, begin_s, list(films))


def _stamps_s(moments: Sequence[Sequence[ImageOfPeople]], camera: str) -> list[float]:
    return [one.stamp_s for moment in moments for one in moment if one.camera.name == camera]
