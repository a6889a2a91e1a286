//! The web server: the two pages with their parts, and the WebSocket.

use std::net::SocketAddr;
use std::sync::atomic::Ordering;

use axum::Router;
use axum::extract::ws::WebSocketUpgrade;
use axum::extract::{ConnectInfo, RawQuery, Request, State};
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::middleware::{self, Next};
use axum::response::{IntoResponse, Response};
use axum::routing::get;

use crate::host_check::{is_own_host, is_own_origin};
use crate::page_link::{self, Kind, Pages};
use crate::request::LONGEST;

/// Most pages that may be open.
const PAGES: u64 = 16;

/// Parts of the pages: path, type, contents. All are in the program: a scanner room has no network.
const PARTS: &[(&str, &str, &str)] = &[
    ("/", "text/html; charset=utf-8", include_str!("pages/operator.html")),
    ("/operator.js", "text/javascript; charset=utf-8", include_str!("pages/operator.js")),
    ("/setup.js", "text/javascript; charset=utf-8", include_str!("pages/setup.js")),
    ("/model.js", "text/javascript; charset=utf-8", include_str!("pages/model.js")),
    ("/plots.js", "text/javascript; charset=utf-8", include_str!("pages/plots.js")),
    ("/link.js", "text/javascript; charset=utf-8", include_str!("pages/link.js")),
    ("/bars.js", "text/javascript; charset=utf-8", include_str!("pages/bars.js")),
    ("/operator.css", "text/css; charset=utf-8", include_str!("pages/operator.css")),
    ("/subject", "text/html; charset=utf-8", include_str!("pages/subject.html")),
    ("/subject.js", "text/javascript; charset=utf-8", include_str!("pages/subject.js")),
    ("/subject.css", "text/css; charset=utf-8", include_str!("pages/subject.css")),
];

/// What pages may load and reach: this console.
const POLICY: &str = "default-src 'self'; script-src 'self'; style-src 'self' 'unsafe-inline'; \
                      img-src 'self' data: blob:; connect-src 'self'; frame-ancestors 'none'; \
                      base-uri 'none'; form-action 'none'";

#[derive(Clone)]
struct Site {
    pages: Pages,
    /// Name of this computer.
    computer: String,
}

/// The routes.
pub(crate) fn router(pages: Pages, computer: String) -> Router {
    let mut router = Router::new();
    for (path, kind, contents) in PARTS {
        let part = move || async move { ([(header::CONTENT_TYPE, *kind)], *contents) };
        router = router.route(path, get(part));
    }
    let site = Site { pages, computer };
    router
        .route("/plotly.js", get(plotly))
        .route("/ws", get(socket))
        .layer(middleware::from_fn_with_state(site.clone(), guard))
        .with_state(site)
}

/// plotly.js, which comes with its crate.
async fn plotly() -> impl IntoResponse {
    let headers = [
        (header::CONTENT_TYPE, "text/javascript; charset=utf-8"),
        // It changes with the program alone.
        (header::CACHE_CONTROL, "max-age=3600"),
    ];
    (headers, plotly_source())
}

/// The source of plotly.js, out of the HTML that the crate has it in.
fn plotly_source() -> String {
    let html = plotly::Plot::offline_js_sources();
    let script = html.split_once('>').map_or("", |(_, rest)| rest);
    script.split_once("</script>\n").map_or("", |(script, _)| script).to_owned()
}

/// Refuses foreign names, and adds the headers that every answer has.
async fn guard(State(site): State<Site>, request: Request, next: Next) -> Response {
    let host = text_of(request.headers(), header::HOST).unwrap_or_default();
    if !is_own_host(host, &site.computer) {
        let text = "this console does not answer to that name; use its address\n";
        return (StatusCode::MISDIRECTED_REQUEST, text).into_response();
    }
    let mut response = next.run(request).await;
    let headers = response.headers_mut();
    let mut set = |name: header::HeaderName, value| {
        headers.entry(name).or_insert(HeaderValue::from_static(value));
    };
    set(header::CONTENT_SECURITY_POLICY, POLICY);
    set(header::X_CONTENT_TYPE_OPTIONS, "nosniff");
    set(header::REFERRER_POLICY, "no-referrer");
    set(header::CACHE_CONTROL, "no-store");
    response
}

fn text_of(headers: &HeaderMap, name: header::HeaderName) -> Option<&str> {
    headers.get(name).and_then(|value| value.to_str().ok())
}

async fn socket(
    State(site): State<Site>,
    ConnectInfo(from): ConnectInfo<SocketAddr>,
    RawQuery(query): RawQuery,
    headers: HeaderMap,
    upgrade: WebSocketUpgrade,
) -> Response {
    let host = text_of(&headers, header::HOST).unwrap_or_default();
    if !is_own_origin(text_of(&headers, header::ORIGIN), host) {
        return (StatusCode::FORBIDDEN, "a page of another site\n").into_response();
    }
    let kind = match query.as_deref() {
        Some("page=subject") => Kind::Subject,
        Some("page=operator") => Kind::Operator,
        _ => {
            let text = "expected ?page=operator or ?page=subject\n";
            return (StatusCode::BAD_REQUEST, text).into_response();
        }
    };
    if site.pages.open.fetch_add(1, Ordering::Relaxed) >= PAGES {
        site.pages.open.fetch_sub(1, Ordering::Relaxed);
        let text = format!("{PAGES} pages are open, which is the most; close one\n");
        return (StatusCode::SERVICE_UNAVAILABLE, text).into_response();
    }
    let open = std::sync::Arc::clone(&site.pages.open);
    upgrade
        .max_message_size(LONGEST)
        .max_frame_size(LONGEST)
        .on_failed_upgrade(move |_error| {
            open.fetch_sub(1, Ordering::Relaxed);
        })
        .on_upgrade(move |socket| page_link::serve(socket, kind, from.ip().to_string(), site.pages))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn plotly_is_whole_and_alone() {
        let source = plotly_source();
        assert!(source.len() > 3_000_000, "{} bytes", source.len());
        assert!(source.contains("plotly.js v"), "no plotly.js");
        assert!(!source.contains("<script type="), "more than one script");
    }

    #[test]
    fn the_parts_name_only_parts_that_there_are() {
        let known: Vec<&str> = PARTS.iter().map(|(path, ..)| *path).chain(["/plotly.js"]).collect();
        for (path, kind, contents) in PARTS.iter().filter(|(_, kind, _)| kind.contains("html")) {
            let parts = contents.split(['"', '\'']).filter(|text| {
                text.starts_with('/') && (text.ends_with(".js") || text.ends_with(".css"))
            });
            for part in parts {
                assert!(known.contains(&part), "{path} ({kind}) names {part}");
            }
            assert!(!contents.contains("://"), "{path} reaches out of the console");
        }
    }
}
