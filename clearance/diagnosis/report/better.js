// How much better: errors on held-out data, the clearance, impacts, and recording against model before and after.

function better() {
  const held = dict(dict(DIAGNOSIS.fit).held_out), clearance = dict(DIAGNOSIS.clearance);
  const overlays = list(EVIDENCE.overlays).filter((one) => one?.channel !== undefined && list(one.time_s).length > 1);
  const runs = list(dict(EVIDENCE.signatures).recordings).map((run, index) => ({ ...dict(run), index })).filter((run) => list(run.phase).length || list(run.spectrum).length || filled(run.impacts));
  const profile = dict(EVIDENCE.clearance_profile);
  if (![isNumber(held.before), isNumber(held.after), isNumber(clearance.after_m), overlays.length, runs.length].some(Boolean)) return;
  const block = section("better", RIGHT ? "How well the model fits" : "How much better", RIGHT ? "On recordings that it was not fitted to." : "On recordings that the correction was not fitted to.");
  const row = h("div", { class: "columns" });
  block.append(row);
  if (isNumber(held.before) || isNumber(held.after)) {
    const box = card(row, "Error on held-out data");
    if (dict(DIAGNOSIS.fit).metric) box.append(h("p", { class: "hint" }, String(DIAGNOSIS.fit.metric)));
    const path = (key) => ["fit", "held_out", key];
    bars(box, "Error on held-out data", [...(RIGHT ? [] : [{ label: "before", path: path("before"), style: "before" }]), { label: RIGHT ? "model" : "corrected", path: path("after"), style: "after", low: path("low"), high: path("high") },
      { label: "floor", path: path("floor"), style: "floor", within: [path("low"), path("high")] }], { rule: path("floor") });
    if (isNumber(held.floor)) box.append(h("p", { class: "hint" }, `The floor is what a perfect model scores${isNumber(held.low) ? "; the whisker is the 95 % interval" : ""}.`));
  }
  if (isNumber(clearance.before_m) || isNumber(clearance.after_m)) {
    const box = card(row, `Clearance${clearance.joint ? ` in joint ${clearance.joint}` : ""}`);
    clearancePicture(box, clearance);
    clearanceProfile(box, profile, clearance);
  }
  impacts(row, runs);
  comparison(block, overlays, runs);
}

function clearancePicture(parent, clearance) {
  const mm = (key) => (isNumber(clearance[key]) ? clearance[key] * 1000 : null);
  const [before, after, low, high] = ["before_m", "after_m", "low_m", "high_m"].map(mm);
  const ends = extent([before, after, low, high]), pad = Math.max((ends[1] - ends[0]) * 0.22, ends[1] * 0.002, 1e-4);
  const shown = (value) => (low !== null && high !== null ? textWithin(value, low, high) : text(value, 4));
  figure(parent, `Clearance before ${text(before, 4)} mm, corrected ${text(after, 4)} mm`, (width) => {
    const left = Math.min(84, Math.max(74, width * 0.26)), x = axis([ends[0] - pad, ends[1] + pad], [left, width - 74], { count: 4 }), svg = canvas(width, 118);
    for (const value of x.ticks) svg.append(s("line", { class: "grid", x1: x(value), x2: x(value), y1: 6, y2: 84 }), s("text", { class: "tick", x: x(value), y: 100, "text-anchor": "middle" }, tickText(value, x.ticks)));
    svg.append(s("text", { class: "axis-label", x: width, y: 100, "text-anchor": "end" }, "[mm]"));
    [...(RIGHT ? [] : [["before", before, "before_m", 26]]), [RIGHT ? "model" : "corrected", after, "after_m", RIGHT ? 44 : 62]].forEach(([name, value, key, y]) => {
      if (value === null) return;
      const style = name === "before" ? "before" : "after";
      svg.append(s("text", { class: "bar-label", x: left - 12, y: y + 5, "text-anchor": "end" }, name));
      if (style === "after" && low !== null && high !== null) svg.append(s("line", { class: "span after", x1: x(low), x2: x(high), y1: y, y2: y }));
      svg.append(s("circle", { class: `mark ${style}`, cx: x(value), cy: y, r: 6 }), s("text", { class: "bar-value", x: (style === "after" && high !== null ? Math.max(x(high), x(value)) : x(value)) + 12, y: y + 5, ...keyed(["clearance", key], { scale: 1000 }).attributes }, shown(value)));
    });
    return svg;
  });
}

// How badly the motion alone, without any force, agrees with each clearance: where the search began.
function clearanceProfile(parent, profile, clearance) {
  const pairs = list(profile.clearance_m).map((value, index) => [value, list(profile.misfit)[index]]).filter(([value, misfit]) => isNumber(value) && misfit > 0).sort((a, b) => a[0] - b[0]);
  if (pairs.length < 3) return;
  const best = isNumber(clearance.after_m) ? clearance.after_m : pairs.reduce((a, b) => (b[1] < a[1] ? b : a))[0];
  const [low, high] = extent(pairs.map((pair) => pair[1]));
  curves(parent, { label: "Disagreement of the motion alone over the clearance", zoom: false, x: { label: "clearance", unit: "mm", marks: [{ x: best * 1000, label: text(best * 1000, 4) }] }, panels: [{ label: "disagreement of the motion alone", log: high > 20 * low, height: 130,
    series: [{ name: "profile", label: "disagreement", style: "after", x: pairs.map((pair) => pair[0] * 1000), y: pairs.map((pair) => pair[1]) }] }] });
}

