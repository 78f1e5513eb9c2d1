"""Output for people: figures, tables, reports and files for ParaView.

Each file format has one writer: text, CSV, JSON, PNG and `.npz` in `writers`, HTML in `html_page`,
VTK in `vtk`. `sentences` and `motion_table` compose the text for the user.
"""
