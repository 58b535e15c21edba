"""Mirrors of free form, best by one merit or by several."""
