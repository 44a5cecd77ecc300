"""A first picture in ParaView of this folder's series: vorticity in the sheet, and the finger.

In ParaView: paraview --script=picture.py. Without a window: pvpython picture.py picture.png
"""

import json
import sys
from pathlib import Path

from paraview import simple as pv

HERE = Path(sys.argv[0] if sys.argv[0].endswith("picture.py") else __file__).resolve().parent
_SHOWN = 0.3  # of the largest vorticity: the wall's is far above that of the vortices
INSIDE = 1e-4  # m: beside the plane of symmetry, where the mesh ends
# purple to orange, as in the reports
COLOURS = [-1.0, 0.33, 0.15, 0.53, 0.0, 0.97, 0.97, 0.97, 1.0, 0.70, 0.35, 0.02]

picture = json.loads((HERE / "picture.json").read_text())
water = pv.PVDReader(FileName=str(HERE / "water.pvd"), registrationName="water")
walls = pv.PVDReader(FileName=str(HERE / "walls.pvd"), registrationName="finger")
times = list(water.TimestepValues)
view = pv.GetActiveViewOrCreate("RenderView")
view.ViewSize = [1280, round(1280 * picture["height"] / picture["width"])]
pv.GetAnimationScene().UpdateAnimationUsingDataTimeSteps()
view.ViewTime = times[len(times) // 2]
pv.GetAnimationScene().AnimationTime = view.ViewTime

sheet = pv.Slice(Input=water, registrationName="sheet")
sheet.SliceType.Origin = [*picture["centre"], picture["sheet"] - INSIDE]
sheet.SliceType.Normal = [0.0, 0.0, 1.0]
sheet.UpdatePipeline(view.ViewTime)
lowest, highest = sheet.CellData["vorticity"].GetRange(2)
limit = _SHOWN * max(-lowest, highest) or 1.0
shown = pv.Show(sheet, view)
pv.ColorBy(shown, ("CELLS", "vorticity", "Z"))
shown.Ambient, shown.Diffuse = 1.0, 0.0  # colours as in the legend
colours = pv.GetColorTransferFunction("vorticity")
colours.AutomaticRescaleRangeMode = "Never"
colours.ColorSpace = "Lab"
colours.RGBPoints = [limit * v if k % 4 == 0 else v for k, v in enumerate(COLOURS)]
shown.SetScalarBarVisibility(view, True)
legend = pv.GetScalarBar(colours, view)
legend.Title, legend.ComponentTitle = "vorticity (1/s)", ""
legend.TitleColor = legend.LabelColor = [0.0, 0.0, 0.0]
finger = pv.Show(walls, view)
pv.ColorBy(finger, None)
finger.DiffuseColor = [0.55, 0.55, 0.55]

view.UseColorPaletteForBackground = 0
view.Background = [1.0, 1.0, 1.0]
view.OrientationAxesVisibility = 0
pv.Render(view)  # the first one shows everything: the camera comes after it
x, y = picture["centre"]
view.CameraParallelProjection = 1
view.CameraFocalPoint = [x, y, 0.0]
view.CameraPosition = [x, y, 1.0]
view.CameraViewUp = [0.0, 1.0, 0.0]
view.CameraParallelScale = picture["height"] / 2
pv.Render(view)
if sys.argv[1:]:
    pv.SaveScreenshot(sys.argv[1], view)
