"""Everything that predicts: surrogates, Gaussian processes, KPI models and how they are trained."""
