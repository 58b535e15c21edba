"""The studio's design bench: a sensor by sliders, its plots at once, requirements, and the optimiser."""
