"""Files of Scaramuzza's polynomial, as four programs write it."""
