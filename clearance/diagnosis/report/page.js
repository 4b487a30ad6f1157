// The page from top to bottom: where, what, how much better, what else it could be, the curve, what could be seen, checks.

const SECTIONS = document.getElementById("sections");
const CONTENTS = document.getElementById("contents");

const RIGHT = DIAGNOSIS.verdict === "none"; // the model is right as it is
const BEFORE = { name: "before", label: "model before", style: "before" };
const AFTER = { name: "after", label: "model corrected", style: "after" };
const RECORDED = { name: "recorded", label: "recorded", style: "recorded" };

function section(id, heading, lead) {
  const block = h("section", { id, class: "block", "aria-labelledby": `${id}-title` }, h("h2", { id: `${id}-title` }, heading), lead && h("p", { class: "lead" }, lead));
  SECTIONS.append(block);
  CONTENTS.append(h("a", { href: `#${id}` }, heading));
  return block;
}

function card(parent, heading, className = "") {
  const box = h("div", { class: `card ${className}` }, heading && h("h3", {}, heading));
  parent.append(box);
  return box;
}

// A picture that fails is named on the page; the others are drawn all the same.
function attempt(name, build) {
  try { build(); } catch (error) {
    document.documentElement.setAttribute("data-error", `${name}: ${error.message}`);
    SECTIONS.append(h("p", { class: "warnings" }, `The part “${name}” could not be drawn: ${error.message}`));
  }
}

function join(parts, last = " and ") {
  return parts.flatMap((part, index) => (index === 0 ? [part] : [index === parts.length - 1 ? last : ", ", part]));
}

function ranges(path, unit) {
  return join(list(look(path)).map((range, index) => (list(range).length === 2 ? h("span", { class: "nowrap" }, number([...path, index, 0]), "–", number([...path, index, 1]), unit) : "")), ", ");
}

// ---- head

function head() {
  const recordings = list(DIAGNOSIS.recordings);
  const line = document.getElementById("recordings");
  if (recordings.length) line.append(`${recordings.length} recording${recordings.length > 1 ? "s" : ""}`);
  if (isNumber(DIAGNOSIS.seconds)) line.append(recordings.length ? ", " : "", "found in ", number(["seconds"]), " s");

  const held = dict(dict(DIAGNOSIS.fit).held_out), clearance = dict(DIAGNOSIS.clearance), mismatch = dict(DIAGNOSIS.mismatch);
  const figures = [];
  const change = (from, to) => [from && h("span", { class: "from" }, from), from && to && h("span", { class: "arrow-to", "aria-label": "to" }, "→"), to && h("span", { class: "to" }, to)];
  if (isNumber(held.before) || isNumber(held.after)) {
    const within = isNumber(held.low) && isNumber(held.high) ? [held.low, held.high] : null;
    figures.push(["Error on held-out data", change(isNumber(held.before) && number(["fit", "held_out", "before"]), isNumber(held.after) && number(["fit", "held_out", "after"], { within })),
      isNumber(held.floor) ? ["a perfect model scores ", number(["fit", "held_out", "floor"], { within })] : ""]);
  }
  if (isNumber(clearance.before_m) || isNumber(clearance.after_m)) {
    const limits = [clearance.low_m, clearance.high_m].map((value) => (isNumber(value) ? value * 1000 : null));
    const options = { scale: 1000, within: limits.every(isNumber) ? limits : null };
    figures.push([`Clearance${clearance.joint ? ` in joint ${clearance.joint}` : ""}`,
      [change(isNumber(clearance.before_m) && number(["clearance", "before_m"], options), isNumber(clearance.after_m) && number(["clearance", "after_m"], options)), h("small", {}, "mm")],
      options.within ? ["95 % interval ", number(["clearance", "low_m"], options), "–", number(["clearance", "high_m"], options), " mm"] : ""]);
  } else if (isNumber(clearance.high_m)) figures.push([`Clearance${clearance.joint ? ` in joint ${clearance.joint}` : ""}`, ["below ", number(["clearance", "high_m"], { scale: 1000 }), h("small", {}, "mm")], "the recordings show no more than this bound"]);
  if (isNumber(mismatch.p_value)) figures.push(["Chance of this if nothing were missing", number(["mismatch", "p_value"]), mismatch.detected === false ? "not unusual" : ""]);
  document.getElementById("key-figures").append(...figures.map(([name, value, note]) => h("div", { class: "figure" }, h("div", { class: "name" }, name), h("div", { class: "value" }, value), h("div", { class: "note" }, note))));

  const speed = (value, path) => (Array.isArray(value) ? join(value.map((_, index) => number([...path, index])), "–") : number(path));
  if (recordings.length) document.getElementById("recording-table").append(h("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": "Recordings" }, h("table", {},
    h("thead", {}, h("tr", {}, ["Recording", "Length [s]", "Held out [s]", "Rate [Hz]", "Speed [rpm]", "Channels"].map((name, index) => h("th", { class: index > 0 && index < 5 ? "right" : "" }, name)))),
    h("tbody", {}, recordings.map((recording, index) => h("tr", {}, h("th", { scope: "row" }, String(recording?.name ?? "")),
      ["seconds", "held_out_seconds", "rate_hz", "speed_rpm"].map((key) => h("td", { class: "right" }, speed(recording?.[key], ["recordings", index, key]))),
      h("td", { class: "channels" }, list(recording?.channels).map(words).join(", "))))))));
}

