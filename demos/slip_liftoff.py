"""The scene slip_liftoff_2d.toml, stage by stage: every line is one of the program's nouns."""

from pathlib import Path

from mpi4py import MPI

from fenicsrom.fem.mesh import build_mesh
from fenicsrom.fem.solid import solid_of
from fenicsrom.online.measures import amplitudes, contact_fractions
from fenicsrom.online.simulate import simulate
from fenicsrom.reduction.modes import component_modes
from fenicsrom.reduction.stages import choose, differentiate, enrich, reduce
from fenicsrom.scene import read_scene

scene = read_scene(Path(__file__).parent / "slip_liftoff_2d.toml")
mesh = build_mesh(scene.geometry, MPI.COMM_WORLD)
solid = solid_of(scene, mesh)  # mass, stiffness about the equilibrium, its one factorisation
modes = component_modes(solid, scene.basis)
selection = choose(solid, scene, modes)  # a linear transient with friction, ten nonlinear statics
derivatives = differentiate(solid, scene.basis, modes, selection.derivatives)
basis = enrich(solid, modes, selection, derivatives)
model = reduce(solid, scene.basis, basis)  # the exact polynomial of the elastic force
motion = simulate(model, scene)

if __name__ == "__main__":
    amplitude, fraction = amplitudes(motion), contact_fractions(motion)
    print(f"{basis.size} coordinates: {' '.join(basis.labels)}")
    print(
        f"tip amplitude {1e3 * amplitude['tangential'][0]:.2f} mm across, {1e3 * amplitude['normal']:.3f} mm along the beam"
    )
    print(f"open {fraction['open']:.0%} of the period, slipping {fraction['slip']:.0%}")
