"""Bundle adjustment: what was seen, what is estimated from it, residuals, normal equations, steps."""
