"""Hand the matrices of a reduced model to another program, and integrate them there.

The model of open_2d.toml (a cantilever without contact) is written as plain arrays to
`out/open_2d_matrices.npz`; `scipy.io.savemat` writes the same arrays for Matlab or Octave. Then
scipy's `solve_ivp`, which knows nothing of fenicsrom, integrates

    M q'' + C q' + f0 + K q + 1/2 A q q + 1/6 B q q q = L sin(omega t)

over the first period from rest. The probe moves as in `StoredModel.simulate` with 2000 steps.
"""

from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

import fenicsrom

scene = fenicsrom.read_scene(
    Path(__file__).parent / "open_2d.toml", ["time.periods=1", "time.steps_per_period=2000"]
)
stored = fenicsrom.build_model(scene)
arrays = fenicsrom.model_arrays(stored.model)
load = scene.loads[0]


def acceleration(time: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """The acceleration q'' (n,) at a time in s."""
    outside = arrays.loads[:, 0] * load.size * np.sin(2.0 * np.pi * load.frequency * time)
    return np.linalg.solve(arrays.mass, outside - arrays.damping @ v - arrays.elastic_force(q))


def rate(time: float, state: np.ndarray) -> np.ndarray:
    """The derivative of the state [q, q'] (2 n,) by time."""
    q, v = np.split(state, 2)
    return np.concatenate([v, acceleration(time, q, v)])


motion = stored.simulate()
solution = solve_ivp(
    rate,
    (0.0, motion.time[-1]),
    np.zeros(2 * stored.size),
    method="Radau",
    t_eval=motion.time,
    rtol=1e-8,
    atol=1e-10,
)
probe = arrays.probe_offset + solution.y[: stored.size].T @ arrays.probe_rows.T
difference = np.abs(probe - motion.displacement[:, 0]).max() / np.abs(probe).max()

if __name__ == "__main__":
    Path("out").mkdir(exist_ok=True)
    np.savez("out/open_2d_matrices.npz", **arrays.asdict())
    for name, array in arrays.asdict().items():
        print(f"{name:15} {array.shape}")
    print(f"largest difference of the probe: {difference:.1e} of its displacement")
