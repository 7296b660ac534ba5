"""From the columns of a log to a raw table, and whether its conventions were declared right."""
