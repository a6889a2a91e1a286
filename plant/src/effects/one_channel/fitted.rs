//! An effect as fitted to one channel, for the plant's effect of the same id.

/// A value with its name and unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quantity<'a> {
    /// Name.
    pub name: &'a str,
    /// Value.
    pub value: f64,
    /// Unit of the value.
    pub unit: &'a str,
}

/// A declared parameter beside its fitted value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DeclaredFit<'a> {
    /// Declared value.
    pub declared: f64,
    /// Fitted value.
    pub fitted: f64,
    /// Unit of both.
    pub unit: &'a str,
}

/// An effect as fitted.
#[derive(Clone, Copy, Debug)]
pub struct FittedEffect<'a> {
    /// Name of its site.
    pub site: &'a str,
    /// Its parameters.
    pub parameters: &'a [Quantity<'a>],
    /// Declared parameters; mass, damping and stiffness have different units, with one each.
    pub declared: &'a [DeclaredFit<'a>],
    /// Position per motor turn, where it is declared.
    pub turn: Option<f64>,
}

impl<'a> FittedEffect<'a> {
    /// The parameter of that name.
    pub fn own(&self, name: &str) -> Option<&'a Quantity<'a>> {
        self.parameters.iter().find(|own| own.name == name)
    }

    /// The declared parameter with a unit.
    pub fn declared_in(&self, unit: &str) -> Option<&'a DeclaredFit<'a>> {
        self.declared.iter().find(|declared| declared.unit == unit)
    }

    /// All parameters with other names, given as pairs of old and new; `None` if one has no new
    /// name.
    pub fn renamed(&self, names: &[(&str, &'a str)]) -> Option<Vec<Quantity<'a>>> {
        let renamed = |own: &Quantity<'a>| {
            let (_, name) = names.iter().find(|(from, _)| *from == own.name)?;
            Some(Quantity { name, ..*own })
        };
        self.parameters.iter().map(renamed).collect()
    }

    /// Amplitude and phase of its sine and cosine parts. `sign` is -1 where the plant's wave drives
    /// the machine: the fit's wave is the force required to overcome it.
    pub fn wave(&self, amplitude: &'a str, sign: f64) -> Option<Vec<Quantity<'a>>> {
        let (sine, cosine) = (self.own("sine")?, self.own("cosine")?);
        let (along, across) = (sign * sine.value, sign * cosine.value);
        Some(vec![
            Quantity { name: amplitude, value: along.hypot(across), unit: sine.unit },
            Quantity { name: "phase", value: across.atan2(along), unit: "rad" },
        ])
    }
}
