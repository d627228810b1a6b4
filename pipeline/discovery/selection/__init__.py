"""Which of the fitted models the measurements support, and how sure that is."""
