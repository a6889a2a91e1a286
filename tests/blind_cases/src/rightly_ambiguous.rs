//! Effects of a pair that are named at an equivalent place, with the true one told as a rival.

use crate::score::Score;

impl Score {
    /// Whether all effects were found, as [`Self::both`], or rightly ambiguous: named at another
    /// site, with the true site as one of at most two rivals.
    pub fn all_found_or_ambiguous(&self) -> bool {
        let found = |truth: &String| self.named.contains(truth) || self.rightly_ambiguous(truth);
        self.both == Some(true) || (self.truth.len() > 1 && self.truth.iter().all(found))
    }

    /// Whether an effect was found that is none of several, as [`Self::false_third`], apart from
    /// those that are rightly ambiguous.
    pub fn false_further(&self) -> bool {
        let excused = |named: &String| {
            let same = |truth: &&String| id(truth) == id(named);
            self.truth.iter().filter(same).any(|truth| self.rightly_ambiguous(truth))
        };
        let mut others = self.named.iter().filter(|named| !self.truth.contains(named)).peekable();
        // Without others the place within a site is false, which is not in the names.
        self.false_third == Some(true) && (others.peek().is_none() || !others.all(excused))
    }

    /// Whether an effect, `ID@SITE`, is named at another site, with it as one of at most two
    /// rivals.
    fn rightly_ambiguous(&self, truth: &str) -> bool {
        self.verdict == "ambiguous"
            && self.ambiguous_with.len() <= 2
            && self.ambiguous_with.iter().any(|rival| rival == truth)
            && self.named.iter().any(|named| id(named) == id(truth))
    }
}

/// The id in `ID@SITE`.
fn id(name: &str) -> &str {
    name.split('@').next().unwrap_or(name)
}