// ---- where

const BODIES = { crank: "crank", rod: "rod", slider: "slider", frame: "frame", joint_b: "joint B", joint_c: "joint C", instrument: "an instrument" };
const DIRECTIONS = { x: "x, to the right in the drawing", y: "y, upward in the drawing" };
const REGIMES = { contact: "while the joint is in contact", flight: "while the joint is in free flight", sliding: "while it slides", all: "in contact and in flight alike" };

function where() {
  const mismatch = dict(DIAGNOSIS.mismatch), detected = mismatch.detected !== false && DIAGNOSIS.verdict !== "none";
  const block = section("where", "Where", detected ? null : "No channel, angle or frequency stands out from the noise.");
  const scene = h("div", { class: "scene" });
  block.append(scene);
  const stage = h("div", { class: "stage" });
  scene.append(stage);
  const facts = h("dl", { class: "facts" });
  const fact = (name, ...value) => facts.append(h("div", {}, h("dt", {}, name), h("dd", {}, ...value)));
  if (detected) {
    if (mismatch.body) fact("Body", BODIES[mismatch.body] ?? words(mismatch.body));
    if (mismatch.direction) fact("Direction", DIRECTIONS[mismatch.direction] ?? words(mismatch.direction));
    if (mismatch.regime) fact("When", REGIMES[mismatch.regime] ?? words(mismatch.regime));
    if (list(mismatch.crank_angle_deg).length) fact("Crank angle", ranges(["mismatch", "crank_angle_deg"], "°"));
    if (list(mismatch.frequency_hz).length) fact("Frequency", ranges(["mismatch", "frequency_hz"], "\u00a0Hz"));
    const weights = Object.entries(dict(mismatch.channels)).filter(([, weight]) => isNumber(weight)).sort((a, b) => b[1] - a[1]);
    const most = Math.max(...weights.map(([, weight]) => weight), 1e-12);
    if (weights.length) fact("Channels, by their share", h("ul", { class: "weights" }, weights.slice(0, 6).map(([name, weight]) => h("li", {}, h("span", {}, words(name)), " ", number(["mismatch", "channels", name], { digits: 2 }),
      s("svg", { viewBox: "0 0 100 4", preserveAspectRatio: "none", "aria-hidden": "true" }, s("rect", { class: "track", width: 100, height: 4, rx: 2 }), s("rect", { class: "bar culprit", width: (100 * weight) / most, height: 4, rx: 2 }))))));
  } else fact("Result", "The model explains the recordings to within their noise.");
  if (facts.children.length) scene.append(facts);
  mechanismDrawing(stage);
  if (filled(EVIDENCE.where)) {
    const box = card(block, EVIDENCE.where.title ?? "Error of one-millisecond predictions, in units of the expected noise");
    if (!heatMap(box, EVIDENCE.where)) box.remove();
  }
  const force = EVIDENCE.missing_force;
  if (force && list(force.time_s).length > 1) {
    const box = card(block, `The force that the model lacks: on the ${BODIES[force.body] ?? words(force.body)}${force.direction ? `, ${words(force.direction)}` : ""}`);
    curves(box, { label: "Missing force over time with its 95 % interval", x: { label: "time", unit: "s" }, panels: [{ label: "missing force", unit: force.unit, height: 210, zero: true,
      series: [{ name: "force", label: "estimate", style: "after", x: force.time_s, y: list(force.value), low: force.low, high: force.high }] }] });
  }
}

