"""Which physical effect a vehicle file lacks, and how sure that is."""
