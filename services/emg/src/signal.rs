//! Signals of recordings, which may be longer than the memory.

use std::convert::Infallible;

/// A signal that is read value by value and grows at its end.
pub trait Signal: Sized {
    /// Why a value cannot be read or added.
    type Error;

    /// An empty signal that is kept as this one is.
    fn empty(&self) -> Self;

    /// Number of values.
    fn length(&self) -> usize;

    /// Adds a value at the end.
    ///
    /// # Errors
    /// Those of what keeps it.
    fn push(&mut self, value: f64) -> Result<(), Self::Error>;

    /// Reads values by their place, from 0 and below the length; fast where each is near the one
    /// before.
    fn reader(&self) -> impl FnMut(usize) -> Result<f64, Self::Error>;
}

impl Signal for Vec<f64> {
    type Error = Infallible;

    fn empty(&self) -> Self {
        Self::with_capacity(self.len())
    }

    fn length(&self) -> usize {
        self.len()
    }

    fn push(&mut self, value: f64) -> Result<(), Infallible> {
        self.push(value);
        Ok(())
    }

    fn reader(&self) -> impl FnMut(usize) -> Result<f64, Infallible> {
        |at| Ok(self[at])
    }
}
