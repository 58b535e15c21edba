"""One camera or stream in, each of its virtual views out, as ordinary cameras on the network."""