// ---- what

function what() {
  const effects = list(DIAGNOSIS.effects), ranking = list(EVIDENCE.ranking);
  if (!effects.length && !ranking.length) return;
  const block = section("what", "What", effects.length ? null : DIAGNOSIS.verdict === "none" ? "No effect is asserted." : "None of the known effects is asserted.");
  if (effects.length) {
    const row = h("div", { class: "effects" });
    block.append(row);
    effects.forEach((effect, index) => {
      const box = card(row, title(effect.name), "effect");
      box.append(h("p", { class: "kind" }, words(effect.kind), isNumber(effect.probability) && [", probability ", number(["effects", index, "probability"])]));
      parameters(box, effect.parameters, ["effects", index, "parameters"], "diagnosis");
    });
  }
  if (ranking.length) {
    const box = card(block, `Everything that was tried (${ranking.length})`);
    box.append(h("p", { class: "hint" }, "Bar: how much better the effect explains the recordings it was fitted to (log-likelihood gain in nats, logarithmic). Asserted effects are blue."));
    const items = h("ol", { class: "ranking" });
    box.append(items);
    const most = Math.log1p(Math.max(...ranking.map((entry) => (isNumber(entry.log_likelihood_gain) ? entry.log_likelihood_gain : 0)), 1));
    ranking.forEach((entry, index) => {
      const path = ["ranking", index], gain = Math.max(entry.log_likelihood_gain ?? 0, 0), short = 8;
      const values = h("details", { class: "more" }, h("summary", {}, "parameters"));
      const item = h("li", { class: entry.asserted ? "asserted" : "", hidden: index >= short },
        h("div", { class: "name" }, h("b", {}, title(entry.name)), entry.asserted && h("span", { class: "tag" }, "asserted"), h("span", { class: "kind" }, words(entry.kind)), entry.note && h("span", { class: "note" }, String(entry.note))),
        h("div", { class: "gain" }, s("svg", { viewBox: "0 0 100 8", preserveAspectRatio: "none", "aria-hidden": "true" }, s("rect", { class: "track", width: 100, height: 8 }), s("rect", { class: `bar ${entry.asserted ? "after" : "other"}`, width: (100 * Math.log1p(gain)) / most, height: 8 }))),
        h("div", { class: "values" }, isNumber(entry.log_likelihood_gain) && h("span", {}, "gain ", number([...path, "log_likelihood_gain"], { source: "evidence" })),
          isNumber(entry.p_value) && h("span", {}, "p ", number([...path, "p_value"], { source: "evidence", digits: 2 })),
          isNumber(entry.held_out) && h("span", {}, "held-out error ", number([...path, "held_out"], { source: "evidence" }))));
      if (filled(entry.parameters)) {
        parameters(values, entry.parameters, [...path, "parameters"], "evidence", entry.asserted ? "after" : "other");
        item.append(values);
      }
      items.append(item);
    });
    if (ranking.length > 8) box.append(h("button", { type: "button", class: "quiet", onclick: (event) => { for (const item of items.children) item.hidden = false; event.currentTarget.remove(); } }, `Show all ${ranking.length}`));
  }
}

