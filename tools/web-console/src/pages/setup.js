// The setup: which protocol, with which values. Values are checked by the console, which says what
// is wrong with which; a change asks for a new build.

"use strict";

const Setup = (() => {
    const element = (id) => document.getElementById(id);
    let entries = [];
    let build = null;
    // Rises with each change: an answer that comes after one is about something else.
    let changes = 0;
    // Rises with each protocol that is chosen: the newest answer counts.
    let asked = 0;

    function begin(protocols) {
        if (entries.length > 0) { return; }
        const chosen = localStorage.getItem("farreach.protocol") || "force-matching";
        element("protocol").replaceChildren(...protocols.map((name) => new Option(name, name)));
        element("protocol").value = protocols.includes(chosen) ? chosen : protocols[0];
        listPresets();
    }

    // Reads the values of the protocol that is chosen.
    async function describe(values) {
        const protocol = element("protocol").value;
        localStorage.setItem("farreach.protocol", protocol);
        stale();
        entries = [];
        // Rows of another protocol, or of an earlier answer, are no values of this one.
        element("entries").replaceChildren();
        asked += 1;
        const mine = asked;
        const answer = await Link.send({ do: "describe", protocol });
        if (mine !== asked) { return; }
        element("description").textContent = answer.ok ? answer.data.description : answer.text;
        entries = answer.ok ? arranged(answer.data.entries) : [];
        element("entries").replaceChildren(...entries.map((entry) => row(entry, values || {})));
    }

    // What is played comes first; name and description are the file's own.
    function arranged(all) {
        const place = (entry) => ["matching", "segments", "scanner", "emg", "protocol"]
            .indexOf(entry.path.split(".")[0]);
        return all.filter((entry) => !/^protocol\.(name|description)$/.test(entry.path))
            .sort((a, b) => place(a) - place(b));
    }

    function row(entry, values) {
        const line = document.createElement("label");
        line.className = "entry";
        line.dataset.path = entry.path;
        line.title = `${entry.path}: ${entry.about}`;
        const name = document.createElement("span");
        const parts = entry.path.split(".");
        // "emg save", "0 duration_s", "sets".
        name.textContent = parts.slice(parts[0] === "emg" ? 0 : 1).join(" ");
        const input = document.createElement("input");
        input.value = values[entry.path] ?? entry.value ?? "";
        input.placeholder = entry.default;
        input.autocomplete = "off";
        const limits = document.createElement("small");
        limits.textContent = entry.accepts;
        input.oninput = () => {
            line.classList.toggle("changed", input.value.trim() !== (entry.value ?? ""));
            wrong(line, entry, null);
            stale();
        };
        // What the file sets cannot be taken out, only changed.
        input.onchange = () => {
            if (input.value.trim() === "" && entry.value !== null) {
                input.value = entry.value;
                input.oninput();
            }
        };
        line.classList.toggle("changed", input.value !== (entry.value ?? ""));
        line.append(name, input, limits);
        return line;
    }

    function wrong(line, entry, text) {
        line.classList.toggle("wrong", text !== null);
        line.querySelector("small").textContent = text === null ? entry.accepts : text;
    }

    // What was built is not what the entries say any more.
    function stale() {
        changes += 1;
        build = null;
        element("problems").textContent = "";
    }

    // The values that differ from those of the file.
    function changed() {
        const values = {};
        for (const entry of entries) {
            const line = document.querySelector(`.entry[data-path="${CSS.escape(entry.path)}"]`);
            const value = line ? line.querySelector("input").value.trim() : "";
            if (value !== "" && value !== (entry.value ?? "")) { values[entry.path] = value; }
        }
        return values;
    }

    function request() {
        return {
            do: "build",
            protocol: element("protocol").value,
            entries: changed(),
            subject: element("subject").value.trim(),
            files: element("files").value.trim(),
            scanner: scanner(),
        };
    }

    // Where the scanner's pulses come from, as `farreach run` writes it in recordings.
    function scanner() {
        const source = element("pulses").value;
        return source === "emulated" ? element("emulate").value.trim() : source;
    }

    function showScanner(source) {
        const known = source === "line" || source === "key";
        element("pulses").value = known ? source : "emulated";
        if (!known) { element("emulate").value = source; }
        element("emulating").hidden = known;
    }

    // Builds what the entries say, or the protocol that was interrupted.
    async function send(what) {
        const { subject, files } = request();
        const setup = what === "interrupted" ? { do: what, subject, files } : request();
        const before = changes;
        const answer = await Link.send(setup);
        if (changes !== before) {
            return { ok: false, text: "a value was changed meanwhile; build again" };
        }
        build = answer.ok ? answer.data.build : null;
        element("problems").textContent = answer.ok ? "" : answer.text;
        for (const entry of entries) {
            const line = document.querySelector(`.entry[data-path="${CSS.escape(entry.path)}"]`);
            const problem = (answer.problems || []).find((it) => it.key === entry.path);
            if (line) { wrong(line, entry, problem ? problem.text : null); }
            if (line && problem) { line.scrollIntoView({ block: "nearest" }); }
        }
        return answer;
    }

    const presets = () => JSON.parse(localStorage.getItem("farreach.presets") || "{}");

    function listPresets() {
        const names = Object.keys(presets()).sort();
        element("preset").replaceChildren(new Option("presets", ""),
            ...names.map((name) => new Option(name, name)));
    }

    function keep() {
        const name = element("preset-name").value.trim() || element("protocol").value;
        const { protocol, entries: values, scanner: source } = request();
        const all = presets();
        all[name] = { protocol, values, scanner: source };
        localStorage.setItem("farreach.presets", JSON.stringify(all));
        listPresets();
    }

    function load(name) {
        const preset = presets()[name];
        if (!preset) { return; }
        element("protocol").value = preset.protocol;
        showScanner(preset.scanner ?? "line");
        describe(preset.values);
    }

    element("protocol").onchange = () => describe();
    element("preset").onchange = (event) => load(event.target.value);
    element("keep").onclick = keep;
    element("pulses").onchange = () => {
        element("emulating").hidden = element("pulses").value !== "emulated";
        stale();
    };
    for (const id of ["subject", "files", "emulate"]) { element(id).oninput = stale; }

    return { begin, describe, send, built: () => build, described: () => entries.length > 0 };
})();
