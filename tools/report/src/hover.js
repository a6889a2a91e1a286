// Beside the cursor: the values of the nearest point of a curve. The page works without it.
"use strict";
(() => {
  const NEAR = 90;                        // in fine pixels, five to a CSS pixel
  const told = document.createElement("div");
  told.className = "value";
  told.hidden = true;
  document.body.append(told);

  const scale = (text, from, to) => {
    const [kind, low, high] = text.split(" ");
    const share = (at) => (at - from) / (to - from);
    if (kind === "log") {
      return (at) => +low * Math.pow(high / low, share(at));
    }
    return (at) => +low + share(at) * (high - low);
  };

  // Points of all curves: lines with more than two vertices, and dots.
  const points = (svg) => {
    const all = [];
    for (const line of svg.querySelectorAll("polyline")) {
      const numbers = line.getAttribute("points").trim().split(/[\s,]+/).map(Number);
      if (numbers.length > 4) {
        const colour = line.getAttribute("stroke");
        for (let at = 0; at + 1 < numbers.length; at += 2) {
          all.push([numbers[at], numbers[at + 1], colour]);
        }
      }
    }
    for (const dot of svg.querySelectorAll("circle")) {
      const at = (name) => Number(dot.getAttribute(name));
      all.push([at("cx"), at("cy"), dot.getAttribute("fill")]);
    }
    return all;
  };

  const round = (value, range) => {
    const digits = Math.max(0, Math.min(12, 3 - Math.floor(Math.log10(range))));
    return Math.abs(value) < 1e-3 || range < 1e-3 ? value.toPrecision(4) : value.toFixed(digits);
  };

  // Dates are seconds since 1970.
  const shown = (text, value, range) => text.startsWith("dates")
    ? new Date(1000 * value).toISOString().slice(0, 16).replace("T", " ")
    : round(value, range);

  const prepare = (svg) => {
    const [left, right, top, bottom] = svg.dataset.frame.split(" ").map(Number);
    const x = scale(svg.dataset.x, left, right), y = scale(svg.dataset.y, bottom, top);
    let found = null;
    svg.addEventListener("mousemove", (event) => {
      found = found || points(svg);
      const at = new DOMPoint(event.clientX, event.clientY)
        .matrixTransform(svg.getScreenCTM().inverse());
      let best = null, least = NEAR * NEAR;
      for (const [px, py, colour] of found) {
        const away = (px - at.x) ** 2 + (py - at.y) ** 2;
        if (away < least && px >= left && px <= right && py >= top && py <= bottom) {
          [best, least] = [[px, py, colour], away];
        }
      }
      told.hidden = best === null;
      if (best !== null) {
        const spanX = Math.abs(x(right) - x(left)), spanY = Math.abs(y(top) - y(bottom));
        told.textContent = `${shown(svg.dataset.x, x(best[0]), spanX)}, `
          + shown(svg.dataset.y, y(best[1]), spanY);
        told.style.borderColor = best[2] || "";
        told.style.left = `${event.pageX + 14}px`;
        told.style.top = `${event.pageY - 30}px`;
      }
    });
    svg.addEventListener("mouseleave", () => { told.hidden = true; });
  };
  document.querySelectorAll("svg[data-frame]").forEach(prepare);
})();
