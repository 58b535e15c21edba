"""What a mirror that was made is, from points that were measured on it, and what that does to the picture."""
