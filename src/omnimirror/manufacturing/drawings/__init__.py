"""Engineering drawings on paper sheets (PDF, SVG, PNG) and as DXF."""
