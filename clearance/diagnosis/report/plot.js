// Curves on axes: values under the pointer, zoom by dragging, series on and off, everything by keyboard too.

function niceTicks(low, high, count) {
  const span = high - low;
  if (!(span > 0)) return [low];
  const raw = span / Math.max(count, 1), power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 2.5, 5, 10].find((factor) => factor * power >= raw * 0.75) * power;
  const ticks = [];
  for (let index = Math.ceil(low / step - 1e-9); index * step <= high + step * 1e-9; index++) ticks.push(index * step);
  return ticks;
}

function logTicks(low, high, room) {
  const ticks = [];
  const decades = Math.log10(high / low);
  const factors = decades > room ? [1] : decades > room / 2.2 ? [1, 3] : [1, 2, 5];
  const stride = Math.max(1, Math.ceil(decades / Math.max(room, 1)));
  for (let power = Math.floor(Math.log10(low)); power <= Math.ceil(Math.log10(high)); power++) {
    if (power % stride) continue;
    for (const factor of factors) {
      const value = factor * 10 ** power;
      if (value >= low * 0.9999 && value <= high * 1.0001) ticks.push(value);
    }
  }
  return ticks;
}

function axis(domain, range, { log = false, ticks = null, count = 5 } = {}) {
  const map = log ? Math.log10 : (value) => value;
  const [a, b] = domain.map(map), [p, q] = range;
  const scale = (value) => p + ((map(value) - a) / (b - a || 1)) * (q - p);
  scale.invert = (pixel) => { const value = a + ((pixel - p) / (q - p || 1)) * (b - a); return log ? 10 ** value : value; };
  scale.ticks = ticks ? ticks(domain, count) : log ? logTicks(domain[0], domain[1], count) : niceTicks(domain[0], domain[1], count);
  scale.domain = domain;
  return scale;
}

function degreeTicks([low, high], count) {
  const step = [5, 10, 15, 30, 45, 90, 180].find((size) => (high - low) / size <= Math.max(count, 4)) ?? 90;
  const ticks = [];
  for (let value = Math.ceil(low / step) * step; value <= high + 1e-9; value += step) ticks.push(value);
  return ticks;
}

function tickText(value, ticks) {
  const step = ticks.length > 1 ? Math.abs(ticks[1] - ticks[0]) : Math.abs(value);
  const size = Math.max(...ticks.map(Math.abs));
  if (size >= 1e5 || (size > 0 && size < 1e-3)) return text(value, 3);
  const places = step > 0 ? clamp(-Math.floor(Math.log10(step) + 1e-9) + (/[2]\.?5/.test(step.toPrecision(3)) && step < 10 ? 1 : 0), 0, 6) : 0;
  return (Math.abs(value) < step * 1e-6 ? 0 : value).toFixed(places).replace("-", "−");
}

// Of many samples in one pixel column, its first, lowest, highest and last keep the picture the same.
function linePath(xs, ys, sx, sy, from, to) {
  const parts = [];
  const dense = to - from > 4 * Math.abs(sx(sx.domain[1]) - sx(sx.domain[0]));
  let pen = false, column = null, low = 0, high = 0, last = 0;
  const point = (x, y) => { parts.push(`${pen ? "L" : "M"}${x.toFixed(1)} ${y.toFixed(1)}`); pen = true; };
  const flush = () => { if (column === null) return; point(column, low); if (high !== low) point(column, high); if (last !== high) point(column, last); column = null; };
  for (let index = from; index < to; index++) {
    if (!isNumber(xs[index]) || !isNumber(ys[index])) { flush(); pen = false; continue; }
    const x = sx(xs[index]), y = sy(ys[index]);
    if (!Number.isFinite(x) || !Number.isFinite(y)) { flush(); pen = false; continue; }
    if (!dense) { point(x, y); continue; }
    if (Math.round(x) !== column) { flush(); column = Math.round(x); low = high = y; }
    low = Math.min(low, y); high = Math.max(high, y); last = y;
  }
  flush();
  return parts.join("");
}

