"""From no guess at all to a model: a stereographic camera, a unified one, and richer models from there."""
