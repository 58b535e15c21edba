"""Model sequence without an initial value: stereographic, unified, and richer models."""
