"""Output for people: figures, tables, reports and files for ParaView.

Each file format has one writer: text, CSV, JSON, PNG and `.npz` in `base.writers`, HTML in
`base.html_page`, VTK in `paraview.vtk`. Imports run one way, between the packages of this one too:

    base < paraview < body < setup < run < curves < studies < reports
"""
