"""Reading and writing of artefacts, the files with provenance: schemas, Parquet tables, vehicles, models."""
