// The subject's page: the newest view is drawn with the next frame, and nothing moves between.

"use strict";

const show = Bars.into(document.getElementById("view"));
const instruction = document.getElementById("instruction");
const noConnection = document.getElementById("no-connection");
const empty = { light: null, bars: [], replay: false, instruction: "", at_ms: 0 };
// How often the console is told when a frame was drawn (ms).
const TOLD_EVERY = 200;

let newest = null;
let told = 0;

function draw() {
    if (!newest) { return; }
    const view = newest;
    newest = null;
    show(view);
    if (instruction.textContent !== view.instruction) {
        instruction.textContent = view.instruction;
    }
    if (view.at_ms > 0 && Link.now() - told > TOLD_EVERY) {
        told = Link.now();
        // The frame that holds this is on its way to the screen when the next one is begun.
        requestAnimationFrame(() => {
            Link.send({ do: "shown", at_ms: view.at_ms, page_ms: Link.now() });
        });
    }
}

function plan(view) {
    if (!newest) { requestAnimationFrame(draw); }
    newest = view;
}

Link.on("open", () => { noConnection.hidden = true; });
Link.on("closed", () => {
    noConnection.hidden = false;
    plan(empty);
});
Link.on("bar", (message) => plan(message.view));

// Sounds: a tone for each beat, a higher and a lower one for a session's beginning and end, and
// those that the protocol names. The console records when each was made.
let audio = null;
document.getElementById("sound").onchange = (event) => {
    audio = event.target.checked ? new AudioContext() : null;
};

function tone(event, frequency, duration) {
    if (!audio) { return; }
    const oscillator = audio.createOscillator();
    const gain = audio.createGain();
    const end = audio.currentTime + duration;
    oscillator.frequency.value = frequency;
    gain.gain.setValueAtTime(0.2, audio.currentTime);
    gain.gain.exponentialRampToValueAtTime(0.001, end);
    oscillator.connect(gain).connect(audio.destination);
    oscillator.start();
    oscillator.stop(end);
    const latency_ms = 1e3 * (audio.outputLatency || audio.baseLatency || 0);
    const page_ms = Link.now() + latency_ms;
    Link.send({ do: "sounded", event: event.kind, at_ms: event.at_ms, page_ms });
}

Link.on("event", (event) => {
    // What lies further back is no beat for now: a console that was started again is told the last
    // events.
    if (event.age_ms > 300) { return; }
    switch (event.kind) {
        case "beat": return tone(event, 880, 0.06);
        case "session started": return tone(event, 660, 0.4);
        case "session over": return tone(event, 330, 0.4);
        case "sound": return tone(event, { high: 880, middle: 550, low: 330 }[event.text], 0.25);
    }
});

document.getElementById("full").onclick = () => document.documentElement.requestFullscreen();

show(empty);
Link.open("subject");
