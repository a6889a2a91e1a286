//! The constants of a plant that effects read and change, whatever its lines are made of.

/// The constants of a transmission of two lines, as far as an effect needs them.
pub trait LineConstants {
    /// Name of the plant in error messages.
    fn model(&self) -> &'static str;

    /// Stiffness `K` of one line from end to end, N/m; each half is a spring of `2K`.
    fn line_stiffness_n_per_m(&self) -> f64;

    /// Mass of one line, kg.
    fn line_mass_kg(&self) -> f64;

    /// Cross section of the fluid, m²; `None` where no fluid flows.
    fn fluid_area_m2(&self) -> Option<f64>;

    /// Multiplies the stiffness of both lines.
    fn scale_line_stiffness(&mut self, factor: f64);

    /// Adds to the damping at both ends of both lines, N·s/m.
    fn add_line_damping(&mut self, damping_n_s_per_m: f64);
}
