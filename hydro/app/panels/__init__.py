"""The five steps of the workbench, a panel each."""

from hydro.app.panels import compare, keep, learn, load, tune

STEPS = (
    ("Load", load.show),
    ("Compare", compare.show),
    ("Learn", learn.show),
    ("Add and tune", tune.show),
    ("Keep", keep.show),
)
"""Title and panel of each step."""
