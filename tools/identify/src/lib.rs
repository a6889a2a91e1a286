//! Holds the model against measured data and names what it lacks.