function parameters(parent, values, path, source, style = "after") {
  const rows = h("div", { class: "parameters" });
  parent.append(rows);
  for (const [name, value] of Object.entries(dict(values))) {
    const row = h("div", { class: "parameter" });
    rows.append(row);
    if (!isNumber(value?.value)) { row.append(h("span", {}, words(name)), h("b", {}, String(value?.value ?? value ?? "–"))); continue; }
    row.append(h("span", {}, words(name)), interval([...path, name], { source, unit: value.unit }));
    intervalBar(row, words(name), value, style);
  }
}

// ---- how much better

function better() {
  const held = dict(dict(DIAGNOSIS.fit).held_out), clearance = dict(DIAGNOSIS.clearance);
  const known = (entries, x) => list(entries).filter((one) => one?.channel !== undefined && list(one[x]).length > 1);
  const series = { time: known(EVIDENCE.overlays, "time_s"), turn: known(EVIDENCE.phase, "angle_deg"), spectrum: known(EVIDENCE.spectra, "frequency_hz") };
  const profile = dict(EVIDENCE.clearance_profile);
  const bits = [isNumber(held.before), isNumber(clearance.after_m), ...Object.values(series).map((one) => one.length), filled(EVIDENCE.impacts)];
  if (!bits.some(Boolean)) return;
  const block = section("better", RIGHT ? "How well the model fits" : "How much better", RIGHT ? "On recordings that it was not fitted to." : "On recordings that the correction was not fitted to.");
  const row = h("div", { class: "columns" });
  block.append(row);
  if (isNumber(held.before) || isNumber(held.after)) {
    const box = card(row, "Error on held-out data");
    if (dict(DIAGNOSIS.fit).metric) box.append(h("p", { class: "hint" }, String(DIAGNOSIS.fit.metric)));
    const path = (key) => ["fit", "held_out", key];
    bars(box, "Error on held-out data", [{ label: RIGHT ? "model" : "before", path: path("before"), style: RIGHT ? "after" : "before" }, { label: "corrected", path: path("after"), style: "after", low: path("low"), high: path("high") },
      { label: "floor", path: path("floor"), style: "floor", within: [path("low"), path("high")] }], { rule: path("floor") });
    if (isNumber(held.floor)) box.append(h("p", { class: "hint" }, `The floor is what a perfect model scores${isNumber(held.low) ? "; the whisker is the 95 % interval" : ""}.`));
  }
  if (isNumber(clearance.before_m) || isNumber(clearance.after_m)) {
    const box = card(row, `Clearance${clearance.joint ? ` in joint ${clearance.joint}` : ""}`);
    clearancePicture(box, clearance);
    if (list(profile.clearance_mm).length > 2) {
      const best = extent(list(profile.log_likelihood))[1];
      curves(box, { label: "Log-likelihood over the clearance", zoom: false, x: { label: "clearance", unit: "mm" }, panels: [{ label: "log-likelihood below its best", unit: "nats", height: 130,
        series: [{ name: "profile", label: "log-likelihood", style: "after", x: profile.clearance_mm, y: list(profile.log_likelihood).map((value) => (isNumber(value) ? value - best : null)) }] }] });
    }
  }
  impacts(row);
  comparison(block, series);
}

