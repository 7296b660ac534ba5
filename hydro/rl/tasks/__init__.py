"""Tasks in which policies train and are tested, one class per file; `registry` lists them."""
