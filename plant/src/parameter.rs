//! Parameters by name: declared in a rig file, estimated by an identification.

/// Name, unit, range and source of a parameter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ParameterInfo {
    /// Name, as in a rig file: spelled out, with its unit.
    pub name: &'static str,
    /// SI unit, `1` for a ratio.
    pub unit: &'static str,
    /// Smallest value in the range of validity.
    pub minimum: f64,
    /// Largest value in the range of validity.
    pub maximum: f64,
    /// Value as printed (or assumed, as `source` says).
    pub printed: f64,
    /// Where the value comes from.
    pub source: &'static str,
}

/// A parameter could not be set, or a set of them contradicts itself.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ParameterError {
    /// No parameter of that name.
    #[error("no parameter `{name}`; known: {known}")]
    Unknown {
        /// The name asked for.
        name: String,
        /// The known names, separated by commas.
        known: String,
    },
    /// Not a number, infinite, or out of range.
    #[error("`{name}` = {value} {unit}: expected {minimum} to {maximum} {unit}")]
    OutOfRange {
        /// The parameter.
        name: &'static str,
        /// The value asked for.
        value: f64,
        /// Smallest allowed.
        minimum: f64,
        /// Largest allowed.
        maximum: f64,
        /// Unit of all three.
        unit: &'static str,
    },
    /// The effect does not apply to this plant.
    #[error("effect `{id}` at site `{site}` does not act on a {model}; leave it out")]
    EffectNotApplicable {
        /// The effect.
        id: &'static str,
        /// Its site.
        site: &'static str,
        /// The model that it was put into.
        model: &'static str,
    },
}

/// Access by name, shared by models and effects.
pub trait ParameterSet {
    /// All parameters, in a fixed order; none by default.
    fn infos(&self) -> &'static [ParameterInfo] {
        &[]
    }

    /// The value of a parameter; `None` if there is none of that name.
    fn get(&self, _name: &str) -> Option<f64> {
        None
    }

    /// Sets a parameter.
    ///
    /// # Errors
    /// [`ParameterError::Unknown`] and [`ParameterError::OutOfRange`]; nothing is changed then.
    fn set(&mut self, name: &str, _value: f64) -> Result<(), ParameterError> {
        Err(unknown(name, self.infos()))
    }

    /// Checks that every value is finite and in range (fields are public, so any may have been
    /// written).
    ///
    /// # Errors
    /// [`ParameterError::OutOfRange`] for the first that is not.
    fn check(&self) -> Result<(), ParameterError> {
        for info in self.infos() {
            info.check(self.get(info.name).unwrap_or(f64::NAN))?;
        }
        Ok(())
    }
}

impl ParameterInfo {
    /// Checks a value against the range.
    ///
    /// # Errors
    /// [`ParameterError::OutOfRange`].
    pub fn check(&self, value: f64) -> Result<(), ParameterError> {
        if (self.minimum..=self.maximum).contains(&value) {
            return Ok(());
        }
        let Self { name, unit, minimum, maximum, .. } = *self;
        Err(ParameterError::OutOfRange { name, value, minimum, maximum, unit })
    }
}

/// The error for a name that is not among `infos`.
pub(crate) fn unknown(name: &str, infos: &[ParameterInfo]) -> ParameterError {
    let known = infos.iter().map(|info| info.name).collect::<Vec<_>>().join(", ");
    ParameterError::Unknown { name: name.to_owned(), known }
}

/// Declares a struct of `f64` parameters with its table and [`ParameterSet`]; `state` adds private
/// fields that are not parameters.
macro_rules! parameter_set {
    (
        $(#[$meta:meta])*
        pub struct $type:ident {
            $($(#[$field_meta:meta])* $field:ident: $unit:literal, $minimum:expr, $maximum:expr,
                $printed:expr, $source:literal;)+
        }
        $(state { $($state:ident: $state_type:ty = $initial:expr;)* })?
    ) => {
        $(#[$meta])*
        #[derive(Clone, Debug)]
        pub struct $type {
            $($(#[$field_meta])* pub $field: f64,)+
            $($($state: $state_type,)*)?
        }

        impl $type {
            /// All parameters with unit, range, printed value and source.
            pub const NAMES: &'static [$crate::ParameterInfo] = &[$($crate::ParameterInfo {
                name: stringify!($field),
                unit: $unit,
                minimum: $minimum,
                maximum: $maximum,
                printed: $printed,
                source: $source,
            }),+];
        }

        impl Default for $type {
            fn default() -> Self { Self { $($field: $printed,)+ $($($state: $initial,)*)? } }
        }

        impl $crate::ParameterSet for $type {
            fn infos(&self) -> &'static [$crate::ParameterInfo] { Self::NAMES }

            fn get(&self, name: &str) -> Option<f64> {
                match name { $(stringify!($field) => Some(self.$field),)+ _ => None }
            }

            fn set(&mut self, name: &str, value: f64) -> Result<(), $crate::ParameterError> {
                let Some(info) = Self::NAMES.iter().find(|info| info.name == name) else {
                    return Err($crate::parameter::unknown(name, Self::NAMES));
                };
                info.check(value)?;
                match name { $(stringify!($field) => self.$field = value,)+ _ => {} }
                Ok(())
            }
        }
    };
}
pub(crate) use parameter_set;
