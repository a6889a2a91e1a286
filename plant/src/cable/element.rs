//! One piece of cable: tension from imposed elongation, with toe, sag, permanent set and
//! hysteresis.
//!
//! ```text
//! x   = x_e + p                      elongation: elastic part, permanent set
//! x_e = toe⁻¹(f) - S/f²              elastic curve f(x_e) > 0; n parabolic spans, S = n w² ℓ³/24
//! toe = k x²/(2 x_t) up to x_t, then k (x - x_t/2)
//! p   = β max(x_e so far)            aligned fibres stay so: later loading is stiffer by 1 + β
//! z   = κ k (x_e - slip), |z| ≤ φ f  friction between fibres under their own tension: hysteresis
//! T   = f + z ≥ (1 - φ) f ≥ 0        a cable pulls; k = K/(1 + φ): loading shows the slope K
//! ```
//!
//! The tension is continuous in the elongation and depends on its path, not on its rate. The law
//! creates no energy: set and slip only dissipate it. Valid well below the breaking load (no yield,
//! no creep). Sources: fig. 5.3 (toe, slope), fig. 5.4 (set, hysteresis), § 5.3 (sag); sag
//! stiffness `1/K_eff = 1/K + w²ℓ³/(12 T³)` per span is Ernst's (Der Bauingenieur 40, 1965),
//! friction under load is Jenkins's element (1962).

/// The constants of a piece of cable; SI.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ElementLaw {
    /// Slope of the loading curve once the fibres are aligned `K`, N/m.
    pub stiffness_n_per_m: f64,
    /// Tension at which the toe ends and the straight part begins, N.
    pub toe_tension_n: f64,
    /// Sag constant `S = n w² ℓ³/24`, N²·m; 0 for a cable without weight.
    pub sag_n2_m: f64,
    /// Permanent set over elastic elongation on first loading `β`.
    pub set_ratio: f64,
    /// Stiffness of the friction branch over the elastic one `κ`.
    pub branch_ratio: f64,
    /// Friction between fibres over tension `φ`, below 1.
    pub friction_ratio: f64,
}

impl ElementLaw {
    /// `S` of a cable of `weight_n_per_m` with `spans` spans of `span_m` each.
    pub fn sag_constant(spans: f64, span_m: f64, weight_n_per_m: f64) -> f64 {
        spans * weight_n_per_m.powi(2) * span_m.powi(3) / 24.0
    }

    /// Slope of the elastic curve `k = K/(1 + φ)`, N/m.
    pub fn elastic_n_per_m(&self) -> f64 {
        self.stiffness_n_per_m / (1.0 + self.friction_ratio)
    }

    /// Elastic elongation at an elastic tension above 0, m.
    pub fn stretch(&self, tension_n: f64) -> f64 {
        let straight = self.straight(tension_n).0;
        if self.sag_n2_m > 0.0 {
            straight - self.sag_n2_m / (tension_n * tension_n)
        } else {
            straight
        }
    }

    /// Elastic tension at an elastic elongation, N; never negative. `near` is a guess.
    fn tension(&self, stretch: f64, near: f64) -> f64 {
        let weightless = self.weightless(stretch);
        if self.sag_n2_m <= 0.0 {
            return weightless;
        }
        // Concave and increasing in the tension: the first Newton step leads below the root, the
        // next ones approach it from there. Gap and slope are multiplied by the cube of the
        // tension, which leaves a single division.
        let mut tension = near.max(weightless).max(1e-9);
        for _ in 0..100 {
            let (straight, slope) = self.straight(tension);
            let cube = tension * tension * tension;
            let gap = (straight - stretch) * cube - self.sag_n2_m * tension;
            let next = tension - gap / (slope * cube + 2.0 * self.sag_n2_m);
            let next = if next > 0.0 { next } else { 0.25 * tension };
            let change = (next - tension).abs();
            tension = next;
            // The remaining error is of the order of the square of the change.
            if change <= 1e-9 * tension {
                break;
            }
        }
        tension
    }

    /// Energy of the elastic part at a positive elastic tension, J: of stretching, and of lifting
    /// the weight.
    fn energy(&self, tension_n: f64) -> f64 {
        let (k, end) = (self.elastic_n_per_m(), 2.0 * self.toe_tension_n / self.elastic_n_per_m());
        let stretching = if tension_n < self.toe_tension_n {
            k * self.straight(tension_n).0.powi(3) / (6.0 * end)
        } else {
            k * end * end / 6.0 + (tension_n.powi(2) - self.toe_tension_n.powi(2)) / (2.0 * k)
        };
        if self.sag_n2_m > 0.0 { stretching - 2.0 * self.sag_n2_m / tension_n } else { stretching }
    }

