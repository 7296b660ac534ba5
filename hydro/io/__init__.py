"""Reading and writing of artefacts: schemas, Parquet tables, provenance, vehicle files, models."""
