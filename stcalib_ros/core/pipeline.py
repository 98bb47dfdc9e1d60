"""The calibration, from a recording to poses and clocks: a sequence of stages.

Each stage is a function of immutable records. `run_stages` names them in their order, and keeps
what each of them found.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import replace

from stcalib_ros.core.control import Control, Progress
from stcalib_ros.core.integration.exclusions import Exclusions, largest_group
from stcalib_ros.core.lifting.input_checks import Selection, require_usable, select_cameras
from stcalib_ros.core.lifting.input_screening import ScreenedInput, screen_input
from stcalib_ros.core.lifting.views import LiftedViews, lift_views
from stcalib_ros.core.methods import METHODS
from stcalib_ros.core.model.calibration import Calibration, Insufficient
from stcalib_ros.core.model.recording import Recording
from stcalib_ros.core.model.relative_pose import RelativePose
from stcalib_ros.core.model.rig import Rig
from stcalib_ros.core.options import Options
from stcalib_ros.core.output.assemble import failed_calibration, make_calibration
from stcalib_ros.core.output.own_clocks import by_own_clocks
from stcalib_ros.core.output.world_frame import WorldAlignment, place
from stcalib_ros.core.registration.resampling import common_grid
from stcalib_ros.core.solution import CalibrationProblem
from stcalib_ros.core.stages import Stages
from stcalib_ros.core.validation.verdict import Solution, judge


def calibrate(
    recording: Recording,
    options: Options | None = None,
    *,
    progress: Progress | None = None,
    cancelled: Callable[[], bool] | None = None,
    adjusted: Callable[[float], None] | None = None,
    executor: Executor | None = None,
) -> Calibration:
    """Calibrate cameras from the people that they see.

    Parameters
    ----------
    recording : Recording
    options : Options, optional
    progress : callable, optional
        Called with the name of the stage and the fraction of it that is done.
    cancelled : callable, optional
        Asked between steps; the calibration ends when it returns true.
    adjusted : callable, optional
        Called with the root mean square reprojection error so far, px, as soon as there is one
        and after every further round of the adjustment.
    executor : concurrent.futures.Executor, optional
        Registers the pairs of cameras; the numbers are the same with any. Default: this thread.

    Returns
    -------
    Calibration
        With a status other than ``OK`` where the data does not carry a calibration; its
        message says why.

    Raises
    ------
    InputError
        The reference camera, the joint layouts or every CameraInfo cannot be used.
    CalibrationError
        A worker of the executor was lost.
    Cancelled
        `cancelled` returned true.

    Examples
    --------
    >>> import stcalib_ros as st
    >>> scene = st.simulate(st.SceneOptions(n_cameras=3, n_people=2, n_frames=180))
    >>> calibration = st.calibrate(scene.recording, st.Options(offset_range_s=0.5))
    >>> calibration.status.name, [camera.name for camera in calibration.cameras]
    ('OK', ['cam0', 'cam1', 'cam2'])
    """
    return run_stages(
        recording,
        options,
        progress=progress,
        cancelled=cancelled,
        adjusted=adjusted,
        executor=executor,
    ).calibration


def run_stages(
    recording: Recording,
    options: Options | None = None,
    *,
    progress: Progress | None = None,
    cancelled: Callable[[], bool] | None = None,
    adjusted: Callable[[float], None] | None = None,
    executor: Executor | None = None,
) -> Stages:
    """Calibrate like `calibrate`, and return what every stage found.

    Examples
    --------
    >>> import stcalib_ros as st
    >>> scene = st.simulate(st.SceneOptions(n_cameras=3, n_people=2, n_frames=180))
    >>> stages = st.run_stages(scene.recording, st.Options(offset_range_s=0.5))
    >>> [camera.name for camera in stages.lifted], stages.calibration.status.name
    (['cam0', 'cam1', 'cam2'], 'OK')
    """
    options = options or Options()
    control = Control(progress, cancelled, adjusted)
    reference = require_usable(recording, options)
    method = METHODS[options.registration.method]

    control.tick("checking the input", 0.0)
    screened = screen_input(recording, options)
    views = lift_views(screened.recording, options)
    hypotheses: tuple[RelativePose, ...] = ()
    rigs: tuple[Rig, ...] = ()
    try:
        selection = select_cameras(views.lifted, reference, options, screened.faults)
        problem = make_problem(views, selection, options, control, executor)
        pairs = method.register(problem)
        problem = replace(problem, views=pairs.views or views)
        hypotheses = pairs.hypotheses
        group, exclusions = largest_group(problem.exclusions, problem.cameras, hypotheses)
        rigs = method.integrate(problem, group, pairs)
        solution = method.adjust(problem, pairs, rigs, exclusions)
    except Insufficient as why:
        failed = _failed(recording, why, screened)
        return Stages(views.skeleton, views.lifted, hypotheses, rigs, (), failed)
    calibration, alignment = _judged(screened, problem, solution)
    return Stages(
        *(views.skeleton, solution.views.lifted, hypotheses, rigs),
        solution.iterations,
        calibration,
        alignment,
        solution.joint_covariance,
    )


def make_problem(
    views: LiftedViews,
    selection: Selection,
    options: Options,
    control: Control,
    executor: Executor | None = None,
) -> CalibrationProblem:
    """Return what the stages after lifting start from: the selected cameras on a common grid."""
    names = tuple(camera.name for camera in views.lifted)
    return CalibrationProblem(
        views,
        views,
        selection.cameras,
        Exclusions(names, options.offset_range_s, selection.rejected),
        common_grid([views.lifted[c] for c in selection.cameras]),
        options,
        control,
        executor,
    )


def _failed(recording: Recording, why: Insufficient, screened: ScreenedInput) -> Calibration:
    return failed_calibration(
        recording, why.status, (why.rejection,), why.uncalibrated, screened.remarks
    )


def _judged(
    screened: ScreenedInput, problem: CalibrationProblem, solution: Solution
) -> tuple[Calibration, WorldAlignment]:
    """Judge a solution, and express it in the unit and frame of the result."""
    views, options = solution.views, problem.options
    recording = views.recording
    alignment = place(
        recording, views.lifted, views.skeleton, solution.last, solution.covariance, options
    )
    judgement = judge(views.lifted, views.skeleton, solution, alignment.rejection)
    judgement = replace(
        judgement, remarks=(*judgement.remarks, *screened.remarks, *alignment.remarks)
    )
    calibration = make_calibration(
        recording,
        views.lifted,
        views.skeleton,
        solution.last,
        solution.covariance,
        alignment,
        judgement=judgement,
        uncalibrated=solution.exclusions.cameras,
        world_frame=options.world_frame,
    )
    return by_own_clocks(calibration, screened.shifts_s), alignment
