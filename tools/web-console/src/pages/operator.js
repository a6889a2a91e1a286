// The operator's page: shows what the console tells, and asks for what its buttons say.

"use strict";

const element = (id) => document.getElementById(id);
const mirror = Bars.into(element("mirror"));
let token = sessionStorage.getItem("farreach.token");
const EVENTS = 200;

let page = { number: 0, token: false, control: false };
let permitted = [];
let plan = [];

function takeHash() {
    const hash = new URLSearchParams(location.hash.slice(1));
    if (hash.has("signal")) { Plots.show(hash.getAll("signal")); }
    const given = hash.get("token");
    if (!given) { return; }
    token = given;
    sessionStorage.setItem("farreach.token", token);
    // The address bar may be seen by others.
    history.replaceState(null, "", location.pathname);
    if (page.number > 0) { Link.send({ do: "hello", token }); }
}

takeHash();
window.addEventListener("hashchange", takeHash);

function note(text, bad) {
    element("note").textContent = text;
    element("note").classList.toggle("bad", Boolean(bad));
}

function alarm(text) {
    element("alarm").textContent = text;
    element("alarm").hidden = text === "";
}

// --- what the operator does

async function ask(request) {
    const builds = request.do === "build" || request.do === "interrupted";
    const answer = builds ? await Setup.send(request.do) : await Link.send(request);
    element("answer").textContent = answer.text;
    element("answer").classList.toggle("bad", !answer.ok);
    return answer;
}

function requestOf(button) {
    if (button.dataset.verb) { return { do: "verb", verb: button.dataset.verb }; }
    switch (button.dataset.do) {
        case "start": return { do: "start", build: Setup.built() || "" };
        case "record": return { do: "record", file: element("file").value.trim() };
        case "note": return { do: "note", text: element("text").value.trim() };
        default: return { do: button.dataset.do };
    }
}

for (const button of document.querySelectorAll("[data-do], [data-verb]")) {
    button.onclick = async (event) => {
        event.preventDefault();
        const answer = await ask(requestOf(button));
        if (button.dataset.do === "note" && answer.ok) { element("text").value = ""; }
    };
}

// That a stop failed must not be overlooked: it stays until somebody clicks on it.
async function mustStop(request, what) {
    const answer = await ask(request);
    if (!answer.ok) {
        const time = new Date().toLocaleTimeString("en-GB");
        element("unstopped").textContent = `${time}: the ${what} FAILED: ${answer.text}. ` +
            "Use the rig's emergency button. (Click to close.)";
        element("unstopped").hidden = false;
    }
}

const stop = () => mustStop({ do: "stop" }, "stop");
const estop = () => mustStop({ do: "verb", verb: "estop" }, "emergency stop");
element("unstopped").onclick = () => { element("unstopped").hidden = true; };
element("stop").onclick = stop;
element("estop").onclick = estop;

// Escape stops; a second one within a second is the emergency stop.
let escaped = 0;
document.addEventListener("keydown", (event) => {
    // A key that is held, or that ends the input of a character, is none.
    if (event.key !== "Escape" || event.repeat || event.isComposing) { return; }
    event.preventDefault();
    const again = Link.now() - escaped < 1000;
    escaped = Link.now();
    if (again) { estop(); } else { stop(); }
});

// The scanner's trigger box is a keyboard that types 5 with every volume, into whatever has the
// focus: while a protocol takes its pulses from it, no field gets the character.
let takesKeys = false;
document.addEventListener("keydown", async (event) => {
    const page_ms = Link.now();
    if (event.key !== "5" || !takesKeys || !page.control) { return; }
    event.preventDefault();
    if (event.repeat || event.ctrlKey || event.altKey || event.metaKey) { return; }
    const answer = await Link.send({ do: "pulse", page_ms });
    if (!answer.ok) { note(answer.text, true); }
}, true);

// --- what the console tells

Link.on("open", () => {
    alarm("");
    if (token) { Link.send({ do: "hello", token }); }
});

Link.on("closed", (message) => {
    page = { number: 0, token: false, control: false };
    const why = message.reason ? ` (${message.reason})` : "";
    alarm(`No connection to the console${why}. What is shown is old. ` +
        "To stop the rig, use its emergency button, or `farreach estop` on its computer.");
    element("watchdog").dataset.state = "silent";
    element("watchdog").textContent = "no connection";
    permitted = [];
    enable();
});

