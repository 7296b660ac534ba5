"""The tasks that policies are trained in and tested on, one class in one file each; `registry` lists them."""
