"""Optimisation of freeform mirrors for one merit or several."""
