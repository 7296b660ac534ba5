"""Changed vehicles with hulls of panels, which no formula of the catalogue describes.

`benchmarks.judge` diagnoses the recordings, in the lists `panel-...` and `unchanged-...`.
"""