function bandPath(xs, low, high, sx, sy) {
  let there = [], back = [], path = "";
  const close = () => { if (there.length) path += `M${there.join("L")}L${back.reverse().join("L")}Z`; there = []; back = []; };
  xs.forEach((x, index) => {
    if (!isNumber(x) || !isNumber(low[index]) || !isNumber(high[index])) return close(); // nothing is known there
    there.push(`${sx(x).toFixed(1)} ${sy(high[index]).toFixed(1)}`);
    back.push(`${sx(x).toFixed(1)} ${sy(low[index]).toFixed(1)}`);
  });
  close();
  return path;
}

function nearest(xs, x) { // xs ascending
  let low = 0, high = xs.length - 1;
  while (high - low > 1) { const middle = (low + high) >> 1; if (xs[middle] < x) low = middle; else high = middle; }
  return Math.abs(xs[low] - x) <= Math.abs(xs[high] - x) ? low : high;
}

/* spec: { label, x: {label, unit, log, ticks, marks: [{x, label}]}, shade: [[from, to]], zoom, oneBand, panels: [{ label, unit, log, height, zero,
   series: [{name, label, style, x, y, low, high}], points: [[x, y, low, high]], rules: [{y, label}] }], hidden: Set of names } */
function curves(parent, spec) {
  const panels = spec.panels;
  const hidden = spec.hidden ?? new Set();
  const all = panels.flatMap((panel) => panel.series);
  const positive = (value) => isNumber(value) && (!spec.x.log || value > 0);
  const full = extent([...all.flatMap((one) => list(one.x)), ...panels.flatMap((panel) => list(panel.points).map((p) => p[0]))].filter(positive));
  if (!(full[1] > full[0])) return null;
  let domain = full, cursor = null, dragging = null, layers = [];
  const zoomable = spec.zoom !== false;

  const box = h("div", { class: "chart" });
  const names = [...new Map(all.map((one) => [one.name, one])).values()];
  const reset = h("button", { type: "button", class: "quiet", hidden: true, onclick: () => zoom(full) }, "Show all");
  if (names.length > 1) {
    box.append(h("div", { class: "legend" },
      names.map((one) => h("button", {
        type: "button", class: `key ${one.style}`, "aria-pressed": String(!hidden.has(one.name)),
        onclick: (event) => {
          hidden.has(one.name) ? hidden.delete(one.name) : hidden.add(one.name);
          event.currentTarget.setAttribute("aria-pressed", String(!hidden.has(one.name)));
          picture.repaint();
        },
      }, h("i", { "aria-hidden": "true" }), one.label))));
  }
  parent.append(box);
  const label = `${spec.label}.`;
  const picture = figure(box, label, draw, { className: zoomable ? "zoomable" : "" });
  const holder = picture.holder;
  const bubble = tip(holder);
  fill(holder, {
    tabindex: "0", role: "group",
    "aria-label": `${label} Left and right read the values${zoomable ? ", plus and minus zoom, 0 shows everything" : ""}.`,
    onkeydown: keys, onpointermove: move, onpointerdown: press, onpointerup: release, onpointercancel: () => { dragging = null; },
    onpointerleave: (event) => { if (!dragging && event.pointerType !== "touch") leave(); }, onblur: leave, ondblclick: () => zoomable && zoom(full),
  }, []);
  if (zoomable) box.append(h("div", { class: "under" }, h("p", { class: "hint" }, "Drag across to zoom, double-click to see all."), reset));

  function draw(width) {
    layers = [];
    const narrow = width < 520;
    const left = narrow ? 44 : 56, right = 10;
    const heights = panels.map((panel) => (panel.height ?? 260) * (narrow ? 0.82 : 1));
    const total = heights.reduce((sum, one) => sum + one + 26, 0) + 38;
    const svg = canvas(width, total);
    const sx = axis(domain, [left, width - right], { log: spec.x.log, ticks: spec.x.ticks, count: Math.max(2, Math.floor(width / (spec.x.log ? 95 : 105))) });
    let top = 22;
    panels.forEach((panel, index) => {
      const bottom = top + heights[index];
      const shown = panel.series.filter((one) => !hidden.has(one.name));
      const banded = spec.oneBand ? shown.slice(-1) : shown; // bands over each other hide the lines
      const inside = (x) => x >= domain[0] && x <= domain[1];
      let range = [Infinity, -Infinity];
      for (const one of shown) for (const values of [one.y, ...(banded.includes(one) ? [one.low, one.high] : [])]) {
        range = extent(list(values).filter((value, at) => inside(one.x[at]) && (!panel.log || value > 0)), range);
      }
      range = extent(list(panel.points).filter((p) => inside(p[0])).map((p) => p[1]), range);
      range = extent(list(panel.rules).map((rule) => rule.y), range);
      if (panel.zero) range = extent([0], range);
      if (!(range[1] >= range[0])) range = [0, 1];
      if (panel.log) range = [range[0] * 0.8, range[1] * 1.25];
      else { const pad = (range[1] - range[0]) * 0.06 || Math.abs(range[0]) * 0.1 || 1; range = [range[0] - pad, range[1] + pad]; }
      const sy = axis(range, [bottom, top], { log: panel.log, count: Math.max(2, Math.round(heights[index] / 52)) });
      const clip = `clip-${++choices}`;
      svg.append(s("clipPath", { id: clip }, s("rect", { x: left, y: top, width: width - left - right, height: bottom - top })));
      const plot = s("g", { "clip-path": `url(#${clip})` });
      for (const [from, to] of list(spec.shade)) {
        const a = sx(clamp(from, ...domain)), b = sx(clamp(to, ...domain));
        if (Math.abs(b - a) > 0.5) plot.append(s("rect", { class: "shade", x: Math.min(a, b), y: top, width: Math.abs(b - a), height: bottom - top }));
      }
      for (const value of sy.ticks) {
        svg.append(s("line", { class: "grid", x1: left, x2: width - right, y1: sy(value), y2: sy(value) }),
          s("text", { class: "tick", x: left - 7, y: sy(value) + 4, "text-anchor": "end" }, panel.log ? text(value, 2) : tickText(value, sy.ticks)));
      }
      if (range[0] < 0 && range[1] > 0 && !panel.log) plot.append(s("line", { class: "zero", x1: left, x2: width - right, y1: sy(0), y2: sy(0) }));
      for (const [x, y, low, high] of list(panel.points)) {
        if (!isNumber(x) || !isNumber(y)) continue;
        const at = sx(x).toFixed(1);
        if (isNumber(low) && isNumber(high)) plot.append(s("line", { class: "reach", x1: at, x2: at, y1: sy(low).toFixed(1), y2: sy(high).toFixed(1) }));
        plot.append(s("circle", { class: "dot", cx: at, cy: sy(y).toFixed(1), r: 1.6 }));
      }
      for (const one of banded) if (one.low && one.high) plot.append(s("path", { class: `band ${one.style}`, d: bandPath(one.x, one.low, one.high, sx, sy) }));
      for (const one of shown) {
        let from = 0, to = one.x.length;
        while (from < to && one.x[from + 1] < domain[0]) from++;
        while (to > from && one.x[to - 2] > domain[1]) to--;
        plot.append(s("path", { class: `line ${one.style}`, d: linePath(one.x, one.y, sx, sy, from, to) }));
      }
      for (const rule of list(panel.rules)) plot.append(s("line", { class: "rule", x1: left, x2: width - right, y1: sy(rule.y), y2: sy(rule.y) }),
        rule.label && s("text", { class: "tick", x: width - right - 4, y: sy(rule.y) - 5, "text-anchor": "end" }, rule.label) || "");
      for (const mark of list(spec.x.marks)) if (inside(mark.x)) plot.append(s("line", { class: "rule", x1: sx(mark.x), x2: sx(mark.x), y1: top, y2: bottom }),
        s("text", { class: "tick", x: sx(mark.x) + (sx(mark.x) > (left + width) / 2 ? -5 : 5), y: top + 12, "text-anchor": sx(mark.x) > (left + width) / 2 ? "end" : "start" }, mark.label));
      svg.append(plot, s("text", { class: "axis-label", x: 0, y: top - 9 }, cut(unitText(panel.unit) ? `${panel.label} [${unitText(panel.unit)}]` : panel.label, Math.floor(width / 7))));
      const overlay = s("g", {});
      svg.append(overlay);
      layers.push({ panel, shown, sx, sy, top, bottom, overlay });
      if (index === panels.length - 1) {
        svg.append(s("line", { class: "base", x1: left, x2: width - right, y1: bottom, y2: bottom }));
        for (const value of sx.ticks) svg.append(s("line", { class: "base", x1: sx(value), x2: sx(value), y1: bottom, y2: bottom + 4 }),
          s("text", { class: "tick", x: sx(value), y: bottom + 17, "text-anchor": sx(value) > width - 22 ? "end" : "middle" }, spec.x.log ? text(value, 2) : tickText(value, sx.ticks)));
        svg.append(s("text", { class: "axis-label", x: width - right, y: bottom + 34, "text-anchor": "end" }, cut(unitText(spec.x.unit) ? `${spec.x.label} [${unitText(spec.x.unit)}]` : spec.x.label, Math.floor(width / 7))));
      }
      top = bottom + 26;
    });
    return svg;
  }
  function zoom(next) {
    domain = next;
    reset.hidden = next === full;
    leave();
    picture.repaint();
  }
  function leave() {
    cursor = null;
    bubble.hide();
    for (const layer of layers) layer.overlay.replaceChildren();
  }
  function where(event) { return event.clientX - holder.getBoundingClientRect().left; }
  function point(x) {
    if (!layers.length) return;
    cursor = x;
    const { sx } = layers[0];
    const rows = [];
    let at = x;
    layers.forEach((layer) => {
      const marks = [];
      layer.shown.forEach((one) => {
        const position = nearest(one.x, x);
        if (!isNumber(one.y[position])) return;
        at = one.x[position];
        marks.push(s("circle", { class: `mark ${one.style}`, cx: sx(at), cy: layer.sy(one.y[position]), r: 3.5 }));
        const bounds = one.low && one.high ? ` (${text(one.low[position], 3)}–${text(one.high[position], 3)})` : "";
        rows.push(h("div", {}, `${one.short ?? one.label}: `, h("b", {}, `${text(one.y[position], 3)} ${unitText(layer.panel.unit)}`), bounds));
      });
      layer.overlay.replaceChildren(s("line", { class: "cursor", x1: sx(at), x2: sx(at), y1: layer.top, y2: layer.bottom }), ...marks);
    });
    bubble.show(sx(at), layers[0].top + 60, h("div", { class: "faint" }, `${spec.x.label} ${text(at, 4)} ${unitText(spec.x.unit)}`), ...rows);
    spec.hover?.(at);
  }
  function move(event) {
    if (!layers.length) return;
    const { sx } = layers[0];
    const x = clamp(sx.invert(where(event)), ...domain);
    if (dragging !== null && zoomable) {
      const [a, b] = [sx(dragging), sx(x)];
      for (const layer of layers) layer.overlay.replaceChildren(s("rect", { class: "brush", x: Math.min(a, b), y: layer.top, width: Math.abs(b - a), height: layer.bottom - layer.top }));
      bubble.hide();
    } else point(x);
  }
  function press(event) {
    if (event.button || !layers.length) return;
    dragging = clamp(layers[0].sx.invert(where(event)), ...domain);
    if (zoomable) holder.setPointerCapture(event.pointerId);
  }
  function release(event) {
    if (dragging === null || !layers.length) return;
    const { sx } = layers[0];
    const end = clamp(sx.invert(where(event)), ...domain), start = dragging;
    dragging = null;
    if (zoomable && Math.abs(sx(end) - sx(start)) > 8) zoom([Math.min(start, end), Math.max(start, end)]);
    else point(end);
  }
  function keys(event) {
    if (!layers.length) return;
    const { sx } = layers[0], [a, b] = [sx(domain[0]), sx(domain[1])];
    const middle = sx(cursor ?? sx.invert((a + b) / 2)), step = (b - a) / (event.shiftKey ? 20 : 120);
    const span = (factor) => { const half = ((b - a) * factor) / 2; return [clamp(sx.invert(middle - half), ...full), clamp(sx.invert(middle + half), ...full)]; };
    if (event.key === "ArrowLeft") point(clamp(sx.invert(middle - step), ...domain));
    else if (event.key === "ArrowRight") point(clamp(sx.invert(middle + step), ...domain));
    else if (zoomable && (event.key === "+" || event.key === "=")) zoom(span(0.5));
    else if (zoomable && event.key === "-") { const next = span(2); zoom(next[0] <= full[0] && next[1] >= full[1] ? full : next); }
    else if (zoomable && (event.key === "0" || event.key === "Escape")) zoom(full);
    else return;
    event.preventDefault();
  }
  return picture;
}

