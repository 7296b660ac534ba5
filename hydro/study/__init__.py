"""Studies of many networks or policies: resumable steps, each an ordinary command, and their summaries."""