function impacts(parent, runs) {
  const counted = runs.filter((run) => filled(run.impacts) && filled(run.impacts.recorded));
  if (!counted.length) return;
  const box = card(parent, "Impacts in the joint", "impacts"), stage = h("div", {});
  if (counted.length > 1) box.append(h("div", { class: "controls" }, picker("Recording", counted.map((run) => String(run.name ?? run.index)), (index) => show(counted[index]))));
  box.append(stage);
  show(counted[0]);

  function show(run) {
    stage.replaceChildren();
    const found = run.impacts, path = ["signatures", "recordings", run.index, "impacts"];
    const kinds = [["recorded", "recorded"], ["before", RIGHT ? "model" : "before"], ["after", "corrected"]].filter(([kind]) => filled(found[kind]) && !(RIGHT && kind === "after" && filled(found.before)));
    const group = (key, label, unit, more = () => ({})) => {
      if (!kinds.some(([kind]) => isNumber(found[kind][key]))) return;
      stage.append(h("p", { class: "small-head" }, unit ? `${label} [${unitText(unit)}]` : label));
      bars(stage, label, kinds.map(([kind, name]) => ({ label: name, path: [...path, kind, key], style: RIGHT && kind !== "recorded" ? "after" : kind, ...more(kind) })), { source: "evidence", unit });
    };
    group("per_revolution", "per revolution", "", (kind) => ({ low: [...path, kind, "low"], high: [...path, kind, "high"] }));
    group("median_strength", "median strength", found.unit);
    stage.append(h("p", { class: "hint" }, `Peaks above ${text(found.threshold, 3)} ${unitText(found.unit)} in ${words(found.channel)}, slow motion filtered out; the same rule for all. Whiskers: 95 % intervals.`));
  }
}

// ---- recording and model

const KINDS = RIGHT ? [RECORDED, { ...BEFORE, label: "model", style: "after" }] : [RECORDED, BEFORE, AFTER];