// Bars with their values written beside them: rows of { label, path, style, low, high (paths), unit }.
function bars(parent, label, rows, { source = "diagnosis", rule = null, unit = "", scale = 1 } = {}) {
  const known = rows.filter((row) => isNumber(look(row.path, source)));
  if (!known.length) return null;
  const value = (path) => { const found = path && look(path, source); return isNumber(found) ? found * scale : null; };
  const most = Math.max(...known.flatMap((row) => [value(row.path), value(row.high) ?? 0]), 1e-300);
  const spoken = known.map((row) => `${row.label} ${text(value(row.path), 3)}`).join(", ");
  return figure(parent, `${label}: ${spoken}${unit ? ` ${unitText(unit)}` : ""}`, (width) => {
    const left = Math.min(96, width * 0.28), right = 70, tall = 40;
    const svg = canvas(width, known.length * tall + 14);
    const x = axis([0, most], [left, width - right]);
    known.forEach((row, index) => {
      const y = index * tall + 8, at = x(value(row.path));
      const low = value(row.low), high = value(row.high);
      svg.append(s("text", { class: "bar-label", x: left - 12, y: y + 18, "text-anchor": "end" }, row.label),
        s("rect", { class: `bar ${row.style}`, x: left, y: y + 2, width: Math.max(at - left, 1), height: 22, rx: 4, "data-bar": row.path.join(".") }));
      if (low !== null && high !== null) svg.append(s("path", { class: "whisker", d: `M${x(low)} ${y + 13}H${x(high)}M${x(low)} ${y + 8}v10M${x(high)} ${y + 8}v10` }));
      const limits = [value(row.within?.[0] ?? row.low), value(row.within?.[1] ?? row.high)];
      const shown = limits.every(isNumber) ? textWithin(value(row.path), ...limits) : text(value(row.path), 3);
      svg.append(s("text", { class: "bar-value", x: Math.max(at, high === null ? at : x(high)) + 8, y: y + 18, ...keyed(row.path, { source, scale }).attributes }, shown));
    });
    const level = value(rule);
    if (level !== null) svg.append(s("line", { class: "rule", x1: x(level), x2: x(level), y1: 0, y2: known.length * tall + 6 }));
    return svg;
  });
}

