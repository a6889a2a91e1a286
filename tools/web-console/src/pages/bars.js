// Bars and light, as the subject sees them and the operator's page repeats them. Colours are told
// apart by position and label, too.

"use strict";

const Bars = (() => {
    // Draws into an element; returns the function that shows a view.
    function into(field) {
        field.classList.add("bars");
        field.innerHTML =
            '<div class="light"><i class="lamp"></i><span></span></div><div class="tracks"></div>';
        const lamp = field.querySelector(".lamp");
        const word = field.querySelector(".light span");
        const tracks = field.querySelector(".tracks");
        let labels = "";
        return (view) => {
            const light = view.light || "off";
            if (field.dataset.light !== light) {
                field.dataset.light = light;
                word.textContent = { green: "GO", red: "WAIT", off: "" }[light];
            }
            const wanted = view.bars.map((bar) => bar.label).join("|");
            if (wanted !== labels) {
                labels = wanted;
                tracks.innerHTML = view.bars.map((bar) =>
                    `<div class="track ${bar.label}"><div class="field"><div class="fill"></div>` +
                    `<div class="target"></div></div><label>${bar.label}</label></div>`).join("");
            }
            tracks.querySelectorAll(".fill").forEach((fill, at) => {
                fill.style.transform = `scaleY(${view.bars[at].height})`;
            });
            tracks.dataset.heights = view.bars.map((bar) => bar.height.toFixed(3)).join(" ");
            tracks.classList.toggle("replay", view.replay);
            lamp.hidden = light === "off";
        };
    }
    return { into };
})();
