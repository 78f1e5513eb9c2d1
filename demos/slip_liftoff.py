"""The scene slip_liftoff_2d.toml stage by stage: from the mesh to the motion, one line each."""

from pathlib import Path

from mpi4py import MPI

import fenicsrom as fr

scene = fr.read_scene(Path(__file__).parent / "slip_liftoff_2d.toml")
mesh = fr.build_mesh(scene.geometry, MPI.COMM_WORLD)
solid = fr.solid_of(scene, mesh)  # mass, and stiffness about the equilibrium
modes = fr.component_modes(solid, scene.basis)
selection = fr.choose(solid, scene, modes)  # by a linear transient and ten nonlinear statics
derivatives = fr.differentiate(solid, scene.basis, modes, selection)
basis = fr.enrich(solid, modes, selection, derivatives)
model = fr.reduce(solid, scene.basis, basis)  # the exact polynomial of the elastic force
motion = fr.simulate(model, scene)

if __name__ == "__main__":
    amplitude, fraction = fr.amplitudes(motion), fr.contact_fractions(motion)
    print(f"{basis.size} coordinates: {' '.join(basis.labels)}")
    print(
        f"tip amplitude {1e3 * amplitude['tangential'][0]:.2f} mm across, "
        f"{1e3 * amplitude['normal']:.3f} mm along the beam"
    )
    print(f"open {fraction['open']:.0%} of the period, slipping {fraction['slip']:.0%}")