function comparison(block, overlays, runs) {
  const phased = runs.filter((run) => list(run.phase).length), lined = runs.filter((run) => list(run.spectrum).length);
  const views = [["turn", "one turn", phased], ["spectrum", "spectrum", lined], ["time", "time", overlays]].filter(([, , found]) => found.length);
  if (!views.length) return;
  const box = card(block, "Model and recording, held out", "comparison");
  const weight = (name) => dict(dict(DIAGNOSIS.mismatch).channels)[name] ?? 0; // the channel that shows it most comes first
  const named = [...overlays, ...runs.flatMap((run) => [...list(run.phase), ...list(run.spectrum)])].map((one) => String(one?.channel));
  const channels = [...new Set(named)].sort((a, b) => weight(b) - weight(a));
  let view = views[0][0], channel = 0, run = runs[0];
  const stage = h("div", {}), hidden = new Set();
  const which = runs.length > 1 && picker("Recording", runs.map((one) => String(one.name ?? one.index)), (value) => { run = runs[value]; show(); });
  box.append(h("div", { class: "controls" }, views.length > 1 && choice("Show", views, view, (value) => { view = value; show(); }),
    picker("Channel", channels.map(words), (value) => { channel = value; show(); }), which), stage);
  const turnRanges = list(dict(DIAGNOSIS.mismatch).crank_angle_deg).flatMap(([from, to]) => [[from, to], [from - 360, to - 360], [from + 360, to + 360]]);
  show();

  function show() {
    stage.replaceChildren();
    if (which) which.hidden = view === "time"; // one recording is enough to see what a millisecond's prediction is
    const found = { time: overlays, turn: list(run.phase), spectrum: list(run.spectrum) }[view];
    const at = found.findIndex((one) => String(one?.channel) === channels[channel]);
    if (at < 0) stage.append(h("p", { class: "hint" }, "Not available for this channel."));
    else ({ time: course, turn: phase, spectrum: spectrum })[view](found[at], at);
  }

  function plotted(one, x, values) {
    return KINDS.filter(({ name }) => values(one, name).length).map((kind) => ({ ...kind, x, y: values(one, kind.name) }));
  }
  function rest(one, series, values, unit) {
    const recorded = values(one, "recorded");
    const found = series.filter(({ name }) => name !== "recorded").map((kind) => ({ ...kind, low: undefined, high: undefined, short: `recorded minus ${kind.label}`, y: kind.y.map((value, at) => (isNumber(value) && isNumber(recorded[at]) ? recorded[at] - value : null)) }));
    return recorded.length && found.length ? [{ label: "recorded minus model", unit, height: 120, series: found }] : [];
  }
  const ahead = typeof dict(EVIDENCE.where).title !== "string"; // else predictions are of the whole run
  function course(one) {
    const values = (from, name) => list(from[name]), series = plotted(one, one.time_s, values);
    curves(stage, { label: `${words(one.channel)}: recorded, and ${ahead ? "predicted ten samples ahead" : "run from its start"}`, x: { label: "time", unit: "s" }, hidden,
      panels: [{ label: words(one.channel), unit: one.unit, height: 270, series }, ...rest(one, series, values, one.unit)] });
    if (ahead) stage.append(h("p", { class: "hint" }, "Predictions start anew from the recording every ten samples, a millisecond at 10 kHz."));
  }
  function phase(one, at) {
    const values = (from, name) => list(dict(from[name]).mean), x = list(run.crank_angle_deg);
    const series = plotted(one, x, values).map((kind) => {
      const spread = list(dict(one[kind.name]).spread), side = (sign) => kind.y.map((value, index) => (isNumber(value) && isNumber(spread[index]) ? value + sign * spread[index] : null));
      return spread.some(isNumber) ? { ...kind, low: side(-1), high: side(1) } : kind;
    });
    curves(stage, { label: `${words(one.channel)}: average over the revolutions of the crank`, x: { label: "crank angle", unit: "°", ticks: degreeTicks }, hidden, oneBand: true, shade: turnRanges, hover: (angle) => crank.turn(angle, "phase"),
      panels: [{ label: words(one.channel), unit: one.unit, height: 270, series }, ...rest(one, series, values, one.unit)] });
    stage.append(h("p", { class: "hint" }, "Averages over revolutions of free runs", isNumber(run.revolutions) ? [" and of ", number(["signatures", "recordings", run.index, "revolutions"], { source: "evidence" }), " recorded ones"] : "",
      ". The band is what single revolutions vary by, of the last curve that is switched on: two equal machines differ by that."));
    distances(at);
  }
  function spectrum(one) {
    const values = (from, name) => list(from[name]);
    curves(stage, { label: `${words(one.channel)}: amplitude spectral density`, x: { label: "frequency", unit: "Hz", log: true }, hidden, shade: dict(DIAGNOSIS.mismatch).frequency_hz,
      panels: [{ label: words(one.channel), unit: one.unit, log: true, height: 270, series: plotted(one, list(run.frequency_hz), values) }] });
  }

  // How far each channel's average is from the recorded one.
  function distances(chosen) {
    const rows = list(run.phase).map((one, index) => ({ name: String(one.channel), index, values: KINDS.filter(({ name }) => isNumber(dict(one.distance)[name])) })).filter((one) => one.values.length);
    if (!rows.length) return;
    const path = (index, name) => ["signatures", "recordings", run.index, "phase", index, "distance", name], of = (index, name) => look(path(index, name), "evidence");
    stage.append(h("p", { class: "small-head" }, "Distance of the averages from the recorded ones, in standard errors"));
    const spoken = rows.map((one) => `${words(one.name)} ${one.values.map(({ name, label }) => `${label} ${text(of(one.index, name), 2)}`).join(", ")}`).join("; ");
    figure(stage, `Distances of the phase averages: ${spoken}`, (width) => {
      const gutter = Math.min(14 + 6.9 * Math.max(...rows.map((one) => Math.min(words(one.name).length, 22))), width * 0.4), tall = 24, bottom = rows.length * tall + 4;
      const [low, high] = extent(rows.flatMap((one) => one.values.map(({ name }) => of(one.index, name))), [0.5, 2]), right = width < 520 ? 66 : 92;
      const x = axis([low * 0.85, high * 1.15], [gutter, width - right], { log: true, count: Math.max(2, Math.floor((width - gutter - right) / 60)) }), svg = canvas(width, bottom + 24);
      for (const value of x.ticks) svg.append(s("line", { class: "grid", x1: x(value), x2: x(value), y1: 0, y2: bottom }), s("text", { class: "tick", x: x(value), y: bottom + 17, "text-anchor": "middle" }, text(value, 2)));
      svg.append(s("line", { class: "rule", x1: x(1), x2: x(1), y1: 0, y2: bottom }));
      rows.forEach((one, index) => {
        const y = index * tall + tall / 2, ends = extent(one.values.map(({ name }) => of(one.index, name)));
        svg.append(s("text", { class: `row-label${one.index === chosen ? " chosen" : ""}`, x: gutter - 12, y: y + 4, "text-anchor": "end" }, cut(words(one.name), Math.min(22, Math.floor((gutter - 12) / 6.6)))),
          s("line", { class: "track", x1: x(ends[0]), x2: x(ends[1]), y1: y, y2: y }));
        one.values.forEach(({ name, style }) => svg.append(s("circle", { class: `mark ${style}`, cx: x(of(one.index, name)), cy: y, r: 5 })));
        const label = s("text", { class: "tick", x: width, y: y + 4, "text-anchor": "end" });
        one.values.forEach(({ name }, place) => label.append(place ? " → " : "", s("tspan", keyed(path(one.index, name), { source: "evidence" }).attributes, text(of(one.index, name), 2))));
        svg.append(label);
      });
      return svg;
    });
    stage.append(h("p", { class: "hint" }, `A right model lies about 1 standard error away${RIGHT ? "" : "; left of the arrow before, right of it corrected"}.`));
  }
}
