// Where the innovations exceed what noise explains: channels by crank angle, by contact state and by frequency, one scale.

const LEVELS = 9;

function heatMap(parent, where) {
  const channels = list(where.channels);
  const angles = list(where.crank_angle_deg), heat = list(where.heat), after = list(where.heat_after);
  const states = ["contact", "flight", "sliding"].filter((state) => channels.some((name) => isNumber(dict(dict(where.regimes)[name])[state])));
  const byState = (found) => channels.map((name) => states.map((state) => dict(dict(found)[name])[state] ?? null));
  const panels = [];
  if (angles.length && heat.length) {
    const step = angles.length > 1 ? (angles[angles.length - 1] - angles[0]) / (angles.length - 1) : 360;
    panels.push({
      name: "crank angle", weight: 0.55, before: heat, after: after.length ? after : null, marked: list(where.significant),
      columns: angles.map((centre) => ({ label: `${text(centre - step / 2, 4)}–${text(centre + step / 2, 4)}°`, from: centre - step / 2, to: centre + step / 2, centre })),
      domain: [angles[0] - step / 2, angles[angles.length - 1] + step / 2], kind: "angle",
    });
  }
  if (states.length) panels.push({
    name: "contact state", weight: 0.19, before: byState(where.regimes), after: filled(where.regimes_after) ? byState(where.regimes_after) : null,
    columns: states.map((state, index) => ({ label: state, from: index, to: index + 1 })), domain: [0, states.length], kind: "state",
    marked: channels.map((name) => states.map((state) => list(dict(where.significant_regimes)[name]).includes(state))),
  });
  const frequencies = list(where.frequency_hz);
  if (frequencies.length > 1 && filled(where.spectrum)) {
    const gap = frequencies[1] - frequencies[0], first = Math.max(frequencies[0], gap), ratio = (frequencies[frequencies.length - 1] / first) ** (1 / 24);
    const starts = []; // columns of equal ratio: what matters is mostly low
    frequencies.forEach((value, index) => { if (!starts.length || value >= Math.max(first, frequencies[starts[starts.length - 1]]) * ratio) starts.push(index); });
    const byBand = (found) => channels.map((name) => starts.map((start, index) => {
      const [, most] = extent(list(dict(found)[name]).slice(start, starts[index + 1] ?? frequencies.length));
      return Number.isFinite(most) ? most : null;
    }));
    panels.push({
      name: "frequency", weight: 0.26, kind: "frequency",
      marked: channels.map((name) => starts.map((start, index) => list(dict(where.significant_spectrum)[name]).slice(start, starts[index + 1] ?? frequencies.length).some(Boolean))),
      before: byBand(where.spectrum), after: filled(where.spectrum_after) ? byBand(where.spectrum_after) : null,
      columns: starts.map((start, index) => {
        const from = Math.max(0, frequencies[start] - gap / 2), to = starts[index + 1] === undefined ? frequencies[frequencies.length - 1] + gap / 2 : frequencies[starts[index + 1]] - gap / 2;
        return { label: `${text(from, 3)}–${text(to, 3)} Hz`, from: index, to: index + 1, hertz: from };
      }), domain: [0, starts.length],
    });
  }
  if (!channels.length || !panels.length) return false;

  const most = Math.max(3, ...panels.map((panel) => panel.before.reduce((found, row) => Math.max(found, extent(list(row))[1]), 0)));
  const level = (ratio) => (isNumber(ratio) ? clamp(Math.floor((LEVELS * Math.log(Math.max(ratio, 1e-9) / 1.12)) / Math.log(most / 1.12)), 0, LEVELS - 1) : "x");
  let view = "before", cells = [], cursor = null, frame = null, guides = [];
  const values = (panel) => (view === "after" && panel.after ? panel.after : panel.before);

  const controls = h("div", { class: "controls" });
  if (after.length) controls.append(choice("Model", [["before", "before"], ["after", "corrected"]], "before", (value) => { view = value; recolour(); }));
  controls.append(scale());
  parent.append(controls);
  const worst = (panel) => { let best = { ratio: -1 }; panel.before.forEach((row, r) => list(row).forEach((ratio, c) => { if (ratio > best.ratio) best = { ratio, r, c }; })); return best; };
  const peak = worst(panels[0]);
  const label = `Heat map of ${channels.length} channels by ${panels.map((panel) => panel.name).join(", ")}: the error in units of the expected noise. ` +
    (peak.ratio > 0 ? `Largest: ${text(peak.ratio, 3)} in ${words(channels[peak.r])} at ${panels[0].columns[peak.c].label}.` : "");
  const picture = figure(parent, label, draw, { className: "heat" });
  const holder = picture.holder, bubble = tip(holder);
  fill(holder, {
    tabindex: "0", role: "group", "aria-label": `${label} Arrow keys move from cell to cell.`, onkeydown: keys,
    onpointerleave: leave, onblur: leave, onpointermove: pointed, onpointerdown: pointed,
  }, []);
  parent.append(h("p", { class: "hint" }, panels.some((panel) => panel.marked && panel.marked.some((line) => list(line).some(Boolean)))
    ? "Outlined cells stand out after allowing for the number of cells looked at. Point at a cell for its value; the mechanism above turns with it."
    : "Point at a cell for its value; the mechanism above turns with it."));
  crank.follow((angle) => { for (const guide of guides) guide(angle); });
  return true;

  function scale() {
    const ticks = [1, 2, 3, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000, 10000].filter((value) => value <= most * 1.001 && (most < 12 || value !== 3));
    const holder = h("div", { class: "scale" });
    figure(holder, `Colour scale from 1, noise alone, to ${text(most, 3)} times the noise`, (width) => {
      const svg = canvas(width, 36), x = (ratio) => (Math.log(Math.max(ratio, 1.0) / 1) / Math.log(most)) * (width - 2) + 1;
      for (let index = 0; index < LEVELS; index++) {
        const edge = (at) => (at === 0 ? 1 : x(1.12 * (most / 1.12) ** (at / LEVELS)));
        svg.append(s("rect", { class: `h${index}`, x: edge(index), y: 2, width: edge(index + 1) - edge(index) + 0.5, height: 12 }));
      }
      let end = -100;
      for (const value of ticks) {
        const at = x(value), label = value === 1 ? "1 = noise" : `${value}×`, long = 6.2 * label.length;
        const anchor = value === 1 ? "start" : at > width - long / 2 ? "end" : "middle";
        const begin = at - { start: 0, middle: long / 2, end: long }[anchor];
        if (begin < end + 6) continue;
        end = begin + long;
        svg.append(s("text", { class: "tick", x: at, y: 29, "text-anchor": anchor }, label));
      }
      return svg;
    });
    return holder;
  }

  function draw(width) {
    const wide = width >= 760, row = wide ? 27 : 20;
    const gutter = Math.min(width * 0.44, 14 + 6.9 * Math.max(...channels.map((name) => Math.min(words(name).length, 22))));
    const tall = channels.length * row, gap = 22, block = tall + 62;
    const present = panels.reduce((sum, panel) => sum + panel.weight, 0), room = width - gutter - 6 - gap * (panels.length - 1);
    const svg = canvas(width, wide ? block : block * panels.length);
    cells = []; guides = []; frame = s("rect", { class: "cell-cursor", visibility: "hidden" });
    let left = gutter, top = 22;
    panels.forEach((panel, index) => {
      const wideness = wide ? (room * panel.weight) / present : width - gutter - 6;
      if (!wide) { left = gutter; top = 22 + index * block; }
      const sx = axis(panel.domain, [left, left + wideness]);
      svg.append(s("text", { class: "axis-label", x: left, y: top - 8 }, panel.kind === "angle" ? "over the crank angle" : `${panel.kind === "state" ? "contact state" : "frequency"}${after.length && !panel.after ? ", before" : ""}`));
      channels.forEach((name, r) => {
        if (!wide || index === 0) {
          const shown = words(name);
          svg.append(s("text", { class: "row-label", x: gutter - 8, y: top + r * row + row / 2 + 4, "text-anchor": "end" }, cut(shown, Math.min(22, Math.floor((gutter - 8) / 6.3))), s("title", {}, name)));
        }
        panel.columns.forEach((column, c) => {
          const x = sx(column.from), cell = s("rect", { x: x + 0.4, y: top + r * row + 0.5, width: Math.max(sx(column.to) - x - (panel.kind === "state" ? 1.5 : 0.6), 0.6), height: row - 1, rx: 1.5 });
          cells.push({ cell, panel, r, c, index });
          svg.append(cell);
        });
      });
      if (panel.marked && panel.marked.length) svg.append(s("path", { class: "contour", d: contour(panel.marked, panel.columns, sx, top, row) }));
      panel.roomy = wideness > 170;
      axisOf(panel, svg, sx, top + tall);
      if (panel.kind === "angle") {
        const line = s("line", { class: "cursor", y1: top - 3, y2: top + tall + 3, visibility: "hidden" });
        svg.append(line);
        guides.push((angle) => { line.setAttribute("visibility", "visible"); const x = sx(clamp(angle < panel.domain[0] ? angle + 360 : angle, ...panel.domain)); line.setAttribute("x1", x); line.setAttribute("x2", x); });
      }
      panel.place = { left, top, sx, row, wideness };
      left += wideness + gap;
    });
    svg.append(frame);
    recolour();
    return svg;
  }
  function axisOf(panel, svg, sx, bottom) {
    const put = (x, shown, anchor = "middle") => svg.append(s("text", { class: "tick", x, y: bottom + 16, "text-anchor": anchor }, shown));
    if (panel.kind === "angle") for (const angle of panel.roomy ? [0, 90, 180, 270, 360] : [0, 180, 360]) { if (angle >= panel.domain[0] - 1 && angle <= panel.domain[1] + 1) put(sx(clamp(angle, ...panel.domain)), `${angle}°`, angle === 0 ? "start" : angle === 360 ? "end" : "middle"); }
    else if (panel.kind === "state") panel.columns.forEach((column) => { const room = sx(1) - sx(0); put(sx(column.from + 0.5), room < 44 ? `${column.label.slice(0, Math.max(3, Math.floor(room / 7.5)))}.` : column.label); });
    else {
      const count = panel.columns.length, every = Math.ceil(count / 3);
      panel.columns.forEach((column, index) => { if (index % every === 0 && count - index > every / 2) put(sx(column.from), text(column.hertz, 2), index === 0 ? "start" : "middle"); });
      put(sx(count), "Hz", "end");
    }
  }
  function contour(marked, columns, sx, top, row) {
    const on = (r, c) => Boolean(marked[r] && marked[r][c]), parts = [];
    marked.forEach((line, r) => line.forEach((_, c) => {
      if (!on(r, c) || !columns[c]) return;
      const [x0, x1, y0, y1] = [sx(columns[c].from), sx(columns[c].to), top + r * row, top + (r + 1) * row];
      if (!on(r, c - 1)) parts.push(`M${x0} ${y0}V${y1}`);
      if (!on(r, c + 1)) parts.push(`M${x1} ${y0}V${y1}`);
      if (!on(r - 1, c)) parts.push(`M${x0} ${y0}H${x1}`);
      if (!on(r + 1, c)) parts.push(`M${x0} ${y1}H${x1}`);
    }));
    return parts.join("");
  }
  function recolour() {
    for (const { cell, panel, r, c } of cells) {
      const ratio = values(panel)[r]?.[c];
      cell.setAttribute("class", `cell h${level(ratio)}${view === "after" && !panel.after ? " stale" : ""}`);
    }
  }
  function choose(panel, r, c) {
    cursor = { panel, r, c };
    const { sx, top, row } = panel.place, column = panel.columns[c];
    const x = sx(column.from), wide = sx(column.to) - x;
    for (const [name, value] of Object.entries({ x, y: top + r * row, width: wide, height: row, visibility: "visible" })) frame.setAttribute(name, value);
    const ratio = (rows) => `${text(rows?.[r]?.[c], 3)} × noise`;
    bubble.show(x + wide, top + r * row, h("div", { class: "faint" }, `${words(channels[r])}, ${column.label}`),
      h("div", {}, "before: ", h("b", {}, ratio(panel.before))), panel.after ? h("div", {}, "after: ", h("b", {}, ratio(panel.after))) : "",
      panel.marked?.[r]?.[c] ? h("div", {}, "stands out") : "");
    if (panel.kind === "angle") crank.turn(column.centre, "heat");
  }
  function leave() { cursor = null; bubble.hide(); frame?.setAttribute("visibility", "hidden"); }
  function pointed(event) {
    const bounds = holder.getBoundingClientRect(), x = event.clientX - bounds.left, y = event.clientY - bounds.top;
    for (const panel of panels) {
      const place = panel.place;
      if (!place || x < place.left || x > place.left + place.wideness || y < place.top || y >= place.top + channels.length * place.row) continue;
      const at = place.sx.invert(x), c = panel.columns.findIndex((column) => at >= column.from && at < column.to);
      if (c >= 0) { choose(panel, Math.floor((y - place.top) / place.row), c); return; }
    }
    leave();
  }
  function keys(event) {
    const moves = { ArrowLeft: [0, -1], ArrowRight: [0, 1], ArrowUp: [-1, 0], ArrowDown: [1, 0] }[event.key];
    if (!moves) return;
    event.preventDefault();
    if (!cursor) { choose(panels[0], Math.max(peak.r ?? 0, 0), Math.max(peak.c ?? 0, 0)); return; }
    let index = panels.indexOf(cursor.panel), r = clamp(cursor.r + moves[0], 0, channels.length - 1), c = cursor.c + moves[1];
    if (c >= panels[index].columns.length) { if (index + 1 < panels.length) { index += 1; c = 0; } else c -= 1; }
    if (c < 0) { if (index > 0) { index -= 1; c = panels[index].columns.length - 1; } else c = 0; }
    choose(panels[index], r, c);
  }
}
