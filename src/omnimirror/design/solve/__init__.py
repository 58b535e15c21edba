"""Solvers: sensor design from requirements, requirement check, and relaxations."""
