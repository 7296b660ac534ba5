"""The public functions of hydro, on polars frames; each loads what it needs when it is called.

The vehicle comes first, then the data.  `progress` is called while a function works, with a few words on what
it is at and the share of the work that is done, from 0 to 1; `train` and `replay` say what they call it with.
"""
