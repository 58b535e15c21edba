"""From what is wanted to a mirror that can be made."""