Link.on("welcome", (message) => {
    element("rig").textContent = message.rig;
    element("rig").title = message.description;
    Setup.begin(message.protocols);
    Plots.begin(message.signals, element("pick"));
});

Link.on("access", (message) => {
    page.number = message.page;
    page.token = message.token;
    // Values that were typed stay when the connection comes back.
    if (page.token && !Setup.described()) { Setup.describe(); }
    enable();
});

function enable() {
    const can = (action) => permitted.includes(action);
    for (const button of document.querySelectorAll("[data-do], [data-verb]")) {
        const action = button.dataset.verb || button.dataset.do;
        const stops = action === "disarm";
        const builds = action === "interrupted" && can("build");
        const free = action === "refresh" || action === "take-control";
        button.disabled = !page.token || !(free || ((can(action) || builds) && (page.control || stops)));
    }
    element("start").disabled = element("start").disabled || !Setup.built();
    element("stop").disabled = !page.token || !can("stop");
    element("estop").disabled = !page.token;
    const take = document.querySelector('[data-do="take-control"]');
    take.hidden = !page.token || page.control;
    element("access").textContent = page.control ? "This page has control."
        : page.token ? "Another page has control, or none. This page may stop the rig."
            : "This page may watch only: it has no token (`farreach console`).";
}

Link.on("state", (message) => {
    const { rig, console: desk } = message;
    permitted = message.permitted;
    page.control = page.token && message.controller === page.number;
    const state = rig.watchdog || "silent";
    element("watchdog").dataset.state = state;
    element("watchdog").textContent = rig.watchdog === "enabled" ? "enabled: MOTOR ON" : state;
    element("handle").textContent = (rig.axes || []).map((axis) =>
        `${axis.name} ${axis.position === null ? "?" : axis.position.toFixed(1)} ${axis.unit}` +
        (axis.homed ? "" : ", NOT HOMED") +
        (axis.range_not_in_force ? ", RANGE OF MOTION NOT IN FORCE" : ""))
        .join("   ");
    const faults = rig.faults.length > 0 ? `active: ${rig.faults.join(", ")}` : "no active fault";
    element("interlocks").textContent = rig.cause ? `cause: ${rig.cause}; ${faults}` : faults;
    Model.show(rig.model);
    showRun(desk);
    showRecording(desk.recording);
    element("losses").dataset.lost = message.lost;
    enable();
});

function showRun(desk) {
    const playing = desk.playing;
    takesKeys = Boolean(playing && playing.takes_keys);
    timeline(playing);
    if (playing) {
        const away = playing.absent ? " (the experiment process is restarting)" : "";
        note(`${playing.label || playing.name}${away}`);
        scanner(playing.scan);
    } else if (desk.finishing) {
        note("the session files are being written");
    } else if (desk.elsewhere) {
        note(`${desk.elsewhere.name} is played by another program: ${desk.elsewhere.label}`);
    } else {
        const last = desk.last ? desk.last.text : "";
        const built = desk.built ? `${desk.built.name} is built` : "";
        note([last, built].filter((text) => text).join("; "), desk.last && !desk.last.well);
    }
}

function scanner(scan) {
    const field = element("scanner");
    if (!scan) {
        field.replaceChildren();
        field.classList.remove("alarm");
        return;
    }
    const number = document.createElement("strong");
    const of = scan.expected > 0 ? ` of ${scan.expected}` : "";
    const key = takesKeys ? ", key 5" : "";
    number.textContent = `${scan.volumes + scan.missed}${of} volumes${key}`;
    const troubles = [[scan.missed, "without a pulse"], [scan.spurious, "spurious pulses"],
        [scan.surplus, "pulses after the last volume"], [scan.overdue, "OVERDUE"]]
        .filter(([count]) => count > 0).map(([count, what]) => `${count} ${what}`);
    field.classList.toggle("alarm", troubles.length > 0);
    field.replaceChildren(number, troubles.join(", ") || "no pulse missed, none spurious");
}

Link.on("plan", (message) => {
    plan = message.segments;
    const total = plan.reduce((sum, segment) => sum + segment.duration_s, 0) || 1;
    element("timeline").title = message.name;
    element("timeline").replaceChildren(...plan.map((segment) => {
        const part = document.createElement("div");
        part.style.width = `${100 * segment.duration_s / total}%`;
        part.textContent = segment.label;
        part.title = `${segment.label}, ${segment.duration_s.toFixed(1)} s`;
        part.classList.toggle("session", segment.session);
        return part;
    }));
});

