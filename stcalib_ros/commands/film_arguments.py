"""What the commands that read films have in common."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from stcalib_ros import __version__
from stcalib_ros.commands.jobs import count, processes
from stcalib_ros.core.errors import InputError

if TYPE_CHECKING:
    from stcalib_ros.core.model.recording import Intrinsics, Recording

# What computes is imported by the functions that need it, for `--help` to be quick.

_DEFAULT_ESTIMATOR = "movenet"
_FLAGS = ("estimator", "input_size", "models", "fps_limit")
"""Options that say nothing about a bag."""


def named_path(text: str) -> tuple[str, Path]:
    """Return the camera, empty where none is named, and the film of an argument."""
    name, equals, path = text.partition("=")
    return (name, Path(path)) if equals and name and path and "/" not in name else ("", Path(text))


def add_film_arguments(parser: argparse._ActionsContainer) -> None:
    """Add how poses are estimated."""
    parser.add_argument(
        "--estimator",
        metavar="NAME",
        help=f"finds people in images; `stcalib models` lists them (default: {_DEFAULT_ESTIMATOR})",
    )
    parser.add_argument(
        "--input-size",
        type=count,
        metavar="PX",
        help="longer side of the images that the estimator sees: more finds smaller people, and "
        "takes longer (default: 512 for movenet and blazepose)",
    )
    parser.add_argument(
        "--models",
        type=Path,
        metavar="DIR",
        help="folder of the estimators' weights (default: where `stcalib models fetch` puts them)",
    )
    parser.add_argument(
        "--fps-limit",
        type=_rate,
        metavar="HZ",
        help="images a second of each film that are used, at most (default: 10)",
    )


def bag_of(args: argparse.Namespace) -> Path:
    """Return the bag to calibrate, made from films beside the output if these are given.

    A bag that was made of the same films in the same way is used again.

    Parameters
    ----------
    args : Namespace
        With `source`, `output`, `jobs`, `quiet`, and those of `add_film_arguments`.

    Raises
    ------
    InputError
        There are several bags, or a film or an argument is unusable.
    """
    from stcalib_ros.io.bag_origin import read_origin
    from stcalib_ros.io.film_files import films_by_camera, is_film

    given: Sequence[tuple[str, Path]] = args.source
    (name, path), *others = given
    if not (name or others or is_film(path)):
        if flag := next((flag for flag in _FLAGS if getattr(args, flag) is not None), None):
            raise InputError(f"--{flag.replace('_', '-')} is for films, but {path} is none")
        return path
    if bags := [path for _, path in given if not is_film(path)]:
        raise InputError(
            f"expected one bag, or a film of each camera: {bags[0]} is no film; where each camera "
            "has its own bag, put the files of all into one folder, and name it"
        )
    films = films_by_camera(given)
    output: Path | None = args.output
    if output is None:
        raise InputError(f"{path} is a film: add --output OUT.yaml to have it calibrated")
    bag = output.with_suffix(".mcap")
    found = read_origin(bag)
    if found == origin_of(args, films):
        if not args.quiet:
            print(f"The poses of these films are in {bag}: used as they are", file=sys.stderr)
        return bag
    if bag.exists() and not found:
        raise InputError(
            f"the poses of the films would be written to {bag}, but that is another bag: name "
            "another --output"
        )
    poses_of_films(args, films, bag)
    if not args.quiet:
        print(clocks_text(films), file=sys.stderr)
        print(f"The poses of the films are in {bag}", file=sys.stderr)
    return bag


def poses_of_films(
    args: argparse.Namespace,
    films: Mapping[str, Path],
    output: Path,
    *,
    lenses: Mapping[str, Intrinsics] | None = None,
) -> Recording:
    """Estimate the poses of films and write them as a bag, unless it is there already.

    Parameters
    ----------
    args : Namespace
        With `estimator`, `models`, `fps_limit`, `jobs` and `quiet`.
    films : mapping of str to Path
        By camera.
    output : Path
        Bag to write. Parts of it are kept beside it until it is whole.
    lenses : mapping of str to Intrinsics, optional
        By camera.

    Raises
    ------
    InputError
        A film or an argument is unusable.
    """
    from stcalib_ros.commands.terminal import FilmProgressPrinter
    from stcalib_ros.estimation.film_recording import DEFAULT_HZ, FilmOptions, read_films
    from stcalib_ros.estimation.parts import remove_parts
    from stcalib_ros.estimation.registry import load_estimator
    from stcalib_ros.io.bag_writer import write_bag

    parts = output.with_name(f"{output.stem}.parts")
    how = _estimator_text(args)
    options = FilmOptions(args.fps_limit or DEFAULT_HZ, lenses or {}, how, parts)
    name = args.estimator or _DEFAULT_ESTIMATOR
    make_estimator = partial(load_estimator, name, size=_input_size(args), folder=args.models)
    shown = FilmProgressPrinter(
        None if args.quiet else sys.stderr, len(films), verbose=args.verbose
    )
    with _kept_when_interrupted(parts), processes(min(args.jobs, len(films))) as executor:
        try:
            recording = read_films(
                films,
                make_estimator,
                options,
                executor=executor,
                progress=shown.images,
                warn=shown.warn,
            )
        finally:
            shown.close()
    write_bag(recording, output, origin=origin_of(args, films))
    remove_parts(parts)
    return recording


@contextmanager
def _kept_when_interrupted(parts: Path) -> Iterator[None]:
    """Say what is kept, once all processes have written what they had."""
    with ExitStack() as unfinished:
        unfinished.callback(_say_what_is_kept, parts)
        yield
        unfinished.pop_all()


def _say_what_is_kept(parts: Path) -> None:
    from stcalib_ros.estimation.parts import n_kept, remove_parts

    if n := n_kept(parts):
        print(
            f"stcalib: {n} images are done and kept in {parts}: the same command goes on from "
            "there",
            file=sys.stderr,
        )
    else:
        remove_parts(parts)


def origin_of(args: argparse.Namespace, films: Mapping[str, Path]) -> dict[str, str]:
    """Return what tells whether a bag was made from the same films in the same way.

    Raises
    ------
    InputError
        A film cannot be read.
    """
    from stcalib_ros.estimation.film_recording import DEFAULT_HZ
    from stcalib_ros.io.bag_origin import film_key
    from stcalib_ros.io.film_files import film_id

    how = {
        "version": __version__,
        "estimator": _estimator_text(args),
        "fps_limit": f"{args.fps_limit or DEFAULT_HZ:g}",
    }
    return how | {film_key(camera): film_id(path) for camera, path in films.items()}


def clocks_text(films: Mapping[str, Path]) -> str:
    """Say where the times of the films come from."""
    from stcalib_ros.estimation.film_recording import film_starts_s
    from stcalib_ros.io.film_header import read_film_header

    starts = film_starts_s({name: read_film_header(path) for name, path in films.items()})
    if not starts:
        return (
            "Clocks: the films do not say when they were made, and count as begun together; if "
            "they began further apart than 2 s, calibrate with --offset-range"
        )
    first_s = min(starts.values())
    when = ", ".join(f"{name} +{start_s - first_s:.0f} s" for name, start_s in starts.items())
    return (
        f"Clocks: by the times at which the films were made, to a second: {when}; if a program has "
        "written these later, calibrate with --align starts"
    )


def _estimator_text(args: argparse.Namespace) -> str:
    size = _input_size(args)
    return f"{args.estimator or _DEFAULT_ESTIMATOR}{f' {size} px' if size else ''}"


def _input_size(args: argparse.Namespace) -> int | None:
    """Return the size of the estimator's input; of an unknown one, its loading complains."""
    from stcalib_ros.estimation.registry import ESTIMATORS

    known = ESTIMATORS.get(args.estimator or _DEFAULT_ESTIMATOR)
    return args.input_size or (None if known is None else known.film_size)


def _rate(text: str) -> float:
    from stcalib_ros.io.limits import MAX_FRAME_RATE, MIN_FRAME_RATE

    try:
        rate_hz = float(text)
    except ValueError:
        rate_hz = -1.0
    if not MIN_FRAME_RATE <= rate_hz <= MAX_FRAME_RATE:
        raise argparse.ArgumentTypeError(
            f"expected images a second from {MIN_FRAME_RATE:g} to {MAX_FRAME_RATE:g}, got {text!r}"
        )
    return rate_hz
