"""Batch evaluation of designs: closed forms for arrays of mirrors and for complex steps.

This package is below ``design`` and ``components``, which both select among thousands of designs.
"""
