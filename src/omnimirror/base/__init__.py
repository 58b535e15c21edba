"""Errors, argument checks, files, parameters, quantities, numerics and native bindings."""
