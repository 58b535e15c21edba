"""What requirements limit, of sensors with errors: over the whole picture, by the code that designs are judged with."""
