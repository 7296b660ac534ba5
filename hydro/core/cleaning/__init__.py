"""The one cleaned recording that all commands see, and whether it can answer a question at all."""
