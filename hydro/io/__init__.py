"""Artefacts in and out: schemas, Parquet tables, provenance, vehicle files, models."""
