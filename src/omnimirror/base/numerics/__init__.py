"""Numerical methods: root finding, minimisation, minimax optimisation and polynomials."""
