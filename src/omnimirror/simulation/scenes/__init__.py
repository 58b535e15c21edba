"""Scenes to take pictures of: the contract, environments far away, and the scenes that come with the project."""
