//! For how long something has been so.

/// When it last began.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Since {
    at_ns: Option<u64>,
}

impl Since {
    /// For how long it has been so (ns); `begins`: it begins anew now, as at the first call.
    pub(crate) fn elapsed_ns(&mut self, begins: bool, now_ns: u64) -> u64 {
        if begins {
            self.at_ns = Some(now_ns);
        }
        now_ns.saturating_sub(*self.at_ns.get_or_insert(now_ns))
    }
}
