"""A model without any file: the geometry from gmsh in memory, the scene from a Python table.

An L-shaped bracket of steel, 10 mm thick, is clamped at the end of one leg. The other end is shaken
along x, pressed on a floor with 50 N, and rubs on this floor.
"""

import gmsh

import fenicsrom

LEG, WIDTH = 0.4, 0.03  # m

gmsh.initialize(interruptible=False)
gmsh.option.setNumber("General.Terminal", 0)
gmsh.model.add("bracket")
corners = [(0, 0), (WIDTH, 0), (WIDTH, LEG - WIDTH), (LEG, LEG - WIDTH), (LEG, LEG), (0, LEG)]
points = [gmsh.model.geo.addPoint(x, y, 0.0, 0.02) for x, y in corners]
lines = [gmsh.model.geo.addLine(a, b) for a, b in zip(points, points[1:] + points[:1], strict=True)]
surface = gmsh.model.geo.addPlaneSurface([gmsh.model.geo.addCurveLoop(lines)])
gmsh.model.geo.synchronize()
gmsh.model.addPhysicalGroup(2, [surface], name="solid")
gmsh.model.addPhysicalGroup(1, [lines[0]], name="foot")
gmsh.model.addPhysicalGroup(1, [lines[3]], name="root")
gmsh.model.mesh.generate(2)
mesh = fenicsrom.mesh_from_gmsh_model(dimension=2)
gmsh.finalize()

table = {
    "geometry": {"mesh": "bracket.msh", "dimension": 2, "thickness": 0.01},
    "material": {"young": 207e9, "poisson": 0.28, "density": 7801.0, "mass_damping": 20.0},
    "supports": [{"group": "root"}],
    "loads": [{"group": "foot", "direction": [1.0, 0.0], "force": 60.0, "frequency": 20.0}],
    "contacts": [
        {
            "group": "foot",
            "normal": [0.0, -1.0],
            "preload": 50.0,
            "friction": 0.4,
            "normal_stiffness": 1e6,
            "tangential_stiffness": 1e6,
        }
    ],
    "basis": {"modes": 3},
    "time": {"periods": 20},
}
scene = fenicsrom.parse_scene(table, "bracket", None)
stored = fenicsrom.build_model(scene, mesh)
motion = stored.simulate()

if __name__ == "__main__":
    amplitude, share = fenicsrom.amplitudes(motion), fenicsrom.contact_fractions(motion)
    print(f"{stored.dofs} unknowns, {stored.size} coordinates: {' '.join(stored.labels)}")
    print(f"frequencies {', '.join(f'{f:.1f}' for f in stored.frequencies_hz)} Hz")
    print(f"the foot moves {1e6 * amplitude['tangential'][0]:.1f} um to each side")
    print(", ".join(f"{name} {part:.0%}" for name, part in share.items()))
