"""Commands: one module each, which defines ``command``."""
