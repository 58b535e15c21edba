"""Tolerance analysis: perturbations, Monte Carlo yield, sensitivities, compensation and allocation."""
