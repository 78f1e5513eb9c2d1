"""Show in ParaView what a run of fenicsrom wrote into the folder of this file.

    paraview --script=OUT/look.py              the motion, or the first mode if there is no motion
    pvpython OUT/look.py 1V mode.png           a picture of one shape

`SHOW` below chooses what is shown: "motion", "equilibrium", the label of a mode ("1V", "1S") or of
a derivative ("1V1V"). Small displacements are drawn larger; the picture says by which factor.
"""

import sys
from pathlib import Path

from paraview import simple as pv

FOLDER = "."  # of the run
SHOW = ""  # what is shown; empty: the motion, or the first mode
SIZE = 0.1  # largest displacement that is drawn, by the length of the body
TRUE_SCALE = 0.03  # from this share of the length on, displacements are drawn as they are
CASING = 0.3  # opacity of walls and casings
STATES = {-1: "open", 0: "slip", 1: "stick"}
DISPLACEMENT, STATE = "displacement_m", "contact_state"

# ParaView, unlike pvpython, does not tell a script where it lies
folder = Path(__file__).resolve().parent if "__file__" in globals() else Path(FOLDER)
if not (folder / "results.pvd").is_file():
    sys.exit(f"{folder.resolve()}: no results.pvd; set FOLDER in look.py to the folder of the run")
given = sys.argv[1:] if Path(sys.argv[0]).name == "look.py" else []
wanted, picture = [*given, "", ""][:2]
wanted = wanted or SHOW or ("motion" if (folder / "motion").is_dir() else "1V")


def opened(name):
    """Open a series or a grid of the folder; None if it is not there."""
    places = f"{name}/{name}.pvd", f"{name}.vtu", f"{name}.pvtu", f"{name}/{name}.pvtu"
    found = [folder / place for place in places if (folder / place).is_file()]
    return pv.OpenDataFile(str(found[0])) if found else None


def vectors(source):
    """The displacements among the arrays at the points of a source."""
    source.UpdatePipeline()
    arrays = source.PointData
    return [
        each.Name
        for each in arrays
        if each.GetNumberOfComponents() == 3 and "principal" not in each.Name
    ]


def shape(label):
    """The source that holds a motion or a shape, and the name of its array."""
    found = {}
    for kind in ("motion", "equilibrium", "normal_modes", "static_modes", "derivatives"):
        source = opened(kind)
        for name in [] if source is None else vectors(source):
            found[kind if name == DISPLACEMENT else name.partition("_")[0]] = source, name
    if label not in found:
        hint = ": run with output.motion = true" if label == "motion" else ""
        sys.exit(f"{folder} does not hold {label!r}{hint}; it holds {', '.join(found)}")
    return found[label]


def largest(source, name):
    """The largest length of a vector over all instants."""
    found = 0.0
    for time in getattr(source, "TimestepValues", None) or [0.0]:
        source.UpdatePipeline(time)
        found = max(found, source.PointData[name].GetRange(-1)[1])
    return found


source, array = shape(wanted)
size = largest(source, array)
x0, x1, y0, y1, z0, z1 = source.GetDataInformation().GetBounds()
length = max(x1 - x0, y1 - y0, z1 - z0)
is_large = array == DISPLACEMENT and size > TRUE_SCALE * length
factor = 1.0 if is_large or not size else SIZE * length / size

view = pv.GetActiveViewOrCreate("RenderView")
if picture:
    view.ViewSize = [1000, 700]
view.UseColorPaletteForBackground = 0
view.Background = [1.0, 1.0, 1.0]
view.OrientationAxesVisibility = 1
warped = pv.WarpByVector(Input=source, Vectors=["POINTS", array], ScaleFactor=factor)
body = pv.Show(warped, view)
stress = "von_mises_Pa" if array == DISPLACEMENT else f"{wanted}_von_mises_Pa_per_m_sqrt_kg"
is_stressed = stress in warped.PointData.keys()
pv.ColorBy(body, ("POINTS", stress if is_stressed else array))
body.SetScalarBarVisibility(view, True)
body.RescaleTransferFunctionToDataRangeOverTime()
if hasattr(body, "NonlinearSubdivisionLevel"):
    body.NonlinearSubdivisionLevel = 2
bar = pv.GetScalarBar(pv.GetColorTransferFunction(stress if is_stressed else array), view)
unit = "Pa" if array == DISPLACEMENT else "Pa/(m sqrt(kg))"
bar.Title = f"von Mises stress, {unit}" if is_stressed else "displacement"
bar.ComponentTitle = ""
bar.Orientation, bar.WindowLocation = "Horizontal", "Lower Center"
bar.TitleColor = bar.LabelColor = [0.0, 0.0, 0.0]
bar.TitleFontSize = bar.LabelFontSize = 12

title = wanted if array == DISPLACEMENT else array.replace("_Hz", " Hz").partition("_per_")[0]
text = pv.Show(pv.Text(Text=f"{title.replace('_', ', ')}: displacement times {factor:.3g}"), view)
text.Color, text.FontSize = [0.0, 0.0, 0.0], 12
if (z1 - z0) > 1e-9 * length:
    view.CameraPosition = [x0 - length, y0 - 1.4 * length, z1 + 0.8 * length]
    view.CameraFocalPoint = [(x0 + x1) / 2, (y0 + y1) / 2, (z0 + z1) / 2]
    view.CameraViewUp = [0.0, 0.0, 1.0]
pv.ResetCamera(view)  # to the body, before its casing is shown

if wanted == "motion":
    for number in range(1, 10):
        surface = opened(f"surface_{number}")
        if surface is not None:
            wall = pv.Show(surface, view)
            wall.ColorArrayName = ["POINTS", ""]
            wall.AmbientColor = wall.DiffuseColor = [0.55, 0.6, 0.65]
            wall.Opacity = CASING
    points = opened("contact_points")
    if points is not None:
        moved = pv.WarpByVector(Input=points, Vectors=["POINTS", DISPLACEMENT], ScaleFactor=factor)
        dots = pv.Show(moved, view)
        pv.ColorBy(dots, ("POINTS", STATE))
        dots.SetRepresentationType("Points")
        dots.PointSize = 8.0
        colours = pv.GetColorTransferFunction(STATE)
        colours.InterpretValuesAsCategories = 1
        colours.Annotations = [text for k, v in STATES.items() for text in (str(k), v)]
        colours.IndexedColors = [0.75, 0.77, 0.8, 0.9, 0.62, 0.0, 0.0, 0.62, 0.45]

pv.GetAnimationScene().UpdateAnimationUsingDataTimeSteps()
pv.Render(view)
if picture:
    pv.SaveScreenshot(picture, view)
