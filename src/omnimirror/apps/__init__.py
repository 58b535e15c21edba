"""Command line, studio, reports and reproduction of the paper."""
