"use strict";
// A live view in `root`, a document or a shadow root that holds view.html. It draws each picture when it arrives; a picture is
// complete, so a missed one is no loss. `obey` gets the name of each order, and returns true if the order has arrived.
const liveView = (root, obey) => {
  const byId = (id) => root.getElementById(id);
  const put = (element, text) => { if (element.textContent !== text) element.textContent = text; };
  const add = (parent, tag, name = "") => { const child = parent.appendChild(document.createElement(tag)); child.className = name; return child; };
  const short = (value) => String(Number(value.toPrecision(6)));
  // Number of decimals that distinguish values on a scale of this length.
  const decimals = (length) => Math.min(6, Math.max(0, 2 - Math.floor(Math.log10(length))));
  const signed = (value, digits) => (value < 0 ? "−" : "+") + Math.abs(value).toFixed(digits);

  let colours = {};
  const readColours = () => {
    const style = getComputedStyle(root.host ?? document.documentElement);
    for (const name of ["paper", "ink", "quiet", "line", "warn", "force", "c0", "c1", "c2", "c3", "c4", "c5"]) colours[name] = style.getPropertyValue(`--${name}`).trim();
  };
  readColours();

  // Clears a canvas and sets its resolution to the screen's; coordinates are CSS pixels.
  const begin = (canvas) => {
    const { clientWidth: width, clientHeight: height } = canvas, scale = window.devicePixelRatio || 1;
    const [columns, rows] = [Math.max(1, Math.round(width * scale)), Math.max(1, Math.round(height * scale))];
    if (canvas.width !== columns || canvas.height !== rows) [canvas.width, canvas.height] = [columns, rows];
    const context = canvas.getContext("2d");
    context.setTransform(scale, 0, 0, scale, 0, 0);
    context.clearRect(0, 0, width, height);
    return { context, width, height };
  };
  const line = (context, colour, width, ...points) => {
    context.strokeStyle = colour;
    context.lineWidth = width;
    context.beginPath();
    points.forEach(([x, y], at) => at ? context.lineTo(x, y) : context.moveTo(x, y));
    context.stroke();
  };

  // Elements of traces and channels, rebuilt if the traces or channels have changed.
  let traces = [], channels = [], shape = "";
  const build = (picture) => {
    const wanted = picture.traces.map((trace) => trace.name + trace.unit).join() + "/" + picture.channels.length;
    if (wanted === shape) return;
    shape = wanted;
    byId("traces").replaceChildren();
    byId("traces").style.setProperty("--traces", String(picture.traces.length || 1));
    traces = picture.traces.map(({ name, unit }, at) => {
      const row = add(byId("traces"), "div", "trace"), label = add(row, "div", "label");
      label.style.setProperty("--colour", `var(--c${at % 6})`);
      const first = add(label, "b");
      put(add(first, "span"), name);
      const parts = { value: add(first, "span"), noise: add(label, "div", "quiet"), scale: add(label, "div", "quiet"), canvas: add(row, "canvas"), colour: `c${at % 6}` };
      parts.canvas.setAttribute("role", "img");
      parts.canvas.setAttribute("aria-label", `${name} over time${unit && `, in ${unit}`}`);
      return parts;
    });
    byId("channels").replaceChildren();
    channels = picture.channels.map((_, at) => {
      const row = add(byId("channels"), "div", "channel");
      put(add(row, "span"), `s${at + 1}`);
      const reading = add(row, "span"), bar = add(row, "div", "bar");
      return { row, reading, range: add(bar, "i"), head: add(bar, "u"), word: add(row, "span", "word") };
    });
  };

  const drawTrace = ({ value, noise, scale, canvas, colour }, trace, marks) => {
    const [low, high] = trace.range, digits = decimals(high - low);
    put(value, `${signed(trace.value, digits)} ${trace.unit}`);
    put(noise, `sd ${trace.noise.toFixed(Math.min(6, digits + 1))}`);
    put(scale, low === -high ? `scale ±${short(high)}` : `${short(low)} … ${short(high)}`);
    const { context, width, height } = begin(canvas);
    const y = (level) => 1 + (height - 2) * (1 - level / 1000);
    if (low <= 0 && high >= 0) {
      const zero = y(-1000 * low / (high - low));
      line(context, colours.line, 1, [0, zero], [width, zero]);
    }
    context.font = "11px system-ui, sans-serif";
    for (const [number, place] of marks) {
      line(context, colours.warn, 1, [place * width, 0], [place * width, height]);
      context.fillStyle = colours.warn;
      context.fillText(number, Math.min(place * width + 2, width - 16), 10);
    }
    context.strokeStyle = colours[colour];
    context.lineWidth = 1.5;
    context.lineJoin = "round";
    context.beginPath();
    let isDown = false;
    trace.columns.forEach((ends, at) => {
      if (ends) {
        const x = (at + 0.5) / trace.columns.length * width;
        isDown ? context.lineTo(x, y(ends[1])) : context.moveTo(x, y(ends[1]));
        // A column with a single value gets a short line, since a line of length 0 is not drawn.
        context.lineTo(x, y(ends[0]) + (ends[0] === ends[1] ? 0.01 : 0));
      }
      isDown = ends !== null;
    });
    context.stroke();
  };

  const drawChannel = ({ row, reading, range, head, word }, channel) => {
    put(reading, channel.reading.toFixed(0));
    // Some room on both sides of the calibrated range shows how far a value is outside.
    const room = channel.range ? 0.2 * Math.max(1, channel.range[1] - channel.range[0]) : 0;
    const [low, high] = channel.range ? [channel.range[0] - room, channel.range[1] + room] : [0, 4095];
    const place = (value) => 100 * Math.min(1, Math.max(0, (value - low) / (high - low)));
    range.hidden = !channel.range;
    if (channel.range) {
      range.style.left = `${place(channel.range[0])}%`;
      range.style.right = `${100 - place(channel.range[1])}%`;
    }
    head.style.left = `${place(channel.reading)}%`;
    const state = channel.state === "fine" ? "" : channel.state;
    row.className = `channel ${state}`;
    put(word, state);
  };

  const drawArrow = (canvas, right, up, reach, names) => {
    const { context, width, height } = begin(canvas), x = width / 2, y = height / 2, radius = Math.min(x, y) - 14;
    // A window without layout, or an almost closed one, has no room for an arrow.
    if (radius <= 0) return;
    line(context, colours.line, 1, [x - radius, y], [x + radius, y]);
    line(context, colours.line, 1, [x, y - radius], [x, y + radius]);
    context.strokeStyle = colours.line;
    context.beginPath();
    context.arc(x, y, radius, 0, 2 * Math.PI);
    context.stroke();
    context.fillStyle = colours.quiet;
    context.font = "12px system-ui, sans-serif";
    context.textAlign = "center";
    context.fillText(names[0], x, 10);
    context.fillText(names[1], names[2] < 0 ? 6 : width - 6, y + 4);
    context.textAlign = "left";
    context.fillText(`${short(reach)} N`, 2, height - 3);
    const tip = [x + right / reach * radius, y - up / reach * radius], angle = Math.atan2(tip[1] - y, tip[0] - x), length = Math.hypot(tip[0] - x, tip[1] - y);
    line(context, colours.force, 3, [x, y], tip);
    const barb = (turn) => [tip[0] - Math.min(10, length) * Math.cos(angle + turn), tip[1] - Math.min(10, length) * Math.sin(angle + turn)];
    line(context, colours.force, 3, barb(0.5), tip, barb(-0.5));
  };

  // The error on new poses after each load, its 95 % and its limit, on a logarithmic scale.
  const drawErrors = (figure, points, limit, unit) => {
    figure.hidden = points.length < 2;
    if (figure.hidden) return;
    const { context, width, height } = begin(figure.querySelector("canvas")), [first, last] = [points[0], points.at(-1)];
    const values = points.flatMap(({ error, upper }) => [error, upper]).concat(limit ?? []);
    const [low, high] = [Math.min(...values), Math.max(...values)];
    const x = (loads) => 2 + (width - 4) * (loads - first.loads) / (last.loads - first.loads);
    const y = (value) => 2 + (height - 4) * Math.log(high / value) / Math.log(high / low || Math.E);
    if (limit !== null) line(context, colours.warn, 1, [0, y(limit)], [width, y(limit)]);
    line(context, colours.quiet, 1, ...points.map(({ loads, upper }) => [x(loads), y(upper)]));
    line(context, colours.force, 2, ...points.map(({ loads, error }) => [x(loads), y(error)]));
    const after = ({ loads, error }) => `${short(error)} ${unit} after ${loads} loads`;
    put(figure.querySelector("figcaption"), `error on new poses and 95 %: ${after(first)}, ${after(last)}`);
  };

  // The next planned load, the instruction, and the progress.
  const WHAT = { rest: "leave the sensor unloaded", hang: "hang it", hold: "hold still", release: "recorded: hang the next", done: "" };
  const drawGuide = (guide, traces) => {
    byId("guide").hidden = !guide;
    for (const order of ["skip", "back"]) root.querySelector(`[data-order=${order}]`).hidden = !guide;
    if (!guide) return;
    const isDone = guide.phase === "done";
    put(byId("load"), isDone ? `all ${guide.count} loads are recorded` : guide.text);
    put(byId("what"), WHAT[guide.phase]);
    byId("held").hidden = guide.phase !== "hold";
    byId("held").value = guide.held;
    const forces = traces.filter(({ unit }) => unit).filter((_, at) => guide.wrench[at] !== 0);
    put(byId("current"), forces.map(({ name, value, unit, range }) => `${name} ${signed(value, decimals(range[1] - range[0]))} ${unit}`).join(", "));
    const place = isDone ? "" : `load ${guide.number} of ${guide.count}, “${guide.group}”; `;
    const newest = guide.errors.at(-1), part = (at, unit) => `${short(newest.error[at])} ${unit} (95 %: ${short(newest.upper[at])})`;
    const gain = guide.remaining_gain === null ? "" : `; ${Math.round(100 * guide.remaining_gain)} % of the gain to come`;
    const error = newest ? `; error on new poses ${part(0, "N")}, ${part(1, "N·m")}` : "";
    put(byId("done"), `${place}${guide.recorded} recorded${gain}${error}`);
    put(byId("finding"), guide.finding);
    [...byId("errors").children].forEach((figure, at) => {
      const points = guide.errors.map(({ loads, error, upper }) => ({ loads, error: error[at], upper: upper[at] }));
      drawErrors(figure, points.filter(({ error }) => error > 0), guide.limits[at], ["N", "N·m"][at]);
    });
  };

  let shown = null, isDue = false;
  const draw = () => {
    isDue = false;
    if (!shown) return;
    const { picture, state, recording, can_record: canRecord, message, guide } = shown;
    build(picture);
    drawGuide(guide, picture.traces);
    put(byId("state"), state);
    const flags = [picture.is_paused && "PAUSED", picture.is_taring && "TARING", recording && `REC ${recording}`];
    put(byId("flags"), flags.filter(Boolean).join("  "));
    put(byId("message"), message);
    picture.traces.forEach((trace, at) => drawTrace(traces[at], trace, picture.marks));
    picture.channels.forEach((channel, at) => drawChannel(channels[at], channel));
    byId("arrows").hidden = !picture.force;
    if (picture.force) {
      const [[fx, fy, fz], reach] = picture.force;
      drawArrow(byId("top"), -fy, fx, reach, ["x", "y", -1]);
      drawArrow(byId("side"), fx, fz, reach, ["z", "x", 1]);
    }
    put(byId("from"), `−${short(picture.window_s)} s`);
    put(byId("now"), picture.time_s === null ? "nothing has arrived so far" : `${picture.time_s.toFixed(3)} s`);
    const press = (order, isOn) => root.querySelector(`[data-order=${order}]`).setAttribute("aria-pressed", String(isOn));
    press("pause", picture.is_paused);
    press("record", recording !== null);
    root.querySelector("[data-order=record]").disabled = !canRecord;
  };
  const drawSoon = () => {
    if (!isDue) requestAnimationFrame(draw);
    isDue = true;
  };

  for (const button of root.querySelectorAll("[data-order]")) {
    button.addEventListener("click", async () => {
      if (!await obey(button.dataset.order)) put(byId("message"), `“${button.textContent}” did not arrive`);
    });
  }
  window.addEventListener("resize", drawSoon);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { readColours(); drawSoon(); });
  return {
    show: (picture) => { shown = picture; drawSoon(); },
    say: (state) => { if (shown) shown.state = state; put(byId("state"), state); },
  };
};
