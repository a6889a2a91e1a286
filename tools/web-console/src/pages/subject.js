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

// Sounds: a tone for each beat, a higher and a lower one for a session's beginning and end.
let audio = null;
document.getElementById("sound").onchange = (event) => {
    audio = event.target.checked ? new AudioContext() : null;
};

function tone(frequency, duration) {
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
}

Link.on("event", (event) => {
    // What lies further back is no beat for now: a console that was started again is told the last
    // events.
    if (event.age_ms > 300) { return; }
    if (event.kind === "beat") { tone(880, 0.06); }
    if (event.kind === "session started") { tone(660, 0.4); }
    if (event.kind === "session over") { tone(330, 0.4); }
});

document.getElementById("full").onclick = () => document.documentElement.requestFullscreen();

show(empty);
Link.open("subject");