function timeline(playing) {
    [...element("timeline").children].forEach((part, at) => {
        part.classList.toggle("past", Boolean(playing) && at < playing.segment - 1);
        part.classList.toggle("now", Boolean(playing) && at === playing.segment - 1);
    });
}

Link.on("bar", (message) => {
    mirror(message.view);
    element("instruction").textContent = message.view.instruction;
});

function showRecording(recording) {
    const field = element("recording");
    if (!recording) {
        field.textContent = "the logger does not answer";
    } else if (recording.file) {
        const count = recording.written.toLocaleString("en");
        field.textContent = `${recording.file}: ${count} messages, ${recording.lost} lost`;
    } else {
        field.textContent = recording.error || "NOTHING IS RECORDED";
    }
}

Link.on("sessions", (message) => {
    const numbers = (values) => (values || []).map((value) => value.toPrecision(3)).join(" ");
    const rows = message.reports.map((report) => {
        const row = document.createElement("tr");
        const missing = report.samples_missed > 0 ? `${report.samples_missed} samples` : "none";
        row.classList.toggle("bad", report.outcome !== "whole" || report.samples_missed > 0);
        const cells = [report.label || `${report.number} of ${report.of}`, report.outcome,
            numbers(report.mean_torque), numbers(report.target), numbers(report.value),
            numbers(report.tracking_error), missing];
        row.append(...cells.map((text) => {
            const cell = document.createElement("td");
            cell.textContent = text;
            return cell;
        }));
        return row;
    });
    element("sessions").tBodies[0].replaceChildren(...rows);
    element("written").replaceChildren(...message.files.map((file) => {
        const item = document.createElement("li");
        item.textContent = file.path || file.error;
        item.classList.toggle("error", Boolean(file.error));
        return item;
    }));
});

Link.on("status", (message) => {
    const wrong = message.error || message.status.unread;
    alarm(wrong ? `The rig cannot be read: ${wrong}` : "");
    if (message.error) { return; }
    const { status } = message;
    const rows = status.processes.map((process) => {
        const row = document.createElement("tr");
        const late = process.wake_late_us ? process.wake_late_us.p99 : null;
        const silent = process.heartbeat_age_ms > 1500 && process.name !== "keeper";
        row.classList.toggle("bad", process.state !== "ready" || silent);
        row.classList.toggle("warning", process.restarts > 0);
        const cells = [process.name, process.state || "", process.rate_hz, process.missed_periods,
            late, process.lost];
        row.append(...cells.map((value) => {
            const cell = document.createElement("td");
            cell.textContent = typeof value === "number" ? Math.round(value) : value ?? "";
            return cell;
        }));
        return row;
    });
    element("processes").tBodies[0].replaceChildren(...rows);
    const lost = status.losses.map((loss) =>
        `${loss.topic}: ${loss.gaps + loss.dropped + loss.refused}`);
    const here = Number(element("losses").dataset.lost || 0);
    element("losses").textContent =
        `recording: ${lost.length > 0 ? `LOST ${lost.join(", ")}` : "nothing lost"}` +
        (here > 0 ? `; console: ${here} messages missed or refused` : "");
    element("losses").classList.toggle("bad", lost.length > 0);
});

Link.on("page-clock", (message) => {
    if (message.kind !== "subject" || message.delay_ms === null) { return; }
    element("delay").textContent = `subject's page ${message.page}: sample to frame ` +
        `${message.delay_ms.toFixed(0)} ms (median of ${message.frames}), ` +
        `${message.longest_ms.toFixed(0)} ms at most; clock known to ` +
        `±${(message.round_trip_ms / 2).toFixed(1)} ms`;
});

Link.on("plot", (message) => Plots.take(message.batch));
Link.on("innovation", (message) => Model.take(message.axis, message.batch));

Link.on("event", (event) => {
    if (event.kind === "beat") { return; }
    const item = document.createElement("li");
    const time = document.createElement("time");
    time.textContent = new Date(Date.now() - event.age_ms).toLocaleTimeString("en-GB");
    item.className = event.severity;
    item.append(time, `${event.source}: ${event.kind}${event.text ? ` — ${event.text}` : ""}`);
    element("events").prepend(item);
    while (element("events").children.length > EVENTS) { element("events").lastChild.remove(); }
});

enable();
Link.open("operator");
