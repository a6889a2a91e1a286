//! Codes of a converter and volts.

use crate::uapi::KernelRange;

/// A range of an analog channel: code 0 is `least_v`, the largest code `most_v`, by a straight
/// line. The 0 V of a range of both signs lies between two codes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Range {
    /// Volts of code 0 (V).
    pub least_v: f64,
    /// Volts of the largest code (V).
    pub most_v: f64,
    /// The largest code.
    pub maxdata: u32,
}

/// Unit and reference in the flags of a range: 0 is volts, with the card's own reference.
const UNIT_AND_REFERENCE: u32 = 0x1ff;

impl Range {
    /// A range of the kernel's; `None` where its unit is not the volt, or it is empty.
    pub(crate) fn of_kernel(range: &KernelRange, maxdata: u32) -> Option<Self> {
        let usable = range.flags & UNIT_AND_REFERENCE == 0 && range.most > range.least;
        (usable && maxdata > 0).then(|| Self {
            least_v: f64::from(range.least) * 1e-6,
            most_v: f64::from(range.most) * 1e-6,
            maxdata,
        })
    }

    /// Volts of a code (V).
    pub fn volts(&self, code: u32) -> f64 {
        self.least_v + f64::from(code) / f64::from(self.maxdata) * (self.most_v - self.least_v)
    }

    /// The code nearest to these volts, limited to the range; that of 0 V for what is no number.
    pub fn code(&self, volts: f64) -> u32 {
        let volts = if volts.is_nan() { 0.0 } else { volts };
        let share = (volts - self.least_v) / (self.most_v - self.least_v);
        (share * f64::from(self.maxdata)).round().clamp(0.0, f64::from(self.maxdata)) as u32
    }

    /// Volts between two codes (V).
    pub fn resolution_v(&self) -> f64 {
        (self.most_v - self.least_v) / f64::from(self.maxdata)
    }

    /// Whether ± these volts lie within the range.
    pub fn holds(&self, volts: f64) -> bool {
        self.least_v <= -volts && volts <= self.most_v
    }
}

/// Index and range of the narrowest of `ranges` that holds ± these volts.
pub fn narrowest(ranges: &[Option<Range>], volts: f64) -> Option<(u32, Range)> {
    let width = |range: &Range| range.most_v - range.least_v;
    (0u32..)
        .zip(ranges)
        .filter_map(|(index, range)| Some((index, (*range)?)))
        .filter(|(_, range)| range.holds(volts))
        .min_by(|(_, a), (_, b)| width(a).total_cmp(&width(b)))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn range(volts: i32, maxdata: u32) -> Range {
        let (least, most) = (-volts * 1_000_000, volts * 1_000_000);
        Range::of_kernel(&KernelRange { least, most, flags: 0 }, maxdata).expect("a range in volts")
    }

    #[test]
    fn codes_of_known_cards() {
        let card = range(10, 0xffff);
        assert_eq!((card.volts(0), card.volts(0xffff)), (-10.0, 10.0));
        // 0 V lies between 0x7fff and 0x8000, half a step from each
        assert!((card.volts(0x8000) - 0.5 * card.resolution_v()).abs() < 1e-12);
        assert!((card.volts(0x7fff) + 0.5 * card.resolution_v()).abs() < 1e-12);
        // (1.25 + 10) / 20 * 65535 = 36863.4
        assert_eq!(card.code(1.25), 36863);
        assert_eq!((card.code(-11.0), card.code(11.0)), (0, 0xffff));
        assert_eq!(card.code(f64::NAN), card.code(0.0));
        assert_eq!(card.code(f64::INFINITY), 0xffff);
        // 12 bits: 4.9 mV
        assert!((range(10, 0xfff).resolution_v() - 20.0 / 4095.0).abs() < 1e-15);
    }

    #[test]
    fn the_narrowest_range_that_holds_both_signs_is_taken() {
        let unipolar =
            Range::of_kernel(&KernelRange { least: 0, most: 5_000_000, flags: 0 }, 0xffff);
        let ranges = [Some(range(10, 0xffff)), unipolar, None, Some(range(5, 0xffff))];
        assert_eq!(narrowest(&ranges, 5.0).map(|(index, _)| index), Some(3));
        assert_eq!(narrowest(&ranges, 5.1).map(|(index, _)| index), Some(0));
        assert_eq!(narrowest(&ranges, 11.0), None);
    }

    #[test]
    fn currents_empty_ranges_and_external_references_are_no_volts() {
        for (least, most, flags) in [(0, 20_000, 1), (5, 5, 0), (-1_000_000, 1_000_000, 0x100)] {
            assert_eq!(Range::of_kernel(&KernelRange { least, most, flags }, 0xffff), None);
        }
    }

    proptest! {
        #[test]
        fn volts_come_back_within_half_a_step(
            volts in -10.0..10.0f64,
            bits in 8u32..=32,
        ) {
            let card = range(10, u32::MAX >> (32 - bits));
            let back = card.volts(card.code(volts));
            prop_assert!((back - volts).abs() <= 0.5 * card.resolution_v() * (1.0 + 1e-6));
        }

        #[test]
        fn every_code_comes_back(code in any::<u32>(), bits in 8u32..=24) {
            let maxdata = u32::MAX >> (32 - bits);
            let card = range(5, maxdata);
            prop_assert_eq!(card.code(card.volts(code & maxdata)), code & maxdata);
        }
    }
}
