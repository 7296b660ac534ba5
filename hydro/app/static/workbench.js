/* Curves, track and playback of the workbench.  The server sends arrays; this file draws them and reports
   zoom, keys and clicks.  Times are seconds on the page's axis, on which sessions follow each other. */
"use strict";

var workbench = (() => {
  const CHANNELS = [
    ["u", "m/s"], ["x", "m"], ["v", "m/s"], ["y", "m"], ["w", "m/s"], ["z", "m"],
    ["p", "rad/s"], ["phi", "rad"], ["q", "rad/s"], ["theta", "rad"], ["r", "rad/s"], ["psi", "rad"],
  ];
  const SYMBOL = { phi: "φ", theta: "θ", psi: "ψ" };
  const INK = "#39424e", PREDICTED = "#1769aa", BAND = "rgba(57,66,78,0.16)", GRID = "#e3e7eb", MARK = "#c2410c";
  const COMMANDS = ["#1769aa", "#2e7d32", "#c2410c", "#6a3d9a", "#00838f", "#8d6e63", "#ad1457", "#616161"];
  const ROWS = 7;           // of panels: six of velocity and pose, one of commands
  const STEP = 1.0;         // s, of an arrow key; 10 times that with shift
  const FRAME = 50;         // ms between redraws while the vehicle moves
  const NARROW = 700;       // px, width of the curves below which the columns stand further apart
  let plot = null, cursor = 0, end = 0, playing = false, speed = 1, last = 0, moved = 0;
  let track = null, hull = [1, 1, 1], predicted = null, view = { azimuth: -0.6, tilt: 0.9, zoom: 1 };
  let asking = 0, window_ = [0, 60], quiet = false, slid = 0;
  const delays = [];

  function layout(commands) {
    const height = 1 / ROWS, made = {
      margin: { l: 54, r: 8, t: 4, b: 32 }, showlegend: false, dragmode: "zoom", hovermode: "x",
      paper_bgcolor: "#fff", plot_bgcolor: "#fff", font: { family: "inherit", size: 10, color: INK },
      shapes: [], uirevision: "same",
    };
    for (let i = 0; i < 13; i++) {
      const row = i < 12 ? i >> 1 : 6, column = i & 1, name = i ? String(i + 1) : "";
      const gap = plot.clientWidth < NARROW ? 0.08 : 0.04;   // room for the labels of the right column
      const domain = i === 12 ? [0, 1] : column ? [0.5 + gap, 1] : [0, 0.5 - gap];
      const top = i < 12 ? 1 - row * height : height * 0.72, low = i < 12 ? top - height * 0.86 : 0;
      made["xaxis" + name] = {
        domain, anchor: "y" + name, matches: i ? "x" : undefined, showticklabels: i >= 10,
        gridcolor: GRID, zeroline: false, ticks: "", range: window_.slice(),
      };
      made["yaxis" + name] = {
        domain: [low, top], anchor: "x" + name, gridcolor: GRID, zeroline: true, zerolinecolor: GRID,
        nticks: 4, fixedrange: false, tickfont: { size: 9 },
      };
      const [symbol, unit] = i < 12 ? CHANNELS[i] : ["command", ""];
      made["yaxis" + name].title = {
        text: `<b>${SYMBOL[symbol] || symbol}</b> ${unit}`, standoff: 3, font: { size: 10.5 },
      };
    }
    made.xaxis13.title = { text: "time along the recording [s]", standoff: 2, font: { size: 10 } };
    return made;
  }

  function axes(i) { const name = i ? String(i + 1) : ""; return { xaxis: "x" + name, yaxis: "y" + name }; }

  function traces(commands) {
    const made = [];
    const line = (color, width) => ({ mode: "lines", line: { color, width }, hoverinfo: "y", x: [], y: [] });
    for (let i = 0; i < 12; i++) {
      made.push({ ...line("rgba(0,0,0,0)", 0), fill: "toself", fillcolor: BAND, hoverinfo: "skip", ...axes(i), name: "noise floor" });
      made.push({ ...line(INK, 1), ...axes(i), name: "measured" });
    }
    for (let i = 0; i < commands; i++) made.push({ ...line(COMMANDS[i % COMMANDS.length], 0.9), ...axes(12), name: `command ${i + 1}` });
    return made;
  }

  /* Plotly is by far the largest script, so that it is loaded after the page is shown. */
  let plotly = null, begun = null;
  function load() {
    plotly = plotly || new Promise((done, failed) => {
      const script = document.createElement("script");
      script.src = "/plotly.min.js"; script.onload = done; script.onerror = failed;
      document.head.append(script);
    });
    return plotly;
  }
  window.addEventListener("load", load);

  function begin(config) { begun = started(config); }

  async function started(config) {
    await load();
    plot = document.getElementById("curves");
    end = config.end; cursor = 0; window_ = config.window; hull = config.hull;
    track = config.track; predicted = null;
    quiet = true;
    await Plotly.newPlot(plot, traces(config.commands), layout(config.commands), {
      responsive: true, displaylogo: false, displayModeBar: false, doubleClick: false, scrollZoom: false,
    });
    quiet = false;
    plot.removeAllListeners("plotly_relayout");
    plot.on("plotly_relayout", zoomed);
    for (const event of ["plotly_relayouting", "plotly_afterplot"]) plot.on(event, () => { overlay(); marker(); });
    plot.on("plotly_doubleclick", () => report("window", [0, end]));
    plot.on("plotly_click", (found) => { seek(found.points[0].x); });
    sessions(config.sessions);
    draw();
  }

  function sessions(starts) {
    const shapes = starts.slice(1).map((one) => ({
      type: "line", xref: "x", yref: "paper", x0: one.t, x1: one.t, y0: 0, y1: 1, line: { color: "#b8c0c8", width: 1, dash: "dot" },
    }));
    quiet = true;
    Plotly.relayout(plot, { shapes }).then(() => { quiet = false; });
  }

  function zoomed(change) {
    if (quiet) return;
    const low = change["xaxis.range[0]"], high = change["xaxis.range[1]"];
    const other = Object.keys(change).find((key) => /^xaxis\d*\.range\[0\]$/.test(key));
    const from = low ?? (other ? change[other] : undefined);
    const to = high ?? (other ? change[other.replace("[0]", "[1]")] : undefined);
    if (from === undefined || to === undefined) return;
    clearTimeout(asking);
    asking = setTimeout(() => report("window", [Math.max(from, -1), Math.min(to, end + 1)]), 80);
  }

  /* Draw new arrays: those of the whole window, or the predictions alone. */
  async function curves(sent) {
    await begun;
    if (!plot || !plot.data) return;
    const x = [], y = [], which = [];
    const put = (trace, curve) => { which.push(trace); x.push(curve.x); y.push(curve.y); };
    if (sent.window) {
      window_ = sent.window;
      for (let i = 0; i < 12; i++) { put(2 * i, sent.band[i]); put(2 * i + 1, sent.measured[i]); }
      sent.commands.forEach((curve, i) => put(24 + i, curve));
      const change = { "xaxis.range": window_, "yaxis13.range": [-1.05, 1.05] };
      for (let i = 0; i < 12; i++) change[`yaxis${i ? i + 1 : ""}.range`] = reach([sent.measured[i], sent.predicted[i]]);
      predicted = sent.predicted;
      quiet = true;
      await Plotly.update(plot, { x, y }, change, which);
      quiet = false;
    } else {
      predicted = sent.predicted;
      overlay();
    }
    draw();
    requestAnimationFrame(() => {
      if (slid) { delays.push(performance.now() - slid); slid = 0; }
      document.body.dataset.drawn = String(Number(document.body.dataset.drawn || 0) + 1);
    });
  }

  /* Range of the values of some curves, with a margin. */
  function reach(some) {
    let low = Infinity, high = -Infinity;
    for (const one of some) for (const v of one.y) if (v !== null) { if (v < low) low = v; if (v > high) high = v; }
    if (!(high > low)) { low = (Number.isFinite(low) ? low : 0) - 1; high = low + 2; }
    const margin = 0.06 * (high - low);
    return [low - margin, high + margin];
  }

  /* Predictions are drawn on a canvas above the plots: at every move of a slider Plotly would take too long. */
  function overlay() {
    const canvas = document.getElementById("overlay");
    if (!canvas || !plot || !plot._fullLayout || !predicted) return;
    const pen = prepared(canvas);
    pen.strokeStyle = PREDICTED; pen.lineWidth = 1.4; pen.lineJoin = "round";
    for (let i = 0; i < 12; i++) {
      const name = i ? String(i + 1) : "", u = plot._fullLayout["xaxis" + name], v = plot._fullLayout["yaxis" + name];
      pen.save();
      pen.beginPath(); pen.rect(u._offset, v._offset, u._length, v._length); pen.clip();
      pen.beginPath();
      let drawing = false;
      const curve = predicted[i];
      for (let k = 0; k < curve.x.length; k++) {
        if (curve.y[k] === null) { drawing = false; continue; }
        const a = u._offset + u.l2p(curve.x[k]), b = v._offset + v.l2p(curve.y[k]);
        if (drawing) pen.lineTo(a, b); else pen.moveTo(a, b);
        drawing = true;
      }
      pen.stroke();
      pen.restore();
    }
  }

  /* A cleared canvas at the resolution of the screen. */
  function prepared(canvas) {
    const ratio = window.devicePixelRatio || 1, size = [canvas.clientWidth, canvas.clientHeight];
    if (canvas.width !== Math.round(size[0] * ratio) || canvas.height !== Math.round(size[1] * ratio)) {
      canvas.width = Math.round(size[0] * ratio); canvas.height = Math.round(size[1] * ratio);
    }
    const pen = canvas.getContext("2d");
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, ...size);
    return pen;
  }

  function ladder(html) { const place = document.getElementById("ladder"); if (place) place.innerHTML = html; }

  function report(kind, content) { if (window.emitEvent) emitEvent("workbench_" + kind, content); }

  /* Playback: the cursor runs along the track, and the window follows it. */
  function seek(time, ask = true) {
    cursor = Math.min(Math.max(time, 0), end);
    const width = window_[1] - window_[0];
    if (ask && (cursor < window_[0] || cursor > window_[1])) {
      const low = Math.max(0, Math.min(cursor - 0.1 * width, end - width));
      report("window", [low, low + width]);
      window_ = [low, low + width];
    }
    draw();
  }

  function play(on) {
    playing = on === undefined ? !playing : on;
    if (playing && cursor >= end) cursor = 0;
    last = performance.now();
    const button = document.getElementById("play");
    if (button) button.textContent = playing ? "❚❚" : "▶";
    if (playing) requestAnimationFrame(frame);
  }

  function frame(now) {
    if (!playing) return;
    if (now - moved >= FRAME) {
      seek(cursor + speed * (now - last) / 1000);
      last = moved = now;
      if (cursor >= end) play(false);
    }
    requestAnimationFrame(frame);
  }

  /* Track: an orthographic view of the measured path, with the measured and the predicted vehicle. */
  function at(time) {
    const t = track.t;
    let low = 0, high = t.length - 1;
    while (high - low > 1) { const middle = (low + high) >> 1; if (t[middle] <= time) low = middle; else high = middle; }
    return low;
  }

  function value(curve, time) {
    const t = curve.x;
    let low = 0, high = t.length - 1;
    if (high < 0 || time < t[0] || time > t[high]) return null;
    while (high - low > 1) { const middle = (low + high) >> 1; if (t[middle] <= time) low = middle; else high = middle; }
    return curve.y[low] ?? curve.y[high];
  }

  function ghost(time) {
    if (!predicted) return null;
    const pose = [1, 3, 5, 7, 9, 11].map((i) => value(predicted[i], time));
    return pose.some((one) => one === null) ? null : pose;
  }

  function project(size, middle, scale) {
    const ca = Math.cos(view.azimuth), sa = Math.sin(view.azimuth), ct = Math.cos(view.tilt), st = Math.sin(view.tilt);
    return ([north, east, down]) => {
      const n = north - middle[0], e = east - middle[1], d = down - middle[2];
      const across = ca * e - sa * n, along = sa * e + ca * n;
      return [size[0] / 2 + scale * across, size[1] / 2 - scale * (along * st - d * ct)];
    };
  }

  function box(pose) {
    const [x, y, z, phi, theta, psi] = pose, [l, w, h] = hull.map((one) => one / 2);
    const [cf, sf, ct, st, cp, sp] = [Math.cos(phi), Math.sin(phi), Math.cos(theta), Math.sin(theta), Math.cos(psi), Math.sin(psi)];
    const turn = ([a, b, c]) => [
      x + cp * ct * a + (cp * st * sf - sp * cf) * b + (cp * st * cf + sp * sf) * c,
      y + sp * ct * a + (sp * st * sf + cp * cf) * b + (sp * st * cf - cp * sf) * c,
      z - st * a + ct * sf * b + ct * cf * c,
    ];
    const corners = [[l, -w, -h], [l, w, -h], [-l, w, -h], [-l, -w, -h], [l, -w, h], [l, w, h], [-l, w, h], [-l, -w, h]];
    return { corners: corners.map(turn), nose: turn([1.7 * l, 0, 0]) };
  }

  function draw() {
    marker();
    const canvas = document.getElementById("track");
    if (!canvas || !track || !track.t.length) return;
    const size = [canvas.clientWidth, canvas.clientHeight];
    if (!size[0]) return;
    const pen = prepared(canvas);
    const here = at(cursor), session = track.session[here];
    const rows = track.t.map((_, i) => i).filter((i) => track.session[i] === session);
    const reach = [0, 1, 2].map((k) => rows.reduce(([a, b], i) => [Math.min(a, track.pose[i][k]), Math.max(b, track.pose[i][k])], [Infinity, -Infinity]));
    const middle = reach.map(([a, b]) => (a + b) / 2);
    const extent = Math.max(...reach.map(([a, b]) => b - a), 2 * Math.max(...hull));
    const scale = view.zoom * 0.72 * Math.min(size[0], size[1] * 1.3) / extent, to = project(size, middle, scale);
    ground(pen, to, reach, extent);
    path(pen, rows.map((i) => to(track.pose[i])), "#9aa5b1", 1);
    path(pen, rows.filter((i) => track.t[i] >= window_[0] && track.t[i] <= window_[1]).map((i) => to(track.pose[i])), INK, 1.6);
    const shown = ghost(cursor);
    const large = Math.max(1, 26 / (scale * Math.max(...hull)));
    if (shown) body(pen, to, shown, PREDICTED, "rgba(23,105,170,0.10)", large);
    body(pen, to, track.pose[here], INK, "rgba(57,66,78,0.18)", large);
    const pose = track.pose[here];
    pen.fillStyle = INK; pen.font = "11px inherit, sans-serif"; pen.textAlign = "left";
    pen.fillText(`${track.names[session]}   t ${cursor.toFixed(1)} s   N ${pose[0].toFixed(1)}  E ${pose[1].toFixed(1)}  depth ${pose[2].toFixed(1)} m`, 8, 14);
    bar(pen, size, scale);
    const clock = document.getElementById("clock");
    if (clock) clock.textContent = `${cursor.toFixed(1)} / ${end.toFixed(0)} s`;
    const slide = document.getElementById("seek");
    if (slide && document.activeElement !== slide) { slide.max = end; slide.value = cursor; }
  }

  function ground(pen, to, reach, extent) {
    const step = nice(extent / 5), floor = reach[2][1] + 0.05 * extent;
    const [n0, n1] = reach[0].map((one, i) => (i ? Math.ceil(one / step + 0.2) : Math.floor(one / step - 0.2)) * step);
    const [e0, e1] = reach[1].map((one, i) => (i ? Math.ceil(one / step + 0.2) : Math.floor(one / step - 0.2)) * step);
    for (let n = n0; n <= n1 + step / 2; n += step) path(pen, [to([n, e0, floor]), to([n, e1, floor])], GRID, 1);
    for (let e = e0; e <= e1 + step / 2; e += step) path(pen, [to([n0, e, floor]), to([n1, e, floor])], GRID, 1);
    pen.fillStyle = "#7b8794"; pen.font = "10px sans-serif"; pen.textAlign = "center";
    const north = to([n1 + 0.25 * step, (e0 + e1) / 2, floor]), east = to([(n0 + n1) / 2, e1 + 0.25 * step, floor]);
    pen.fillText("N", north[0], north[1] + 3); pen.fillText("E", east[0], east[1] + 3);
  }

  function nice(width) { const power = 10 ** Math.floor(Math.log10(width)); return [1, 2, 5, 10].find((one) => one * power >= width) * power; }

  function bar(pen, size, scale) {
    const length = nice(70 / scale), wide = length * scale;
    path(pen, [[size[0] - 10 - wide, size[1] - 10], [size[0] - 10, size[1] - 10]], INK, 1.5);
    pen.textAlign = "right"; pen.fillStyle = INK; pen.fillText(`${length} m`, size[0] - 10, size[1] - 14);
  }

  function path(pen, points, color, width) {
    pen.beginPath(); pen.strokeStyle = color; pen.lineWidth = width;
    points.forEach((one, i) => (i ? pen.lineTo(...one) : pen.moveTo(...one)));
    pen.stroke();
  }

  function body(pen, to, pose, color, fill, large) {
    const sides = hull; hull = hull.map((one) => one * large);
    const { corners, nose } = box(pose); hull = sides;
    const flat = corners.map(to);
    pen.fillStyle = fill; pen.strokeStyle = color; pen.lineWidth = 1.2;
    for (const face of [[0, 1, 2, 3], [4, 5, 6, 7], [0, 1, 5, 4], [2, 3, 7, 6]]) {
      pen.beginPath(); face.forEach((k, i) => (i ? pen.lineTo(...flat[k]) : pen.moveTo(...flat[k]))); pen.closePath(); pen.fill(); pen.stroke();
    }
    path(pen, [to(pose), to(nose)], color, 2);
  }

  function marker() {
    if (!plot || !plot._fullLayout) return;
    const area = plot._fullLayout._size, last = area.h / ROWS;
    ["xaxis", "xaxis2", "xaxis13"].forEach((name, i) => {
      const line = document.getElementById("cursor" + i), axis = plot._fullLayout[name];
      if (!line || !axis) return;
      const place = axis.l2p(cursor), inside = place >= 0 && place <= axis._length;
      line.style.display = inside ? "block" : "none";
      line.style.left = `${plot.offsetLeft + axis._offset + place}px`;
      line.style.top = `${area.t + (i < 2 ? 0 : area.h - 0.72 * last)}px`;
      line.style.height = `${i < 2 ? area.h - 1.14 * last : 0.72 * last}px`;
    });
  }

  /* Force of an effect over time and against velocity, in a card. */
  function forces(id, sent) {
    const place = document.getElementById(id);
    if (!place) return;
    const axis = { gridcolor: GRID, zerolinecolor: "#b8c0c8", tickfont: { size: 9 }, nticks: 4 };
    Plotly.react(place, [
      { x: sent.t.x, y: sent.t.y, mode: "lines", line: { color: PREDICTED, width: 1 }, hoverinfo: "x+y" },
      { x: sent.v.x, y: sent.v.y, mode: "markers", marker: { color: PREDICTED, size: 3, opacity: 0.5 }, xaxis: "x2", yaxis: "y2", hoverinfo: "x+y" },
    ], {
      margin: { l: 38, r: 4, t: 4, b: 28 }, showlegend: false, font: { size: 9, color: INK }, height: 120,
      xaxis: { ...axis, domain: [0, 0.5], title: { text: "time [s]", standoff: 2 } },
      yaxis: { ...axis, title: { text: `${sent.name} [${sent.unit}]`, standoff: 2 } },
      xaxis2: { ...axis, domain: [0.6, 1], anchor: "y2", title: { text: `${sent.against} [${sent.speed}]`, standoff: 2 } },
      yaxis2: { ...axis, anchor: "x2", showticklabels: false, matches: "y" },
    }, { displayModeBar: false, responsive: true });
  }

  /* Keys, mouse and files. */
  function typing(target) { return /^(INPUT|TEXTAREA|SELECT)$/.test(target.tagName) || target.isContentEditable || target.closest("[role=slider], .q-slider"); }

  document.addEventListener("keydown", (event) => {
    if ((event.ctrlKey || event.metaKey) && !event.altKey && /^[zy]$/i.test(event.key) && !/^(INPUT|TEXTAREA)$/.test(event.target.tagName)) {
      report("undo", event.key.toLowerCase() === "y" || event.shiftKey ? "redo" : "undo");
      event.preventDefault();
      return;
    }
    if (typing(event.target) || event.ctrlKey || event.metaKey || event.altKey) return;
    const by = STEP * (event.shiftKey ? 10 : 1);
    if (event.key === " ") play();
    else if (event.key === "ArrowRight") seek(cursor + by);
    else if (event.key === "ArrowLeft") seek(cursor - by);
    else if (event.key === "Home") seek(0);
    else if (event.key === "End") seek(end);
    else if (/^[1-5]$/.test(event.key)) report("step", Number(event.key));
    else return;
    if (document.activeElement && document.activeElement.tagName === "BUTTON") document.activeElement.blur();
    event.preventDefault();
  });

  /* The panel is drawn again after each action: stay at the same place of the same step. */
  const SETTLING = 300;     // ms in which a panel that was drawn again takes its final height
  function keepPlace() {
    const panel = document.querySelector(".panel"), title = () => (panel.querySelector("h2") || {}).textContent;
    let place = 0, renewed = 0, step = title();
    const restore = () => {
      panel.scrollTop = place;
      if (performance.now() - renewed < SETTLING) requestAnimationFrame(restore);
    };
    panel.addEventListener("scroll", () => { if (performance.now() - renewed >= SETTLING) place = panel.scrollTop; });
    new MutationObserver((changes) => {
      const now = title();
      const again = changes.some((one) => (one.target === panel || one.target.parentElement === panel) && one.addedNodes.length);
      if (!again || now === undefined) return;
      if (now !== step) { step = now; place = 0; }
      renewed = performance.now();
      restore();
    }).observe(panel, { childList: true, subtree: true });
  }

  function listen() {
    keepPlace();
    const canvas = document.getElementById("track");
    let from = null;
    canvas.addEventListener("pointerdown", (event) => { from = [event.clientX, event.clientY]; canvas.setPointerCapture(event.pointerId); });
    canvas.addEventListener("pointermove", (event) => {
      if (!from) return;
      view.azimuth += (event.clientX - from[0]) * 0.01;
      view.tilt = Math.min(Math.PI / 2, Math.max(0.05, view.tilt + (event.clientY - from[1]) * 0.01));
      from = [event.clientX, event.clientY];
      draw();
    });
    canvas.addEventListener("pointerup", () => { from = null; });
    canvas.addEventListener("wheel", (event) => { view.zoom = Math.min(20, Math.max(0.3, view.zoom * Math.exp(-event.deltaY * 0.001))); draw(); event.preventDefault(); }, { passive: false });
    document.getElementById("play").addEventListener("click", () => play());
    document.getElementById("speed").addEventListener("change", (event) => { speed = Number(event.target.value); event.target.blur(); });
    document.getElementById("seek").addEventListener("input", (event) => seek(Number(event.target.value)));
    new ResizeObserver(draw).observe(canvas);
    document.addEventListener("dragover", (event) => { event.preventDefault(); document.body.classList.add("dropping"); });
    document.addEventListener("dragleave", (event) => { if (!event.relatedTarget) document.body.classList.remove("dropping"); });
    document.addEventListener("drop", (event) => { event.preventDefault(); document.body.classList.remove("dropping"); upload([...event.dataTransfer.files]); });
  }

  /* Rows of numbers: a slider reports while it moves, at most every PACE ms, and once more when it is let go. */
  const PACE = 40;
  let sliding = 0, pending = null;
  function slideTo(key, number) {
    slid = slid || performance.now();
    pending = [key, number];
    if (sliding) return;
    report("slide", pending); pending = null;
    sliding = setTimeout(() => { sliding = 0; if (pending) slideTo(...pending); }, PACE);
  }
  document.addEventListener("input", (event) => {
    const key = event.target.dataset && event.target.dataset.slide;
    if (!key) return;
    const field = event.target.parentElement.querySelector("[data-number]");
    if (field) field.value = Number(event.target.value).toPrecision(5).replace(/\.?0+$/, "").replace(/\.?0+e/, "e");
    slideTo(key, Number(event.target.value));
  });
  document.addEventListener("change", (event) => {
    const data = event.target.dataset || {};
    if (data.slide || data.number) { pending = null; report("settle", [data.slide || data.number, Number(event.target.value)]); }
    else if (data.tick) report("tick", [data.tick, event.target.checked]);
    else if (data.switch) report("switch", [data.switch, event.target.checked]);
  });
  document.addEventListener("click", (event) => {
    const place = event.target.closest && event.target.closest("[data-do]");
    if (place && !place.disabled) report("do", [place.dataset.do, place.dataset.with]);
  });

  /* A click on a column of the log adds it to the line of the map that has, or last had, the cursor. */
  let line = null, written = null;
  document.addEventListener("focusin", (event) => { if (event.target.matches(".map input[type=text], .map input:not([type])")) line = event.target; });
  document.addEventListener("focusout", (event) => {
    if (event.target !== written) return;
    written = null;
    event.target.dispatchEvent(new Event("change", { bubbles: true }));
  });
  document.addEventListener("mousedown", (event) => {
    if (!event.target.matches(".columns span") || !line || !line.isConnected) return;
    event.preventDefault();   // keeps the cursor in the line
    line.focus();
    const before = line.value.trim();
    line.value = before && before !== "none" ? `${before} ${event.target.textContent}` : event.target.textContent;
    line.dispatchEvent(new Event("input", { bubbles: true }));
    written = line;
  });

  async function upload(files) {
    for (const file of files) {
      report("uploading", file.name);
      try {
        const answer = await fetch(`/upload?name=${encodeURIComponent(file.name)}`, { method: "POST", body: file });
        report("uploaded", { ok: answer.ok, text: (await answer.text()).trim() });
      } catch (error) {
        report("uploaded", { ok: false, text: `${file.name}: the upload broke off` });
      }
    }
  }

  return { begin, curves, forces, ladder, listen, seek, play, upload, slide: () => { slid = slid || performance.now(); }, delays, state: () => ({ cursor, playing, window: window_ }) };
})();
