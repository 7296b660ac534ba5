"""What a vehicle file predicts of a recording, shot by shot, and how that changes with its entries."""
