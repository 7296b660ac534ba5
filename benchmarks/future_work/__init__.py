"""Future work of the reference paper: fluid memory, other vehicles, and a recording of a real vehicle.

Each part compares residual networks with effects that `hydro fit` identifies, and with simple predictors, on
sessions that nothing was fitted to.
"""
