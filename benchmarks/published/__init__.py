"""Published measurements of motion, read from their own files into measured tracks. The data is not in this project."""
