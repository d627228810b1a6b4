"""Published measurements of motion, read from their own files into measured tracks. None of that data is in this
project."""
