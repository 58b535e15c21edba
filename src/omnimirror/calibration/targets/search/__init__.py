"""How a board is searched for: seeds, growth, markers, local rectification; and how its corners are fitted."""