// A parameter's interval on a line that also shows where the effect would be off, if it is at a number.
function intervalBar(parent, label, { value, low, high, off = 0 }, style = "after") {
  const ends = extent([value, low, high, off]);
  if (!isNumber(value) || !(ends[1] > ends[0])) return;
  const where = isNumber(off) ? `, off at ${text(off, 3)}` : "";
  figure(parent, `${label}: ${text(value, 3)}, 95 % interval ${text(low, 3)} to ${text(high, 3)}${where}`, (width) => {
    const pad = (ends[1] - ends[0]) * 0.08, x = axis([ends[0] - pad, ends[1] + pad], [6, width - 6]);
    const svg = canvas(width, 34, s("line", { class: "track", x1: 6, x2: width - 6, y1: 11, y2: 11 }));
    if (isNumber(off)) svg.append(s("line", { class: "off", x1: x(off), x2: x(off), y1: 4, y2: 18 }),
      s("text", { class: "tick", x: x(off), y: 31, "text-anchor": x(off) > width - 20 ? "end" : x(off) < 14 ? "start" : "middle" }, off === 0 ? "0, off" : `${text(off, 3)}, off`));
    if (isNumber(low) && isNumber(high)) svg.append(s("line", { class: `span ${style}`, x1: x(low), x2: Math.max(x(high), x(low) + 1), y1: 11, y2: 11 }));
    svg.append(s("circle", { class: `mark ${style}`, cx: x(value), cy: 11, r: 5.5 }));
    return svg;
  }, { className: "strip" });
}
