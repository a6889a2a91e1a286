//! How an effect declares itself, in its own file.

use super::monitoring::Monitoring;
use super::one_channel::OneChannel;
use super::search::{Basis, RecordFeatures, Search, SearchSpace};
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
    /// Where it may act in a transmission; the first is the default. None for effects of
    /// one-channel models alone.
    pub sites: &'static [Place],
    /// What it is.
    pub what: &'static str,
    /// Its parameters with unit, range, default and source; the first is its size.
    pub parameters: &'static [ParameterInfo],
    /// How it is searched in records.
    pub search: Search,
    /// How it is looked for beside a running machine.
    pub monitoring: Monitoring,
    /// The effect in models of one channel, where it has a form there.
    pub one_channel: Option<&'static OneChannel>,
    pub(super) build: Option<fn(Site) -> Box<dyn Effect>>,
}

impl Entry {
    /// An effect of one-channel models alone, which no transmission has.
    pub const fn of_one_channel(declared: &'static OneChannel) -> Self {
        Self {
            id: declared.id,
            sites: &[],
            what: declared.words,
            parameters: &[],
            search: Search::BY_SIZE,
            monitoring: Monitoring::USUAL,
            one_channel: Some(declared),
            build: None,
        }
    }

    /// The search space at one of its sites, for records with these features.
    pub fn search_space(&self, place: &Place, features: &RecordFeatures) -> SearchSpace {
        let (site, size, parameter) = (place.site, place.size, &self.parameters[0]);
        (self.search.space)(&Basis { site, size, parameter, features })
    }
}

/// Declares an effect: its name, what it is, its sites with default sizes, its struct of parameters
/// (the first is its size), its inner state, how it is searched in records (fields of [`Search`];
/// by its size alone unless given), how it is looked for beside a running machine (fields of
/// [`Monitoring`]; as usual unless given), and its form in models of one channel (fields of
/// [`OneChannel`]; none unless given). The struct has a field `site`, and the module `ENTRY` for
/// [`LIST`].
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
        $(search { $($of_search:ident: $search:expr,)+ })?
        $(monitoring { $($of_monitoring:ident: $monitoring:expr,)+ })?
        $(one_channel { $($of_channel:ident: $channel:expr,)+ })?
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

            /// Names of the sites at which it may act.
            pub const SITES: &'static [&'static str] =
                &[$($crate::effects::Site::$at.name()),+];
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
            search: $crate::effects::search::Search {
                $($($of_search: $search,)+)?
                ..$crate::effects::search::Search::BY_SIZE
            },
            monitoring: $crate::effects::monitoring::Monitoring {
                $($($of_monitoring: $monitoring,)+)?
                ..$crate::effects::monitoring::Monitoring::USUAL
            },
            one_channel: {
                const DECLARED: &[$crate::effects::one_channel::OneChannel] =
                    &[$($crate::effects::one_channel::OneChannel {
                        $($of_channel: $channel,)+
                        ..$crate::effects::one_channel::OneChannel::named($id, $type::SITES)
                    })?];
                DECLARED.first()
            },
            build: Some(|site| Box::new($type::at(site))),
        };
    };
}
pub(crate) use effect;
