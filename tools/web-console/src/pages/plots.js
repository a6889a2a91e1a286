// Live plots: twelve seconds of the picked signals, each with its least and largest value of every
// 20 ms.

"use strict";

const Plots = (() => {
    const SHOWN_S = 12;
    // Redrawn at most so often (ms): drawing must not take the processors from a rig that has no
    // real-time scheduling.
    const PERIOD = 250;
    const KEPT = "farreach.signals";
    let signals = [];
    let list = null;
    let picked = new Set();
    let batches = [];
    let drawn = 0;

    function begin(all, pick) {
        signals = all;
        list = pick;
        batches = [];
        const kept = JSON.parse(localStorage.getItem(KEPT) || "null");
        const usual = all.filter((signal) => signal.unit !== "V" || signal.name.endsWith("_motor"))
            .slice(0, 4).map((signal) => signal.name);
        picked = new Set((kept || usual).filter((name) => all.some((it) => it.name === name)));
        pick.replaceChildren(...all.map((signal) => {
            const label = document.createElement("label");
            const box = document.createElement("input");
            box.type = "checkbox";
            box.checked = picked.has(signal.name);
            box.onchange = () => {
                if (box.checked) { picked.add(signal.name); } else { picked.delete(signal.name); }
                localStorage.setItem(KEPT, JSON.stringify([...picked]));
                draw();
            };
            label.append(box, ` ${signal.name}`);
            return label;
        }));
    }

    // Shows these signals and no others (`farreach probe plot`).
    function show(names) {
        localStorage.setItem(KEPT, JSON.stringify(names));
        if (list) { begin(signals, list); }
    }

    function take(batch) {
        const newest = batch.t_s[batch.t_s.length - 1];
        const last = batches.length > 0 ? batches[batches.length - 1].t_s[0] : 0;
        // A console that was started again counts anew.
        if (newest < last) { batches = []; }
        batches.push(batch);
        while (batches[0].t_s[0] < newest - SHOWN_S) { batches.shift(); }
        if (!document.hidden && Link.now() - drawn > PERIOD) { draw(); }
    }

    function trace(at, axis) {
        const degrees = signals[at].unit === "rad" ? 180 / Math.PI : 1;
        const x = [];
        const y = [];
        for (const batch of batches) {
            batch.t_s.forEach((t, bin) => {
                const [least, largest] = [batch.least[at][bin], batch.largest[at][bin]];
                x.push(t, t);
                y.push(least === null ? null : least * degrees,
                    largest === null ? null : largest * degrees);
            });
        }
        return { x, y, name: signals[at].name, mode: "lines", line: { width: 1 },
            yaxis: axis === 1 ? "y" : `y${axis}`, hoverinfo: "skip" };
    }

    function draw() {
        drawn = Link.now();
        if (batches.length === 0) { return; }
        const shown = signals.map((_, at) => at).filter((at) => picked.has(signals[at].name));
        const units = [...new Set(shown.map((at) => signals[at].unit))];
        const end = batches[batches.length - 1].t_s.slice(-1)[0];
        const layout = {
            margin: { l: 52, r: 8, t: 6, b: 30 }, showlegend: true, uirevision: "same",
            legend: { orientation: "h", y: 1.08, font: { size: 11 } },
            font: { size: 11 }, paper_bgcolor: "#fff", plot_bgcolor: "#fff",
            xaxis: { range: [end - SHOWN_S, end], title: { text: "s" }, gridcolor: "#e6eaee" },
        };
        units.forEach((unit, at) => {
            const height = 1 / units.length;
            layout[at === 0 ? "yaxis" : `yaxis${at + 1}`] = {
                domain: [1 - (at + 1) * height + 0.03, 1 - at * height - 0.03],
                title: { text: unit === "rad" ? "°" : unit }, gridcolor: "#e6eaee",
                zerolinecolor: "#b9c2cc",
            };
        });
        // Below the lowest plot.
        layout.xaxis.anchor = units.length > 1 ? `y${units.length}` : "y";
        const traces = shown.map((at) => trace(at, units.indexOf(signals[at].unit) + 1));
        Plotly.react("plots", traces, layout, { displayModeBar: false, responsive: true });
    }

    return { begin, show, take };
})();
