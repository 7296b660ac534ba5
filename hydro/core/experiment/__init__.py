"""Design of the next experiment: manoeuvres ranked by predicted information, and advice for each finding."""
