//! How an effect declares itself, in its own file.

use super::{Effect, Site};
use crate::ParameterInfo;

/// A site of an effect, with its default size.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// The site.
    pub site: Site,
    /// Default size.
    pub size: f64,
    /// Unit of the size.
    pub unit: &'static str,
}

/// One effect of the list of effects.
#[derive(Clone, Copy, Debug)]
pub struct Entry {
    /// Its name.
    pub id: &'static str,
    /// Where it may act; the first is the default.
    pub sites: &'static [Place],
    /// What it is.
    pub what: &'static str,
    /// Its parameters with unit, range, default and source; the first is its size.
    pub parameters: &'static [ParameterInfo],
    pub(super) build: fn(Site) -> Box<dyn Effect>,
}

/// Declares an effect: its name, what it is, its sites with default sizes, its struct of parameters
/// (the first is its size) and its inner state. The struct has a field `site`, and the module
/// `ENTRY` for [`LIST`].
macro_rules! effect {
    (
        $id:literal: $what:literal;
        at $($at:ident = $size:literal $size_unit:literal),+;
        $(#[$meta:meta])*
        pub struct $type:ident {
            $($(#[$field_meta:meta])* $field:ident: $unit:literal, $minimum:expr, $maximum:expr,
                $default:expr, $source:literal;)+
        }
        $(state { $($state:ident: $state_type:ty = $initial:expr;)* })?
    ) => {
        $crate::parameter::parameter_set! {
            $(#[$meta])*
            pub struct $type {
                $($(#[$field_meta])* $field: $unit, $minimum, $maximum, $default, $source;)+
            }
            state {
                site: $crate::effects::Site = $crate::effects::Site::Line;
                $($($state: $state_type = $initial;)*)?
            }
        }

        impl $type {
            /// The effect at a site, with its default parameters.
            pub fn at(site: $crate::effects::Site) -> Self { Self { site, ..Self::default() } }
        }

        impl $crate::effects::Identity for $type {
            fn id(&self) -> &'static str { $id }

            fn site(&self) -> $crate::effects::Site { self.site }
        }

        /// The effect as [`LIST`](super::LIST) has it.
        pub const ENTRY: $crate::effects::declaration::Entry = $crate::effects::declaration::Entry {
            id: $id,
            sites: &[$($crate::effects::declaration::Place {
                site: $crate::effects::Site::$at,
                size: $size,
                unit: $size_unit,
            }),+],
            what: $what,
            parameters: $type::NAMES,
            build: |site| Box::new($type::at(site)),
        };
    };
}
pub(crate) use effect;
