"""Analysis over the whole aperture: ray bundles, spot diagrams, point-spread function, MTF and
illumination.
"""
