"""Sets of pictures with their truth, made so that they can be made again."""
