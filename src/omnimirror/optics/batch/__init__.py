"""Designs by the thousand: closed forms for arrays of mirrors, and for complex steps.

This room stands below ``design`` and ``components``, which both choose among thousands.
"""