function clearancePicture(parent, clearance) {
  const mm = (key) => (isNumber(clearance[key]) ? clearance[key] * 1000 : null);
  const [before, after, low, high] = ["before_m", "after_m", "low_m", "high_m"].map(mm);
  const ends = extent([before, after, low, high]), pad = Math.max((ends[1] - ends[0]) * 0.22, ends[1] * 0.002, 1e-4);
  const shown = (value) => (low !== null && high !== null ? textWithin(value, low, high) : text(value, 4));
  figure(parent, `Clearance before ${text(before, 4)} mm, corrected ${text(after, 4)} mm`, (width) => {
    const left = Math.min(84, width * 0.26), x = axis([ends[0] - pad, ends[1] + pad], [left, width - 74], { count: 4 }), svg = canvas(width, 118);
    for (const value of x.ticks) svg.append(s("line", { class: "grid", x1: x(value), x2: x(value), y1: 6, y2: 84 }), s("text", { class: "tick", x: x(value), y: 100, "text-anchor": "middle" }, tickText(value, x.ticks)));
    svg.append(s("text", { class: "axis-label", x: width, y: 100, "text-anchor": "end" }, "[mm]"));
    [["before", before, "before_m", 26], ["corrected", after, "after_m", 62]].forEach(([name, value, key, y]) => {
      if (value === null) return;
      const style = name === "before" ? "before" : "after";
      svg.append(s("text", { class: "bar-label", x: left - 12, y: y + 5, "text-anchor": "end" }, name));
      if (style === "after" && low !== null && high !== null) svg.append(s("line", { class: "span after", x1: x(low), x2: x(high), y1: y, y2: y }));
      svg.append(s("circle", { class: `mark ${style}`, cx: x(value), cy: y, r: 6 }), s("text", { class: "bar-value", x: (style === "after" && high !== null ? Math.max(x(high), x(value)) : x(value)) + 12, y: y + 5, ...keyed(["clearance", key], { scale: 1000 }).attributes }, shown(value)));
    });
    return svg;
  });
}

function impacts(parent) {
  const found = dict(EVIDENCE.impacts);
  const kinds = [["recorded", "recorded"], ["before", "before"], ["after", "corrected"]].filter(([key]) => filled(found[key]));
  if (!kinds.length) return;
  const box = card(parent, "Impacts in the joint");
  const group = (key, label, unit) => {
    if (!kinds.some(([kind]) => isNumber(found[kind][key]))) return;
    box.append(h("p", { class: "small-head" }, unit ? `${label} [${unitText(unit)}]` : label));
    bars(box, label, kinds.map(([kind, name]) => ({ label: name, path: ["impacts", kind, key], style: kind })), { source: "evidence", unit });
  };
  group("per_revolution", "per revolution");
  group("median_strength", "median strength", found[kinds[0][0]].unit);
}

