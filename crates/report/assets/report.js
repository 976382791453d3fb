"use strict";
// Draws the plots of a report from the numbers in its #data. Names from files reach the
// page as text only: textContent here, and `plain` for Plotly, which would read tags in them.
(() => {
  const data = JSON.parse(document.getElementById("data").textContent);
  // Colours for colour-blind readers, on a light and on a dark page; paper is light.
  const night = window.matchMedia("(prefers-color-scheme: dark)");
  const LIGHT = { colours: ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#b07c00", "#3a8fc2", "#000000"], pale: ["#9cc6e3", "#f3c29d"],
    ink: "#1c1c1c", paper: "#fff", grid: "#e4e4e4", zero: "#999", frame: "#222", partly: "#e6e6e6", wholly: "#fbe9ea" };
  const DARK = { colours: ["#56b4e9", "#ff9350", "#2fd0a3", "#e79ac4", "#e8c04a", "#9bd1f2", "#ffffff"], pale: ["#2f5d7a", "#7a4a2c"],
    ink: "#e8e8e8", paper: "#16181a", grid: "#33383d", zero: "#777", frame: "#999", partly: "#2b2f33", wholly: "#3a2628" };
  const look = night.matches ? DARK : LIGHT;
  const COLOURS = look.colours;
  const DASHES = ["solid", "dash", "dot", "dashdot", "longdash", "longdashdot"];
  const PALE = look.pale;
  const NARROW = window.matchMedia("(max-width: 40rem)").matches;
  const plain = (text) => String(text).replace(/&/g, "&amp;").replace(/</g, "&lt;").replace(/>/g, "&gt;");
  const withUnit = (name, unit) => plain(unit ? `${name} (${unit})` : name);
  const axis = (title, more) => ({ title: { text: title }, automargin: true, zerolinecolor: look.zero, gridcolor: look.grid,
    linecolor: look.frame, mirror: true, ...more });
  const layout = (more) => ({ font: { family: "system-ui, DejaVu Sans, Verdana, sans-serif", size: NARROW ? 11 : 12, color: look.ink },
    margin: { l: 56, r: 12, t: 12, b: 44 }, showlegend: false, hovermode: "closest", paper_bgcolor: look.paper, plot_bgcolor: look.paper,
    dragmode: NARROW ? "pan" : "zoom", ...more });
  const CONFIG = { responsive: true, displaylogo: false, scrollZoom: true, showSendToCloud: false,
    modeBarButtonsToRemove: ["select2d", "lasso2d"], toImageButtonOptions: { format: "svg" } };

  // A button for every group of traces: the legend, for mouse, finger and keyboard.
  function draw(id, traces, more) {
    const plot = document.getElementById(id);
    const keys = plot.parentNode.querySelector(".keys");
    const groups = new Map();
    traces.forEach((trace, at) => {
      const name = trace.key;
      if (name === undefined) return;
      if (!groups.has(name)) groups.set(name, []);
      groups.get(name).push(at);
    });
    const clean = traces.map(({ key, swatch, ...trace }) => ({ name: plain(key ?? ""), ...trace }));
    for (const [name, at] of groups) {
      const button = document.createElement("button");
      button.type = "button";
      button.setAttribute("aria-pressed", "true");
      const swatch = document.createElement("span");
      swatch.className = "swatch";
      const { colour, dash } = traces[at[0]].swatch;
      swatch.style.borderTopColor = colour;
      swatch.style.borderTopStyle = dash === "solid" ? "solid" : dash === "dot" ? "dotted" : "dashed";
      button.append(swatch, name);
      button.addEventListener("click", () => {
        const shown = button.getAttribute("aria-pressed") !== "true";
        button.setAttribute("aria-pressed", String(shown));
        Plotly.restyle(plot, { visible: shown }, at);
      });
      keys.append(button);
    }
    // Zoom without a mouse.
    const act = (label, title, action) => {
      const button = document.createElement("button");
      button.type = "button";
      button.textContent = label;
      button.setAttribute("aria-label", `${title}: ${plot.getAttribute("aria-label")}`);
      button.title = title;
      button.addEventListener("click", action);
      keys.append(button);
    };
    const move = (shift, factor) => () => {
      const [low, high] = plot._fullLayout.xaxis.range.map(Number);
      const middle = (low + high) / 2 + shift * (high - low), half = (factor * (high - low)) / 2;
      Plotly.relayout(plot, { "xaxis.range": [middle - half, middle + half] });
    };
    if (more.zoom !== false) {
      act("+", "zoom in", move(0, 0.5));
      act("\u2212", "zoom out", move(0, 2));
      act("\u2190", "to the left", move(-0.25, 1));
      act("\u2192", "to the right", move(0.25, 1));
    }
    act("reset", "show all", () => {
      const all = {};
      for (const name of Object.keys(plot._fullLayout)) if (/^[xy]axis\d*$/.test(name)) all[`${name}.autorange`] = true;
      Object.assign(all, more.reset ?? {});
      Plotly.relayout(plot, all);
    });
    act("data", "save the numbers as CSV", () => save(`${id}.csv`, more.table));
    const { reset, zoom, table, ...rest } = more;
    return Plotly.newPlot(plot, clean, layout(rest), CONFIG);
  }

  // Writes named columns as a CSV file.
  function save(name, table) {
    const field = (value) => {
      const text = value === null || value === undefined ? "" : String(value);
      return /[",\r\n]/.test(text) ? `"${text.replace(/"/g, '""')}"` : text;
    };
    const columns = Object.entries(table).filter(([, values]) => values);
    const rows = Math.max(0, ...columns.map(([, values]) => values.length));
    const lines = [columns.map(([title]) => field(title)).join(",")];
    for (let row = 0; row < rows; row++) lines.push(columns.map(([, values]) => field(values[row])).join(","));
    const link = document.createElement("a");
    link.href = URL.createObjectURL(new Blob([lines.join("\n") + "\n"], { type: "text/csv" }));
    link.download = name;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10000);
  }
  const titled = (name, unit) => (unit ? `${name} (${unit})` : name);

  // Means with their intervals, stacked vertically.
  function effect(id, { quantity, unit, reference, conditions }) {
    const traces = conditions.map((c, at) => {
      const colour = COLOURS[at % COLOURS.length];
      const spread = c.low === null ? undefined
        : { type: "data", symmetric: false, array: [c.high - c.mean], arrayminus: [c.mean - c.low], color: colour, thickness: 2, width: 6 };
      return { type: "scatter", mode: "markers", key: c.name, swatch: { colour, dash: "solid" }, x: [c.mean], y: [-at],
        error_x: spread, marker: { color: colour, size: 10 }, text: [plain(c.text)], hovertemplate: "%{text}<extra></extra>" };
    });
    const ticks = { tickmode: "array", tickvals: conditions.map((_, i) => -i), ticktext: conditions.map((c) => plain(c.name.length > 18 ? `${c.name.slice(0, 17)}…` : c.name)) };
    const range = [-conditions.length + 0.4, 0.6];
    const title = titled(reference ? `${quantity} less that of ${reference}` : quantity, unit);
    const rest = { "yaxis.autorange": false, "yaxis.range": range };
    const table = { condition: conditions.map((c) => c.name), trials: conditions.map((c) => c.trials), [title]: conditions.map((c) => c.mean),
      low_95: conditions.map((c) => c.low), high_95: conditions.map((c) => c.high) };
    return draw(id, traces, { xaxis: axis(plain(title), { zeroline: true, zerolinewidth: 2 }), yaxis: axis("", { ...ticks, zeroline: false, range }),
      reset: rest, table });
  }

  const line = (key, x, y, colour, dash, more) => ({ type: "scatter", mode: "lines", key, x, y,
    swatch: { colour, dash }, line: { color: colour, dash, width: 1.8 }, ...more });

  function box(id, { quantity, unit, conditions }) {
    const traces = [];
    conditions.forEach((c, at) => {
      const colour = COLOURS[at % COLOURS.length];
      const swatch = { colour, dash: "solid" };
      traces.push({ type: "box", key: c.name, swatch, x: [at], q1: [c.q1], median: [c.median], q3: [c.q3], mean: [c.mean],
        lowerfence: [c.low], upperfence: [c.high], width: 0.5, boxpoints: false, line: { color: colour, width: 1.6 } });
      const spread = c.values.map((_, i) => at + 0.36 + 0.1 * (((i * 0.618034) % 1) - 0.5));
      traces.push({ type: "scatter", mode: "markers", key: c.name, swatch, x: spread, y: c.values, text: c.labels.map(plain),
        hovertemplate: "%{text}<br>%{y:.5g}<extra></extra>", marker: { color: colour, size: c.values.length > 60 ? 3 : 6, opacity: 0.65 } });
    });
    const ticks = { tickmode: "array", tickvals: conditions.map((_, i) => i), ticktext: conditions.map((c) => plain(c.name.length > 14 ? `${c.name.slice(0, 13)}…` : c.name)) };
    return draw(id, traces, { xaxis: axis("", { ...ticks, zeroline: false, range: [-0.6, conditions.length - 0.3] }),
      table: { condition: conditions.flatMap((c) => c.values.map(() => c.name)), of: conditions.flatMap((c) => c.labels),
        [titled(quantity, unit)]: conditions.flatMap((c) => c.values) },
      zoom: false, yaxis: axis(withUnit(quantity, unit)), reset: { "xaxis.autorange": false, "xaxis.range": [-0.6, conditions.length - 0.3] } });
  }

  function phase(id, { quantity, conditions }) {
    const traces = [];
    const turn = 2 * Math.PI;
    conditions.forEach((c, at) => {
      const colour = COLOURS[at % COLOURS.length], dash = DASHES[at % DASHES.length], swatch = { colour, dash };
      const band = { type: "scatter", mode: "lines", key: c.name, swatch, x: c.phase_rad, line: { width: 0 }, hoverinfo: "skip" };
      traces.push({ ...band, y: c.mean.map((m, i) => m - c.sd[i]) });
      traces.push({ ...band, y: c.mean.map((m, i) => m + c.sd[i]), fill: "tonexty", fillcolor: colour + "22" });
      traces.push(line(c.name, c.phase_rad, c.mean, colour, dash, { hovertemplate: "%{x:.2f} rad<br>%{y:.4f} N" }));
    });
    const ticks = { tickmode: "array", tickvals: [0, 1, 2, 3, 4].map((q) => (q * turn) / 4), ticktext: ["0", "π/2", "π", "3π/2", "2π"] };
    return draw(id, traces, { xaxis: axis("right leg angle (rad)", { ...ticks, range: [0, turn], zeroline: false }),
      table: { condition: conditions.flatMap((c) => c.phase_rad.map(() => c.name)), phase_rad: conditions.flatMap((c) => c.phase_rad),
        [`mean_${quantity}_n`]: conditions.flatMap((c) => c.mean), sd_n: conditions.flatMap((c) => c.sd) },
      yaxis: axis(withUnit(quantity, "N")), reset: { "xaxis.autorange": false, "xaxis.range": [0, turn] } });
  }

  const shade = ({ partly, wholly }) => [...partly.map((s) => [s, look.partly]), ...(wholly ? [[wholly, look.wholly]] : [])]
    .map(([[x0, x1], fillcolor]) => ({ type: "rect", xref: "x", yref: "paper", x0, x1, y0: 0, y1: 1, fillcolor, line: { width: 0 }, layer: "below" }));

  function forces(id, trial) {
    const traces = [];
    [["drag", "drag_n", "drag_stride_n", "solid"], ["lift", "lift_n", "lift_stride_n", "dash"]].forEach(([name, raw, mean, dash], at) => {
      const colour = COLOURS[at];
      if (!trial[mean]) { traces.push(line(name, trial.t_s, trial[raw], colour, dash)); return; }
      traces.push(line(`${name}, every frame`, trial.t_s, trial[raw], PALE[at], "solid", { line: { color: PALE[at], width: 1 } }));
      traces.push(line(`${name}, stride mean`, trial.t_s, trial[mean], colour, dash));
    });
    const { t_s, drag_n, lift_n, drag_stride_n, lift_stride_n } = trial;
    return draw(id, traces, { shapes: shade(trial), xaxis: axis("time (s)"), yaxis: axis("force (N)"),
      table: { t_s, drag_n, lift_n, drag_stride_n, lift_stride_n } });
  }

  function stack(id, numbers) {
    const { drag_n, lift_n } = numbers;
    const trial = { ...numbers, fx_n: drag_n && drag_n.map((drag) => (drag === null ? null : -drag)), fz_n: lift_n };
    const rows = [];
    [["Fx", "fx_n"], ["Fy", "fy_n"], ["Fz", "fz_n"]].forEach(([name, key]) => {
      if (trial[key]) rows.push([`${name} (N)`, [[name, trial[key], 0, "solid"]]]);
    });
    const pair = (title, right, left) => {
      const both = [["right", trial[right], 0, "solid"], ["left", trial[left], 1, "dash"]].filter((side) => side[1]);
      if (both.length) rows.push([title, both.map(([side, values, ...pen]) => [`${side} ${title.split(" (")[0]}`, values, ...pen])]);
    };
    pair("leg angle (rad)", "right_leg_rad", "left_leg_rad");
    pair("power (W)", "right_power_w", "left_power_w");
    if (trial.power_w) rows.push(["power (W)", [["power", trial.power_w, 0, "solid"]]]);
    const traces = [], axes = {};
    const height = 1 / Math.max(rows.length, 1);
    rows.forEach(([title, lines], at) => {
      const suffix = at === 0 ? "" : String(at + 1);
      const top = 1 - at * height;
      axes[`yaxis${suffix}`] = axis(title, { domain: [top - 0.86 * height, top] });
      for (const [name, values, pen, dash] of lines)
        traces.push(line(name, trial.t_s, values, COLOURS[pen], dash, { yaxis: `y${suffix}`, connectgaps: false, line: { color: COLOURS[pen], dash, width: 1.2 } }));
    });
    axes.xaxis = axis("time (s)", { anchor: `y${rows.length > 1 ? rows.length : ""}` });
    const { partly, wholly, ...table } = trial;
    return draw(id, traces, { ...axes, shapes: shade(trial), hovermode: "x", table });
  }

  const drawn = [];
  data.effects.forEach((plot, at) => drawn.push(effect(`effect-${at}`, plot)));
  data.boxes.forEach((plot, at) => drawn.push(box(`box-${at}`, plot)));
  data.phases.forEach((plot, at) => drawn.push(phase(`phase-${at}`, plot)));
  // Draw trials only when they are opened, as there may be many.
  const done = new Set();
  function open(details) {
    const at = Number(details.dataset.trial);
    if (!details.open || done.has(at) || !data.trials[at]) return Promise.resolve();
    done.add(at);
    const trial = data.trials[at], both = [];
    if (trial.drag_n) both.push(forces(`forces-${at}`, trial));
    if (document.getElementById(`stack-${at}`)) both.push(stack(`stack-${at}`, trial));
    return Promise.all(both);
  }
  const trials = [...document.querySelectorAll("details[data-trial]")];
  trials.forEach((details) => { details.addEventListener("toggle", () => open(details)); drawn.push(open(details)); });
  const all = document.querySelector(".all");
  if (all) all.addEventListener("click", (event) => {
    const shown = event.target.dataset.all;
    if (shown) trials.forEach((details) => { details.open = shown === "open"; });
  });
  // Plots keep their colours until the page is reloaded; paper is light.
  const repaint = ({ paper, ink }) => document.querySelectorAll(".js-plotly-plot").forEach((plot) =>
    Plotly.relayout(plot, { paper_bgcolor: paper, plot_bgcolor: paper, "font.color": ink }));
  night.addEventListener("change", () => location.reload());
  window.addEventListener("beforeprint", () => repaint(LIGHT));
  window.addEventListener("afterprint", () => repaint(look));
  Promise.all(drawn).then(() => { document.documentElement.dataset.plots = "drawn"; });
})();
