"""The work of the stages that tabulate and evaluate stresses and reactions."""

from __future__ import annotations

from fenicsrom.study.stage import Run


def tabulate(run: Run) -> None:
    """Tabulate the gradients of the basis vectors; of the normal modes if there is no basis."""
    import numpy as np

    from fenicsrom.fem.body.stress_points import stress_table
    from fenicsrom.fem.solid.reaction_rows import reaction_table
    from fenicsrom.online.stress.recovery import Recovery

    study = run.study
    solid, scene = study.solid, study.scene
    vectors = np.zeros((solid.local, 0))
    if study.extended is not None:
        vectors = study.extended.vectors
    elif study.modes is not None:
        vectors = study.modes.normal
    study.tables = Recovery(
        stress_table(solid, scene, solid.equilibrium, vectors),
        reaction_table(solid, scene, vectors),
    )


def evaluate(run: Run) -> None:
    """Find the largest stresses, and the reactions."""
    from dataclasses import replace

    import numpy as np

    from fenicsrom.assess.errors.large_strains import state_warnings
    from fenicsrom.online.stress.stress_peaks import find_stresses, modal_peaks

    study = run.study
    assert study.recovery is not None
    count = 0 if study.modes is None else study.modes.normal.shape[1]
    motion = study.motions.get("reduced")
    found = find_stresses(study.recovery, study.scene, study.model, motion, count)
    if study.basis is None and study.modes is not None:
        names = study.modes.labels[:count]
        modal = modal_peaks(study.recovery.stress, study.modes.frequencies_hz, np.eye(count), names)
        found = replace(found, modes=modal)
    study.stresses = found
    study.warnings.extend(state_warnings(found, motion_only=True))