function comparison(block, series) {
  const views = [["time", "time"], ["turn", "one turn"], ["spectrum", "spectrum"]].filter(([key]) => series[key].length);
  if (!views.length) return;
  const box = card(block, "Model and recording, held out");
  const weight = (name) => dict(dict(DIAGNOSIS.mismatch).channels)[name] ?? 0; // the channel that shows it most comes first
  const channels = [...new Set(views.flatMap(([key]) => series[key].map((one) => String(one.channel))))].sort((a, b) => weight(b) - weight(a));
  let view = views[0][0], channel = 0;
  const stage = h("div", {});
  const controls = h("div", { class: "controls" }, views.length > 1 && choice("Show", views, view, (value) => { view = value; show(); }), picker("Channel", channels.map(words), (value) => { channel = value; show(); }));
  box.append(controls, stage);
  const hidden = new Set();
  const turnRanges = list(dict(DIAGNOSIS.mismatch).crank_angle_deg).flatMap(([from, to]) => [[from, to], [from - 360, to - 360], [from + 360, to + 360]]);
  function show() {
    stage.replaceChildren();
    const one = series[view].find((entry) => String(entry.channel) === channels[channel]);
    if (!one) { stage.append(h("p", { class: "hint" }, "Not available for this channel.")); return; }
    const x = list({ time: one.time_s, turn: one.angle_deg, spectrum: one.frequency_hz }[view]), log = view === "spectrum";
    const three = [RECORDED, BEFORE, AFTER].filter(({ name }) => list(one[name]).length).map((kind) => ({ ...kind, x, y: one[kind.name] }));
    const panels = [{ label: words(one.channel), unit: one.unit, log, height: 270, series: three }];
    if (!log && list(one.recorded).length) {
      const rest = three.filter(({ name }) => name !== "recorded").map((kind) => ({ ...kind, short: `recorded minus ${kind.label}`, y: kind.y.map((value, at) => (isNumber(value) && isNumber(one.recorded[at]) ? one.recorded[at] - value : null)) }));
      if (rest.length) panels.push({ label: "recorded minus model", unit: one.unit, height: 120, series: rest });
    }
    const axes = { time: { label: "time", unit: "s" }, turn: { label: "crank angle", unit: "°", ticks: degreeTicks }, spectrum: { label: "frequency", unit: "Hz", log: true } };
    curves(stage, { label: `${words(one.channel)}: recorded, model before and model corrected, ${views.find(([key]) => key === view)[1]}`, x: axes[view], panels, hidden,
      shade: { turn: turnRanges, spectrum: dict(DIAGNOSIS.mismatch).frequency_hz }[view], hover: view === "turn" ? (angle) => crank.turn(angle, "phase") : null });
  }
  show();
}

// ---- what else

function else_() {
  const groups = list(DIAGNOSIS.equivalent).map(list).filter((group) => group.length), next = DIAGNOSIS.next_experiment;
  if (!groups.length && !next && !list(DIAGNOSIS.effects).length) return;
  const block = section("else", "What else it could be");
  if (groups.length) {
    block.append(h("p", { class: "lead" }, "These explain the recordings equally well; these sensors cannot tell them apart:"));
    block.append(h("div", { class: "alternatives" }, join(groups.map((group) => h("span", { class: "alternative" }, group.map(words).join(" + "))), " or ").map((part) => (typeof part === "string" ? h("span", { class: "or" }, "or") : part))));
  } else if (list(DIAGNOSIS.effects).length) block.append(h("p", { class: "lead" }, "Nothing else that was tried explains these recordings as well."));
  if (next) block.append(h("div", { class: "next" }, h("h3", {}, groups.length ? "The recording that would tell" : "The next recording worth making"), h("p", {}, String(next))));
}

// ---- the curve

function freeForm() {
  const curve = dict(EVIDENCE.free_form_curve), free = dict(DIAGNOSIS.free_form), table = list(free.table);
  const measured = list(curve.x).length > 1;
  if (!measured && table.length < 2) return;
  const argument = measured ? curve.argument ?? free.argument : free.argument;
  const on = free.body ? ` It acts on the ${BODIES[free.body] ?? words(free.body)}${free.direction ? `, ${words(free.direction)}` : ""}.` : "";
  const block = section("curve", "The missing force as a curve", `No law is assumed: the force that explains the recordings, as a function of ${argument ? words(argument) : "one argument"}.${on}`);
  const box = card(block, null);
  const units = { x: curve.unit_x ?? { slider_position: "m", slider_velocity: "m/s", crank_angle: "°", crank_speed: "rad/s", contact_force: "N", time: "s" }[argument] ?? "", y: curve.unit_y ?? dict(EVIDENCE.missing_force).unit ?? "" };
  const line = measured ? { x: curve.x, y: list(curve.y), low: curve.low, high: curve.high } : { x: table.map((pair) => pair[0]), y: table.map((pair) => pair[1]) };
  curves(box, { label: `Free-form force over ${words(argument)}`, x: { label: words(argument) || "argument", unit: units.x }, panels: [{ label: /torque|moment/i.test(String(free.direction)) ? "missing torque" : "missing force", unit: units.y, height: 300, zero: true,
    points: curve.points, series: [{ name: "curve", label: "free-form force", style: "after", ...line }] }] });
  if (table.length) box.append(h("details", {}, h("summary", {}, `Table (${table.length} points)`), h("div", { class: "scroll short", tabindex: "0", role: "region", "aria-label": "Table of the force" }, h("table", {},
    h("thead", {}, h("tr", {}, h("th", { class: "right" }, `${words(argument)} [${unitText(units.x)}]`), h("th", { class: "right" }, `force [${unitText(units.y)}]`))),
    h("tbody", {}, table.map((_, index) => h("tr", {}, [0, 1].map((column) => h("td", { class: "right" }, number(["free_form", "table", index, column], { digits: 4 })))))))))); 
}

