// The model beside the machine: a line for each axis as `farreach status` has it, a banner while
// the machine has departed from its model, and the innovations (measured less modelled position)
// of the last minute. Nothing is shown where no monitor runs.

"use strict";

const Model = (() => {
    const SHOWN_S = 60;
    // Bins further apart have a gap between them (s).
    const GAP_S = 1;
    const SVG = "http://www.w3.org/2000/svg";
    // Signals of a batch, in its order.
    const SIDES = ["master", "slave"];
    const axes = new Map();

    function add(name, parent, attributes) {
        const made = document.createElementNS(SVG, name);
        Object.entries(attributes).forEach(([key, value]) => made.setAttribute(key, value));
        parent.append(made);
        return made;
    }

    // The line and the plot of an axis.
    function axisOf(index) {
        if (!axes.has(index)) {
            const field = document.createElement("div");
            const line = document.createElement("p");
            // Time to the right, from a minute ago to now; upwards 1 is the largest value shown.
            const plot = document.createElementNS(SVG, "svg");
            plot.setAttribute("viewBox", `0 -1.1 ${SHOWN_S} 2.2`);
            plot.setAttribute("preserveAspectRatio", "none");
            plot.setAttribute("hidden", "");
            add("line", plot, { x1: 0, x2: SHOWN_S, y1: 0, y2: 0 });
            const paths = SIDES.map((side) => add("path", plot, { class: side }));
            const scale = document.createElement("small");
            field.append(line, plot, scale);
            document.getElementById("model").append(field);
            axes.set(index, { line, plot, paths, scale, bins: [] });
        }
        return axes.get(index);
    }

    // Texts that stay are left alone, so that a screen reader does not begin anew.
    function say(field, text) {
        if (field.textContent !== text) { field.textContent = text; }
    }

    function show(list) {
        document.getElementById("model").hidden = list.length === 0;
        for (const { axis, state, text } of list) {
            const { line } = axisOf(axis);
            line.dataset.state = state;
            say(line, text);
        }
        const departed = list.filter((axis) => axis.departed).map((axis) => axis.text);
        const banner = document.getElementById("departed");
        say(banner, `The machine is not as its model. ${departed.join("; ")}`);
        banner.hidden = departed.length === 0;
    }

    function take(index, batch) {
        const axis = axisOf(index);
        const { bins } = axis;
        // A console that was started again counts anew.
        if (bins.length > 0 && batch.t_s[0] < bins[bins.length - 1].t_s) { bins.length = 0; }
        batch.t_s.forEach((t_s, at) => bins.push({ t_s,
            least: batch.least.map((side) => side[at]),
            largest: batch.largest.map((side) => side[at]) }));
        const end = bins[bins.length - 1].t_s;
        while (bins[0].t_s < end - SHOWN_S) { bins.shift(); }
        if (!document.hidden) { draw(axis); }
    }

    // A band from the least to the largest value of each bin, interrupted where bins are missing.
    function band(bins, side, begin, full) {
        const parts = [];
        let part = [];
        let last = null;
        for (const bin of bins) {
            if (bin.least[side] === null) { continue; }
            if (last !== null && bin.t_s - last > GAP_S) { parts.push(part); part = []; }
            last = bin.t_s;
            part.push(bin);
        }
        parts.push(part);
        const point = (t_s, value) =>
            `${(t_s - begin).toFixed(2)} ${(-value / full).toFixed(4)}`;
        return parts.filter((bins) => bins.length > 1).map((bins) => {
            const above = bins.map((bin) => point(bin.t_s, bin.largest[side]));
            const below = bins.map((bin) => point(bin.t_s, bin.least[side])).reverse();
            return `M${[...above, ...below].join("L")}Z`;
        }).join("");
    }

    function draw({ bins, plot, paths, scale }) {
        const values = bins.flatMap((bin) => [...bin.least, ...bin.largest])
            .filter((value) => value !== null).map(Math.abs);
        const full = Math.max(1e-6, ...values);
        const begin = bins[bins.length - 1].t_s - SHOWN_S;
        paths.forEach((path, side) => path.setAttribute("d", band(bins, side, begin, full)));
        plot.removeAttribute("hidden");
        if (scale.childElementCount === 0) {
            const words = SIDES.map((side) => {
                const word = document.createElement("b");
                word.className = side;
                word.textContent = side;
                return word;
            });
            scale.append("innovation of ", words[0], " and ", words[1], document.createTextNode(""));
        }
        say(scale.lastChild, `, last minute, ±${full.toPrecision(2)}°`);
    }

    return { show, take };
})();
