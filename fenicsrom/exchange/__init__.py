"""Reduced models for other programs, and superelements of other programs as reduced models.

    matrix_set            the matrices of a linear superelement, checked
    nastran               DMIG entries of a bulk data file, written and read
    op4                   OUTPUT4 files as text, written and read
    abaqus                matrices of Abaqus (.mtx), read
    arrays                .mat and .npz files
    fmu                   a Functional Mock-up Unit, with the C source fmu.c
    export                the formats of `fenicsrom export`
    superelement          a reduced model from the matrices and a scene of interface nodes

The readers and writers are small, because the formats need only a few lines each for dense
matrices; files with other content are refused by name.
"""
