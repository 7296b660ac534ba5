"""The commands: each reads artefacts, makes one pure call and writes an artefact."""
