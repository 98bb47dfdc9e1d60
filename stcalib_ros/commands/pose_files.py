"""Poses in the files of other programs, read as the arguments say."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from stcalib_ros.commands.pose_file_arguments import ESTIMATOR_OPTIONS, refuse_options
from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.recording import Recording
from stcalib_ros.io.convert import recording_of_arrays
from stcalib_ros.io.convert_options import ConvertOptions
from stcalib_ros.io.datasets import DATASETS
from stcalib_ros.io.formats import FORMATS, recognise
from stcalib_ros.io.lens_files import lenses_of
from stcalib_ros.io.npz_files import read_npz
from stcalib_ros.io.sources import SourceOptions, part_of_source, read_source
from stcalib_ros.io.sources.recording import recording_of_source
from stcalib_ros.io.sources.tables import with_stamps
from stcalib_ros.io.sources.videos import with_videos


def format_of(source: Path, given: str | None) -> str:
    """Return the format of a source: the given one, or what its content shows.

    Raises
    ------
    InputError
        There is no such format, or the content has none of them.
    """
    if given is not None and given not in FORMATS:
        raise InputError(f"--format {given}: there are {', '.join(FORMATS)}")
    return given or recognise(source)


def read_pose_files(
    name: str,
    source: Path,
    args: argparse.Namespace,
    options: ConvertOptions,
    lenses: Path | None,
) -> Recording:
    """Read what a pose estimator wrote, or multi-view arrays, without their truth.

    Parameters
    ----------
    name : str
        Of the format.
    source : Path
    args : Namespace
        Arguments of `add_pose_file_arguments`.
    options : ConvertOptions
    lenses : Path or None
        File or folder of lenses, which take precedence over those of the source.

    Raises
    ------
    InputError
        It is a data set, or the files or an argument are unusable.
    """
    if name in DATASETS:
        raise InputError(
            f"{source} is a data set ({name}): `stcalib convert {source} OUT.mcap` makes it a bag"
        )
    if name == "npz":
        recording = recording_of_arrays(source, read_arrays(source, args, lenses), options)
        if not any(camera.tracks for camera in recording.cameras):
            raise InputError(
                f"{source} has nobody in any image: check that the pose estimator saw the people"
            )
        return recording
    wanted = args.cameras.split(",") if args.cameras else None
    poses = part_of_source(read_source(name, source), wanted, None)
    if args.videos is not None:
        poses = replace(poses, cameras=with_videos(poses.cameras, args.videos))
    if args.stamps is not None:
        poses = with_stamps(poses, args.stamps)
    names = [camera.name for camera in poses.cameras]
    sizes = {camera.size for camera in poses.cameras}
    size = args.image_size or (sizes.pop() if len(sizes) == 1 else None)
    given = {} if lenses is None else lenses_of(lenses, names, image_size=size)
    poses = part_of_source(poses, None, args.frames)
    return recording_of_source(poses, options, SourceOptions(args.image_size, given))


def read_arrays(
    source: Path, args: argparse.Namespace, lenses: Path | None
) -> dict[str, NDArray[Any]]:
    """Read multi-view arrays; parameters are those of `read_pose_files`.

    Raises
    ------
    InputError
        The file or an argument is unusable.
    """
    why = f"is for other formats, but {source} is read as npz"
    refuse_options(args, ("cameras", "frames", *ESTIMATOR_OPTIONS), why)
    if lenses is not None:
        raise InputError(f"--intrinsics {lenses} {why}, which has its own (K, dist) or none")
    return read_npz(source)