// ---- what could be seen

function detectable() {
  const map = dict(EVIDENCE.detectability), columns = list(map.columns), rows = list(map.rows);
  if (!columns.length || !rows.length) return;
  const block = section("seen", "What could be seen", "The smallest size of each effect that these sensors can show. Below it, an effect cannot be seen here, which is not the same as absent.");
  const box = card(block, null);
  const of = (index, key) => number(["detectability", "columns", index, key], { source: "evidence" });
  const label = (column, index) => [isNumber(column?.clearance_mm) && h("span", {}, of(index, "clearance_mm"), " mm"), isNumber(column?.speed_rpm) && h("span", {}, of(index, "speed_rpm"), " rpm"), column?.sensors && h("span", {}, words(Array.isArray(column.sensors) ? column.sensors.join(", ") : column.sensors))];
  box.append(h("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": "Detectability map" }, h("table", { class: "map" },
    h("thead", {}, h("tr", {}, h("th", {}, "Effect"), columns.map((column, index) => h("th", { class: "right" }, label(column, index))))),
    h("tbody", {}, rows.map((row, r) => {
      const sizes = list(row.smallest), known = sizes.filter((value) => isNumber(value) && value > 0), [low, high] = extent(known);
      const shade = (value) => (high > low * 1.05 ? Math.round(4 * (1 - Math.log(value / low) / Math.log(high / low))) : 2);
      return h("tr", {}, h("th", { scope: "row" }, title(row.effect), h("span", { class: "unit" }, `${words(row.parameter)}${unitText(row.unit) ? ` [${unitText(row.unit)}]` : ""}`)),
        columns.map((_, c) => (isNumber(sizes[c]) ? h("td", { class: `right d${shade(sizes[c])}` }, number(["detectability", "rows", r, "smallest", c], { source: "evidence", digits: 2 })) : h("td", { class: "right unseen" }, "not seen"))));
    })))));
  box.append(h("p", { class: "hint" }, "Stronger colour: smaller sizes can be seen, within each row."));
}

// ---- checks

