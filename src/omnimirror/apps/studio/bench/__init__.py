"""Design bench of the studio: a sensor with adjustable parameters, live plots, requirements and
optimiser."""
