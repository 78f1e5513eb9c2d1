"""One reduced model under many loads: how far the beam swings and when its tip lifts off.

The model of slip_liftoff_2d.toml is built once; each load is a new run of it, in a fraction of a
second. Up to 30 N the tip sticks to the wall and the amplitude is in proportion to the load. At
60 N the tip slips, and at 111 N it lifts off the wall in each period.
"""

from pathlib import Path

import fenicsrom

FORCES = (10.0, 30.0, 60.0, 111.29)  # N

scene = fenicsrom.read_scene(Path(__file__).parent / "slip_liftoff_2d.toml")
stored = fenicsrom.build_model(scene)
motions = {}
for force in FORCES:
    motions[force] = stored.with_overrides([f"loads.0.force={force}"]).simulate()
amplitudes = {
    force: fenicsrom.amplitudes(motion)["tangential"][0] for force, motion in motions.items()
}

if __name__ == "__main__":
    print("force N   amplitude mm   mm per N   open")
    for force, motion in motions.items():
        size, share = 1e3 * amplitudes[force], fenicsrom.contact_fractions(motion)["open"]
        print(f"{force:7.2f}   {size:12.3f}   {size / force:8.4f}   {share:4.0%}")