function checks() {
  const found = dict(EVIDENCE.checks);
  if (!filled(found)) return;
  const block = section("checks", "Is the estimator itself healthy?", "If the model is right, what it fails to predict is white noise of the stated size.");
  const row = h("div", { class: "columns" });
  block.append(row);
  const nis = dict(found.normalised_innovation_squared);
  if (isNumber(nis.value)) {
    const fine = nis.value >= nis.low && nis.value <= nis.high;
    const box = card(row, "Size of the innovations");
    const path = (key) => ["checks", "normalised_innovation_squared", key], options = { source: "evidence", digits: 4 };
    box.append(h("p", { class: "big" }, number(path("value"), options), " ", isNumber(nis.low) && h("span", { class: `state ${fine ? "good" : "bad"}` }, fine ? "as expected" : "not as expected")),
      isNumber(nis.low) ? h("p", { class: "hint" }, "normalised innovation squared; a right model lies in ", number(path("low"), options), "–", number(path("high"), options)) : h("p", { class: "hint" }, "normalised innovation squared"));
  }
  if (isNumber(found.halving_the_step)) {
    const box = card(row, "Error of the solver");
    const fine = found.halving_the_step < 0.1;
    box.append(h("p", { class: "big" }, number(["checks", "halving_the_step"], { source: "evidence" }), h("small", {}, " σ "), h("span", { class: `state ${fine ? "good" : "bad"}` }, fine ? "negligible" : "too large")),
      h("p", { class: "hint" }, "change of a prediction when the step is halved; it belongs below 0.1 σ"));
  }
  const channels = list(found.channels), white = list(found.whiteness);
  if (channels.length && white.some(isNumber)) {
    const isP = found.whiteness_kind === "p_value", box = card(block, isP ? "Whiteness of the innovations, p-value" : "Whiteness of the innovations, autocorrelation at lag one");
    const spoken = channels.map((name, index) => `${words(name)} ${text(white[index], 2)}`).join(", ");
    figure(box, `Whiteness: ${spoken}`, (width) => {
      const left = Math.min(14 + 6.9 * Math.max(...channels.map((name) => Math.min(words(name).length, 22))), width * 0.45), tall = 22, svg = canvas(width, channels.length * tall + 26), most = Math.max(0.2, ...white.filter(isNumber).map(Math.abs)) * 1.1;
      const x = axis(isP ? [0, 1] : [-most, most], [left, width - 52], { count: Math.max(3, Math.floor(width / 140)) }), bottom = channels.length * tall;
      for (const value of x.ticks) svg.append(s("line", { class: "grid", x1: x(value), x2: x(value), y1: 0, y2: bottom }), s("text", { class: "tick", x: x(value), y: bottom + 17, "text-anchor": "middle" }, tickText(value, x.ticks)));
      svg.append(s("line", { class: "rule", x1: x(isP ? 0.05 : 0), x2: x(isP ? 0.05 : 0), y1: 0, y2: bottom }));
      channels.forEach((name, index) => {
        const y = index * tall + tall / 2;
        svg.append(s("text", { class: "row-label", x: left - 10, y: y + 4, "text-anchor": "end" }, cut(words(name), Math.min(22, Math.floor((left - 10) / 6.6)))));
        if (!isNumber(white[index])) return;
        svg.append(s("line", { class: "stem", x1: x(isP ? 0.05 : 0), x2: x(white[index]), y1: y, y2: y }), s("circle", { class: "mark after", cx: x(white[index]), cy: y, r: 4 }),
          s("text", { class: "tick", x: width, y: y + 4, "text-anchor": "end", ...keyed(["checks", "whiteness", index], { source: "evidence" }).attributes }, text(white[index], 2)));
      });
      return svg;
    });
    box.append(h("p", { class: "hint" }, isP ? "Left of the line at 0.05, a channel is not white." : "White innovations lie near zero."));
  }
  const lags = Object.entries(dict(found.autocorrelation)).filter(([, values]) => list(values).length > 1);
  if (lags.length) {
    const box = card(block, "Autocorrelation of the innovations");
    const stage = h("div", {});
    const show = (index) => {
      stage.replaceChildren();
      const [name, values] = lags[index];
      curves(stage, { label: `Autocorrelation of ${words(name)}`, zoom: false, x: { label: "lag in samples" }, panels: [{ label: words(name), height: 140, zero: true, rules: [],
        series: [{ name: "r", label: "autocorrelation", style: "after", x: values.map((_, at) => at), y: values }] }] });
    };
    if (lags.length > 1) box.append(h("div", { class: "controls" }, picker("Channel", lags.map(([name]) => words(name)), show)));
    box.append(stage);
    show(0);
  }
}

for (const [name, build] of [["head", head], ["where", where], ["what", what], ["how much better", better], ["what else", else_], ["curve", freeForm], ["what could be seen", detectable], ["checks", checks]]) attempt(name, build);
CONTENTS.append(h("a", { href: "#numbers" }, "The numbers"));
document.documentElement.setAttribute("data-drawn", "");
