"""Commands that show a run: for ParaView, and for print."""

from softfinger.options import (
    CORES,
    DEFAULT_RANKS,
    Coupled,
    Filmed,
    Level,
    Quiet,
    RankCount,
    SceneFolder,
    Switch,
    open_moved,
)


def view(
    scene: SceneFolder,
    *,
    level: Level = "coarse",
    ranks: RankCount = DEFAULT_RANKS,
    quiet: Quiet = False,
    coupled: Coupled = None,
    whole: Switch = False,
) -> None:
    """Write a run as a time series for ParaView.

    Parameters
    ----------
    coupled
        The run in which pressure and water make the motion together, or the prescribed one.
    whole
        Mirror at the planes of symmetry: the whole tank.
    """
    from pipeline.paraview.command import view as write
    from softfinger.make import Machine, make

    made = open_moved(scene, level, coupled)
    make(made, "solve", Machine(ranks, min(ranks, CORES)), quiet)
    write(made.scene, whole, quiet)


def figures(
    scene: SceneFolder,
    *,
    level: Level = "coarse",
    coupled: Coupled = None,
    piv: Filmed = None,
    ranks: RankCount = DEFAULT_RANKS,
    quiet: Quiet = False,
) -> None:
    """Write the pictures of a run's page as PDF and PNG (300 dpi), and its series as CSV.

    They are in the folder `print` of the run, as cases/single_finger/out/coarse/print.
    """
    from postprocess.evidence.stage_files import StageFiles
    from postprocess.report.figures import print_figures
    from softfinger.make import Machine, make

    made = open_moved(scene, level, coupled, piv)
    make(made, "report", Machine(ranks, min(ranks, CORES)), quiet)
    print(f"figures: {print_figures(StageFiles(made.scene))}")
