//! Which viewers that are pages of a browser may read along.
//!
//! A page of any site that a browser of this computer has open can try to connect, and would read
//! a subject's data. Browsers tell the page's site (`Origin`), which a page cannot change.

use web_console::without_port;

/// Foxglove's own site.
const FOXGLOVE: &str = "foxglove.dev";

/// Whether a viewer of this origin is admitted: a program (it tells none, or one of a scheme of its
/// own), a page of this computer, a page of Foxglove's site, or one that is `named`.
pub(crate) fn is_admitted(origin: Option<&str>, named: &[String]) -> bool {
    let Some(origin) = origin else { return true };
    if named.iter().any(|name| name.trim_end_matches('/').eq_ignore_ascii_case(origin)) {
        return true;
    }
    let (scheme, authority) = match origin.split_once("://") {
        Some(parts) => parts,
        // `null`: any page can hide its site so.
        None => return false,
    };
    let host = without_port(authority);
    match scheme {
        "http" => is_this_computer(host),
        "https" => is_this_computer(host) || is_foxglove(host),
        // `file://` and the schemes of programs; no site has them.
        _ => true,
    }
}

fn is_this_computer(host: &str) -> bool {
    matches!(host, "localhost" | "127.0.0.1" | "[::1]")
}

fn is_foxglove(host: &str) -> bool {
    host.strip_suffix(FOXGLOVE).is_some_and(|rest| rest.is_empty() || rest.ends_with('.'))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn programs_and_known_pages_read_along_and_other_sites_do_not() {
        let named = vec!["https://viewer.example/".to_owned()];
        assert!(is_admitted(None, &[]));
        for known in [
            "file://",
            "lichtblick://app",
            "http://localhost:8080",
            "http://[::1]:8080",
            "https://127.0.0.1",
            "https://app.foxglove.dev",
        ] {
            assert!(is_admitted(Some(known), &[]), "{known}");
        }
        assert!(is_admitted(Some("https://viewer.example"), &named));
        for other in [
            "null",
            "",
            "https://viewer.example",
            "http://localhost.evil.example",
            "https://evilfoxglove.dev",
            "https://foxglove.dev.evil.example",
            "http://app.foxglove.dev",
            "http://127.0.0.1.evil.example:80",
        ] {
            assert!(!is_admitted(Some(other), &[]), "{other}");
        }
    }
}
