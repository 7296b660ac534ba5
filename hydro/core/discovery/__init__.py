"""Laws that the catalogue has not: sparse terms that transfer from one regime of motion to others."""
