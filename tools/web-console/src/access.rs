//! Who may do what: pages with the token, and the one of them that has control.

use std::collections::BTreeSet;

use subtle::ConstantTimeEq;

use crate::request::Level;

/// Wrong tokens that a page may show before its connection is closed.
pub(crate) const WRONG_TOKENS: u32 = 3;

/// The pages' rights. A page is known by the number of its connection.
#[derive(Debug)]
pub(crate) struct Access {
    token: String,
    allowed: BTreeSet<u64>,
    /// The page that has control.
    controller: Option<u64>,
}

impl Access {
    pub(crate) const fn new(token: String) -> Self {
        Self { token, allowed: BTreeSet::new(), controller: None }
    }

    /// A page shows a token. The first one that has the right one gets control.
    ///
    /// # Errors
    /// If it is wrong.
    pub(crate) fn hello(&mut self, page: u64, token: &str) -> Result<(), String> {
        if !bool::from(self.token.as_bytes().ct_eq(token.as_bytes())) {
            return Err("the token is wrong: this page may watch; `farreach console` prints the \
                        address with the right one"
                .to_owned());
        }
        self.allowed.insert(page);
        self.controller.get_or_insert(page);
        Ok(())
    }

    /// Whether a page may do what needs `level`.
    ///
    /// # Errors
    /// Why not, and what to do.
    pub(crate) fn check(&self, page: u64, level: Level) -> Result<(), String> {
        if level == Level::Anyone {
            return Ok(());
        }
        if !self.allowed.contains(&page) {
            return Err(
                "this page has no token and may watch only; `farreach console` prints the \
                        address of the operator's page"
                    .to_owned(),
            );
        }
        match (level, self.controller) {
            (Level::Control, Some(other)) if other != page => {
                Err("another page has control; take control first".to_owned())
            }
            (Level::Control, None) => Err("no page has control; take control first".to_owned()),
            _ => Ok(()),
        }
    }

    /// Gives control to a page that has the token; the page that had it before, if another.
    pub(crate) fn take_control(&mut self, page: u64) -> Option<u64> {
        self.controller.replace(page).filter(|other| *other != page)
    }

    /// A page is gone. Returns whether it had control; nobody has it then.
    pub(crate) fn leave(&mut self, page: u64) -> bool {
        self.allowed.remove(&page);
        self.controller.take_if(|controller| *controller == page).is_some()
    }

    /// The page that has control.
    pub(crate) const fn controller(&self) -> Option<u64> {
        self.controller
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::expect_used)]

    use super::*;

    #[test]
    fn without_the_token_a_page_watches() {
        let mut access = Access::new("secret".to_owned());
        for wrong in ["", "secre", "secret ", "Secret"] {
            assert!(access.hello(1, wrong).is_err(), "{wrong}");
        }
        assert!(access.check(1, Level::Anyone).is_ok());
        assert!(access.check(1, Level::Token).unwrap_err().contains("watch only"));
        assert!(access.check(1, Level::Control).is_err());
    }

    #[test]
    fn one_page_has_control_and_all_with_the_token_may_stop() {
        let mut access = Access::new("secret".to_owned());
        access.hello(1, "secret").unwrap();
        access.hello(2, "secret").unwrap();
        assert!(access.check(1, Level::Control).is_ok());
        assert!(access.check(2, Level::Control).unwrap_err().contains("another page"));
        assert!(access.check(2, Level::Token).is_ok());
        assert_eq!(access.take_control(2), Some(1));
        assert!(access.check(1, Level::Control).is_err());
        assert!(access.check(1, Level::Token).is_ok());
        assert!(!access.leave(1));
        assert!(access.leave(2));
        assert_eq!(access.controller(), None);
        // Its right went with it.
        assert!(access.check(2, Level::Token).is_err());
    }

    #[test]
    fn nobody_inherits_control_unasked() {
        let mut access = Access::new("secret".to_owned());
        access.hello(1, "secret").unwrap();
        access.hello(2, "secret").unwrap();
        access.leave(1);
        assert!(access.check(2, Level::Control).unwrap_err().contains("take control"));
        access.hello(3, "secret").unwrap();
        assert!(access.check(3, Level::Control).is_ok());
    }
}
