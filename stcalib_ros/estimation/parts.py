"""Poses of a film in parts on the disk, for work that was interrupted to go on."""

from __future__ import annotations

import shutil
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from stcalib_ros.core.errors import InputError
from stcalib_ros.estimation.poses import ImagePoses
from stcalib_ros.io.files import atomic_path, make_folder, write_text

_DONE = "done"


class TimedPoses(NamedTuple):
    """The persons in one image of a film, and its time after the first one, seconds."""

    stamp_s: float
    poses: ImagePoses


@dataclass(frozen=True, slots=True)
class FilmParts:
    """The poses of one film, in the order of its images; each part is written whole or not at all.

    Attributes
    ----------
    folder : Path
        Of this film with this estimator alone; made with the first part.
    """

    folder: Path

    def n_done(self) -> int:
        """Return the number of images whose poses are there."""
        return _n_images(self._files())

    def is_whole(self) -> bool:
        """Whether these are all images of the film."""
        return (self.folder / _DONE).exists()

    def finish(self) -> None:
        """Record that there are no further images."""
        make_folder(self.folder)
        write_text(self.folder / _DONE, "")

    def add(self, images: Sequence[TimedPoses]) -> None:
        """Write the next images; nothing for none.

        Raises
        ------
        InputError
            They cannot be written.
        """
        if not images:
            return
        make_folder(self.folder)
        path = self.folder / f"part_{self.n_done():08d}_{len(images)}.npz"
        with atomic_path(path) as temporary, temporary.open("wb") as stream:
            np.savez_compressed(
                stream,
                stamps=[image.stamp_s for image in images],
                counts=[len(image.poses.keypoints) for image in images],
                keypoints=np.concatenate([image.poses.keypoints for image in images]),
                scores=np.concatenate([image.poses.scores for image in images]),
                joints=np.concatenate([image.poses.joints for image in images]),
            )

    def read(self) -> list[TimedPoses]:
        """Read all images.

        Raises
        ------
        InputError
            A part is damaged.
        """
        return [image for path in self._files() for image in _images_of(path)]

    def _files(self) -> list[Path]:
        return sorted(self.folder.glob("part_*.npz"))


def _images_of(path: Path) -> list[TimedPoses]:
    try:
        with np.load(path, allow_pickle=False) as part:
            ends = np.cumsum(part["counts"])[:-1]
            columns = [np.split(part[name], ends) for name in ("keypoints", "scores", "joints")]
            stamps = part["stamps"]
    except (OSError, ValueError, KeyError) as error:
        raise InputError(f"{path} is damaged: remove it, and run the command again") from error
    return [
        TimedPoses(float(stamp), ImagePoses(*poses))
        for stamp, *poses in zip(stamps, *columns, strict=True)
    ]


def n_kept(folder: Path) -> int:
    """Return the number of images of all films whose poses are in a folder of parts."""
    return _n_images(folder.glob("*/part_*.npz"))


def remove_parts(folder: Path) -> None:
    """Remove the parts of all films, whose poses are elsewhere by now."""
    shutil.rmtree(folder, ignore_errors=True)


def _n_images(files: Iterable[Path]) -> int:
    return sum(int(path.stem.rpartition("_")[2]) for path in files)
