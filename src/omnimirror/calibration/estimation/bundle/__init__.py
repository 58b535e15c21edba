"""Bundle adjustment: observations, parameters, residuals, normal equations and iteration steps."""
