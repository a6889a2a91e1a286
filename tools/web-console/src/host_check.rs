//! Which `Host` and `Origin` a request may name: a page of another site that a browser has open
//! must not reach the console, not even by a name that is made to point to this computer.

use std::net::IpAddr;

/// The computer's own name.
pub fn computer_name() -> String {
    rustix::system::uname().nodename().to_string_lossy().into_owned()
}

/// Whether the console answers to this `Host`: an address, `localhost`, or the computer's own name.
/// Any other name may be another site's.
pub fn is_own_host(host: &str, computer: &str) -> bool {
    let name = without_port(host);
    let address = name.strip_prefix('[').and_then(|it| it.strip_suffix(']')).unwrap_or(name);
    address.parse::<IpAddr>().is_ok()
        || name.eq_ignore_ascii_case("localhost")
        || (!computer.is_empty() && name.eq_ignore_ascii_case(computer))
}

/// Whether a request for a WebSocket comes from a page of this console. Programs send no `Origin`.
pub(crate) fn is_own_origin(origin: Option<&str>, host: &str) -> bool {
    origin.is_none_or(|origin| {
        origin.strip_prefix("http://").is_some_and(|from| from.eq_ignore_ascii_case(host))
    })
}

/// The name or address in a `Host`, or in what follows `://` in an `Origin`.
pub fn without_port(host: &str) -> &str {
    match host.rsplit_once(':') {
        Some((name, port)) if port.bytes().all(|byte| byte.is_ascii_digit()) => name,
        _ => host,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_and_own_names_are_answered_and_other_names_are_not() {
        for own in [
            "127.0.0.1:8321",
            "127.0.0.1",
            "[::1]:8321",
            "localhost:8321",
            "LOCALHOST",
            "192.168.7.2:80",
            "scanner-pc:8321",
            "Scanner-PC",
        ] {
            assert!(is_own_host(own, "scanner-pc"), "{own}");
        }
        for other in
            ["", "evil.example:8321", "localhost.evil.example", "scanner-pc.example", ":80"]
        {
            assert!(!is_own_host(other, "scanner-pc"), "{other}");
        }
        assert!(!is_own_host("", ""));
    }

    #[test]
    fn a_page_of_another_site_gets_no_socket() {
        let host = "127.0.0.1:8321";
        assert!(is_own_origin(None, host));
        assert!(is_own_origin(Some("http://127.0.0.1:8321"), host));
        for other in ["http://127.0.0.1:9999", "https://evil.example", "null", ""] {
            assert!(!is_own_origin(Some(other), host), "{other}");
        }
    }
}
