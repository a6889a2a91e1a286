// The connection of a page to the console: it reconnects by itself, answers the console's clock,
// and hands each message to the function that is registered for its type.

"use strict";

const Link = (() => {
    const handlers = {};
    const waiting = new Map();
    let socket = null;
    let number = 0;
    let path = "";
    let silentSince = 0;

    // The page's clock (ms): monotonic, as far as the browser's is.
    const now = () => performance.timeOrigin + performance.now();

    const on = (type, handler) => { handlers[type] = handler; };
    const call = (type, message) => { if (handlers[type]) { handlers[type](message); } };

    function open(page) {
        path = `ws://${location.host}/ws?page=${page}`;
        connect();
        // A connection that is there and silent is a lost one: the console speaks every second.
        setInterval(() => {
            // So is one that does not come about.
            if (socket && socket.readyState <= WebSocket.OPEN && now() - silentSince > 4000) {
                socket.close();
            }
        }, 1000);
    }

    function connect() {
        const mine = new WebSocket(path);
        socket = mine;
        silentSince = now();
        mine.onopen = () => call("open", {});
        mine.onmessage = (event) => {
            silentSince = now();
            const message = JSON.parse(event.data);
            if (message.type === "clock") {
                send({ do: "echo", server_ms: message.server_ms, page_ms: now() });
            } else if (message.type === "answer" && waiting.has(message.id)) {
                const done = waiting.get(message.id);
                waiting.delete(message.id);
                done(message.answer);
            } else {
                call(message.type, message);
            }
        };
        mine.onclose = (event) => {
            for (const done of waiting.values()) {
                done({ ok: false, text: "no connection to the console" });
            }
            waiting.clear();
            call("closed", { reason: event.reason });
            setTimeout(connect, 500);
        };
    }

    // Sends a request; the promise is kept when it is answered. Nothing is sent later by itself:
    // what an operator asked for before a connection was lost must not happen after.
    function send(request) {
        number += 1;
        const id = number;
        if (!socket || socket.readyState !== WebSocket.OPEN) {
            return Promise.resolve({ ok: false, text: "no connection to the console" });
        }
        socket.send(JSON.stringify({ id, request }));
        if (["echo", "shown", "sounded"].includes(request.do)) {
            return Promise.resolve({ ok: true, text: "" });
        }
        return new Promise((done) => waiting.set(id, done));
    }

    return { open, on, send, now };
})();
