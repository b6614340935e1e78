"""What other programs load of qsmooth: pyvista's accessor, filters for VTK and ParaView.

Nothing here is imported by the package; each module needs its library at once.
"""