    /// Tension of the cable without sag.
    fn weightless(&self, stretch: f64) -> f64 {
        let (k, end) = (self.elastic_n_per_m(), 2.0 * self.toe_tension_n / self.elastic_n_per_m());
        if stretch <= 0.0 {
            0.0
        } else if stretch < end {
            0.5 * k * stretch * stretch / end
        } else {
            k * (stretch - 0.5 * end)
        }
    }

    /// Elongation without sag, and its derivative with respect to tension.
    fn straight(&self, tension: f64) -> (f64, f64) {
        let k = self.elastic_n_per_m();
        if tension < self.toe_tension_n {
            let stretch = 2.0 * (self.toe_tension_n * tension).sqrt() / k;
            (stretch, 0.5 * stretch / tension.max(f64::MIN_POSITIVE))
        } else {
            ((tension + self.toe_tension_n) / k, 1.0 / k)
        }
    }
}

/// A piece of cable with its history.
#[derive(Clone, Copy, Debug)]
pub struct Element {
    law: ElementLaw,
    /// Largest elastic elongation so far, m.
    aligned_m: f64,
    /// Elastic elongation at which the friction branch is free of force, m.
    slip_m: f64,
    elastic_n: f64,
    rubbing_n: f64,
    dissipated_j: f64,
}

impl Element {
    /// A new cable, free of tension at elongation 0 (with sag: under the tension of its own
    /// weight).
    pub fn new(law: ElementLaw) -> Self {
        let elastic_n = law.tension(0.0, 0.0);
        Self { law, aligned_m: 0.0, slip_m: 0.0, elastic_n, rubbing_n: 0.0, dissipated_j: 0.0 }
    }

    /// A cable that was once loaded to `bedding_n` and now rests at `tension_n`, its friction
    /// branch free of force; and its elongation.
    pub fn bedded(law: ElementLaw, bedding_n: f64, tension_n: f64) -> (Self, f64) {
        let aligned_m = law.stretch(bedding_n.max(tension_n)).max(0.0);
        let stretch = law.stretch(tension_n);
        let element = Self { aligned_m, slip_m: stretch, elastic_n: tension_n, ..Self::new(law) };
        (element, stretch + law.set_ratio * aligned_m)
    }

    /// The law.
    pub fn law(&self) -> &ElementLaw {
        &self.law
    }

    /// Elongates (or shortens) the cable to `elongation_m` from where it was and returns its
    /// tension, N.
    pub fn extend(&mut self, elongation_m: f64) -> f64 {
        let law = &self.law;
        let (aligned_before, rubbing_before) = (self.aligned_m, self.rubbing_n);
        let mut stretch = elongation_m - law.set_ratio * self.aligned_m;
        if stretch > self.aligned_m {
            stretch = elongation_m / (1.0 + law.set_ratio);
            self.aligned_m = stretch;
        }
        self.elastic_n = law.tension(stretch, self.elastic_n);
        let branch = law.branch_ratio * law.elastic_n_per_m();
        let (limit, trial) =
            (law.friction_ratio * self.elastic_n, branch * (stretch - self.slip_m));
        self.rubbing_n = trial.clamp(-limit, limit);
        if trial.abs() > limit {
            let slipped = (trial - self.rubbing_n) / branch;
            self.slip_m += slipped;
            self.dissipated_j += self.rubbing_n * slipped;
        }
        if self.aligned_m > aligned_before {
            // What the set takes, `∫ T dp`: of the elastic part in closed form, of the branch by
            // its mean.
            let from = law.tension(aligned_before, self.elastic_n);
            let rubbing =
                0.5 * (rubbing_before + self.rubbing_n) * (self.aligned_m - aligned_before);
            self.dissipated_j +=
                law.set_ratio * (law.energy(self.elastic_n) - law.energy(from) + rubbing);
        }
        self.tension_n()
    }

    /// Tension at the present elongation, N.
    pub fn tension_n(&self) -> f64 {
        self.elastic_n + self.rubbing_n
    }

    /// Permanent set, m.
    pub fn set_m(&self) -> f64 {
        self.law.set_ratio * self.aligned_m
    }

    /// Energy stored at the present elongation, J (up to a constant).
    pub fn stored_j(&self) -> f64 {
        let branch = self.law.branch_ratio * self.law.elastic_n_per_m();
        let rubbing =
            if branch > 0.0 { 0.5 * self.rubbing_n * self.rubbing_n / branch } else { 0.0 };
        self.law.energy(self.elastic_n) + rubbing
    }

    /// Energy taken by set and rubbing since the start, J; it only grows.
    pub fn dissipated_j(&self) -> f64 {
        self.dissipated_j
    }

    /// Lets the rubbing branch come to rest where the cable is and forgets what was lost; the
    /// alignment stays.
    pub fn relax(&mut self, elongation_m: f64) {
        self.extend(elongation_m);
        self.slip_m = elongation_m - self.set_m();
        self.rubbing_n = 0.0;
        self.dissipated_j = 0.0;
    }
}
