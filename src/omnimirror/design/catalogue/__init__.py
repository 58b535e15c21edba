"""Lenses and imagers that can be bought, and choosing among them."""
