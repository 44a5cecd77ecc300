"""Picture of the water's pressure and loads in the sheet, of both sources."""

import numpy as np
import xarray as xr

from piv.momentum.pressure import border_of
from postprocess.draw import pressure as draw_pressure
from postprocess.evidence.line_loads import load_table, loads_of_sheet
from postprocess.evidence.tip_vortex import rms
from postprocess.report.picture_index import Album
from postprocess.words import quantity


def pressure_figure(album: Album, measured: xr.Dataset, plane: xr.Dataset, time: float) -> None:
    """Pressure of PIV beside that of the simulation's sheet `plane` nearest to `time` (s)."""
    own = loads_of_sheet(plane, measured)
    table = load_table(measured, own)
    now = measured.sel(time=time, method="nearest")
    nearest = int(np.argmin(np.abs(plane["time"].values - float(now["time"]))))
    here, known = plane.isel(time=nearest), np.isfinite(now["p"].values)
    # one zero for both: the mean over the points at which the measured pressure's is 0
    border = known & border_of(known)
    zero = float(np.nanmean(here["p"].interp(x=now["x"], y=now["y"]).values[border]))
    planes = {"cfd": here.assign(p=here["p"] - zero), "piv": now}
    on_outline = {
        "cfd": own["p_outline"].values[nearest, 0] - zero,
        "piv": now["p_outline"].values[0],
    }
    both = table[["moment_piv", "moment_cfd"]].dropna()
    off = rms(both["moment_piv"] - both["moment_cfd"]) / rms(both["moment_cfd"])
    caption = f"At {float(now['time']):.3f} s; each is 0 on average along the edge of PIV's view. "
    caption += (
        f"The moment from PIV is {quantity(off, 'fraction')} off the same integral of the"
        " simulation's pressure (RMS over the run); its band is 95 %. "
        if np.isfinite(off)
        else "The finger leaves the view, so that its moment is not known. "
    )
    caption += "PIV has the pressure that the water's acceleration needs."
    alt = "Pressure around the finger from CFD and PIV, along its outline, and its moment."
    figure = draw_pressure.pressure_and_loads(planes, on_outline, table)
    album.add(figure, "pressure.webp", "water", alt, caption, time=float(now["time"]))
