"""Catalogues of off-the-shelf lenses and imagers, and part selection."""
