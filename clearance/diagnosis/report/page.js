// The page from top to bottom: where, what, how much better, what else it could be, the curve, what could be seen, checks.

const SECTIONS = document.getElementById("sections");
const CONTENTS = document.getElementById("contents");

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

const RESTS = { "nearest models": "no 95 % interval; the nearest models' ", motion: "by the motion alone, ", "one recording": "by one recording, " }; // what the clearance's interval is where no model explains

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
    figures.push(["Error on held-out data", change(isNumber(held.before) && !RIGHT && number(["fit", "held_out", "before"]), isNumber(held.after) && number(["fit", "held_out", "after"], { within })),
      isNumber(held.floor) ? ["a perfect model scores ", number(["fit", "held_out", "floor"], { within })] : ""]);
  }
  if (isNumber(clearance.before_m) || isNumber(clearance.after_m)) {
    const limits = [clearance.low_m, clearance.high_m].map((value) => (isNumber(value) ? value * 1000 : null));
    const options = { scale: 1000, within: limits.every(isNumber) ? limits : null };
    figures.push([`Clearance${clearance.joint ? ` in joint ${clearance.joint}` : ""}`,
      [change(isNumber(clearance.before_m) && !RIGHT && number(["clearance", "before_m"], options), isNumber(clearance.after_m) && number(["clearance", "after_m"], options)), h("small", {}, "mm")],
      options.within ? [RESTS[clearance.basis] ?? "95 % interval ", number(["clearance", "low_m"], options), "–", number(["clearance", "high_m"], options), " mm"] : ""]);
  } else if (isNumber(clearance.high_m)) figures.push([`Clearance${clearance.joint ? ` in joint ${clearance.joint}` : ""}`, ["below ", number(["clearance", "high_m"], { scale: 1000 }), h("small", {}, "mm")], "the recordings show no more than this bound"]);
  if (isNumber(mismatch.p_value)) figures.push(["Chance of this if nothing were missing", number(["mismatch", "p_value"]), mismatch.detected !== false ? (mismatch.p_value * (mismatch.compared_with + 1) < 1.5 ? "no machine that lacks nothing looked like this" : mismatch.p_value <= 0.05 ? "seldom on machines that lack nothing" : "not unusual by itself") : mismatch.p_value <= 0.05 ? "too small a sign to be asserted" : "not unusual"]);
  document.getElementById("key-figures").append(...figures.map(([name, value, note]) => h("div", { class: "figure" }, h("div", { class: "name" }, name), h("div", { class: "value" }, value), h("div", { class: "note" }, note))));

  const speed = (value, path) => (Array.isArray(value) ? join(value.map((_, index) => number([...path, index])), "–") : number(path));
  if (recordings.length) document.getElementById("recording-table").append(h("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": "Recordings" }, h("table", {},
    h("thead", {}, h("tr", {}, ["Recording", "Fitted [s]", "Held out [s]", "Rate [Hz]", "Speed [rpm]", "Channels"].map((name, index) => h("th", { class: index > 0 && index < 5 ? "right" : "" }, name)))),
    h("tbody", {}, recordings.map((recording, index) => h("tr", {}, h("th", { scope: "row" }, String(recording?.name ?? "")),
      ["seconds", "held_out_seconds", "rate_hz", "speed_rpm"].map((key) => h("td", { class: "right" }, speed(recording?.[key], ["recordings", index, key]))),
      h("td", { class: "channels" }, list(recording?.channels).map(words).join(", "))))))));
}

// ---- where

const DIRECTIONS = { x: "x, to the right in the drawing", y: "y, upward in the drawing" };
const REGIMES = { contact: "while the joint is in contact", flight: "while the joint is in free flight", sliding: "while it slides", all: "in contact and in flight alike" };
const UNCONFIRMED = DIAGNOSIS.verdict === "unknown" && dict(DIAGNOSIS.mismatch).detected === false;

function where() {
  const mismatch = dict(DIAGNOSIS.mismatch), detected = mismatch.detected !== false && DIAGNOSIS.verdict !== "none";
  const block = section("where", "Where", detected ? null : UNCONFIRMED ? "In the recordings that were fitted nothing stands out from the noise." : "No channel, angle or frequency stands out from the noise.");
  const scene = h("div", { class: "scene" });
  block.append(scene);
  const stage = h("div", { class: "stage" });
  scene.append(stage);
  const facts = h("dl", { class: "facts" });
  const fact = (name, ...value) => facts.append(h("div", {}, h("dt", {}, name), h("dd", {}, ...value)));
  if (detected) {
    const sensors = faultyChannels();
    if (sensors.length) fact("Sensor", sensors.map(words).join(", "));
    else if (mismatch.body) fact("Body", BODIES[mismatch.body] ?? words(mismatch.body));
    if (mismatch.direction && !sensors.length && mismatch.body !== "instrument") fact("Direction", DIRECTIONS[mismatch.direction] ?? words(mismatch.direction));
    if (mismatch.regime) fact("When", REGIMES[mismatch.regime] ?? words(mismatch.regime));
    if (list(mismatch.crank_angle_deg).length) fact("Strongest at a crank angle of", ranges(["mismatch", "crank_angle_deg"], "°"));
    if (list(mismatch.frequency_hz).length) fact("Strongest at a frequency of", ranges(["mismatch", "frequency_hz"], "\u00a0Hz"));
    const weights = Object.entries(dict(mismatch.channels)).filter(([, weight]) => isNumber(weight)).sort((a, b) => b[1] - a[1]);
    const most = Math.max(...weights.map(([, weight]) => weight), 1e-12);
    if (weights.length) fact("Channels, by their share", h("ul", { class: "weights" }, weights.slice(0, 6).map(([name, weight]) => h("li", {}, h("span", {}, words(name)), " ", number(["mismatch", "channels", name], { digits: 2 }),
      s("svg", { viewBox: "0 0 100 4", preserveAspectRatio: "none", "aria-hidden": "true" }, s("rect", { class: "track", width: 100, height: 4, rx: 2 }), s("rect", { class: "bar culprit", width: (100 * weight) / most, height: 4, rx: 2 }))))));
  } else fact("Result", UNCONFIRMED ? "The model explains the recordings that were fitted to within their noise; what was held out could not be followed." : "The model explains the recordings to within their noise.");
  if (facts.children.length) scene.append(facts);
  mechanismDrawing(stage);
  if (filled(EVIDENCE.where)) {
    const box = card(block, EVIDENCE.where.title ?? "Error of one-millisecond predictions, in units of the expected noise");
    if (!heatMap(box, EVIDENCE.where)) box.remove();
  }
  missingForce(block);
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
      const box = card(row, `${title(effect.name)}${effect.channel ? ` of ${words(effect.channel)}` : ""}`, "effect");
      box.append(h("p", { class: "kind" }, words(effect.kind), !["prediction", undefined].includes(effect.basis) && `, by ${effect.basis === "motion" ? "the motion alone" : effect.basis}`, isNumber(effect.probability) && [", probability ", number(["effects", index, "probability"])]));
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
          isNumber(entry.p_value) && h("span", {}, "p ", number([...path, "p_value"], { source: "evidence", digits: 2 }))));
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

// ---- what else

function else_() {
  const whose = (names, i) => names.map((name, j) => [name, list(DIAGNOSIS.equivalent_channels)[i]?.[j]]);
  const groups = list(DIAGNOSIS.equivalent).map(list).map(whose).filter((group) => group.length), next = DIAGNOSIS.next_experiment;
  const followed = list(DIAGNOSIS.effects).some((effect) => ["prediction", "fitted recordings and motion", undefined].includes(effect.basis));
  if (!groups.length && !next && !followed) return;
  const block = section("else", "What else it could be");
  if (groups.length) {
    block.append(h("p", { class: "lead" }, "These explain the recordings equally well; these sensors cannot tell them apart:"));
    block.append(h("div", { class: "alternatives" }, join(groups.map((group) => h("span", { class: "alternative" }, group.map(([name, channel]) => words(name) + (channel ? ` of ${words(channel)}` : "")).join(" + "))), " or ").map((part) => (typeof part === "string" ? h("span", { class: "or" }, "or") : part))));
  } else if (followed) block.append(h("p", { class: "lead" }, "Nothing else that was tried explains these recordings as well."));
  if (next) block.append(h("div", { class: "next" }, h("h3", {}, groups.length ? "The recording that would tell" : "The next recording worth making"), h("p", {}, String(next)), experiments()));
}

function experiments() { // how many recordings tell the explanations apart, by what is changed
  const found = list(DIAGNOSIS.experiments);
  if (!found.some((one) => isNumber(one?.recordings))) return null;
  const change = (one) => (one.channel ? `${words(one.channel)} too` : one.other_speed ? "another speed" : "nothing");
  const row = (one, i) => h("tr", {}, h("th", { scope: "row" }, change(one)), h("td", { class: "right" }, number(["experiments", i, "speed_rpm"], { digits: 3 }), " rpm"), h("td", { class: "right" }, number(["experiments", i, "recordings"])));
  return h("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": "Recordings that would tell" }, h("table", { class: "sizes" },
    h("thead", {}, h("tr", {}, h("th", {}, "What is changed"), h("th", { class: "right" }, "Speed"), h("th", { class: "right" }, "Further recordings"))),
    h("tbody", {}, found.map(row))));
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
      isNumber(nis.low) ? h("p", { class: "hint" }, "normalised innovation squared, of the quieter nine tenths; a right model lies in ", number(path("low"), options), "–", number(path("high"), options)) : h("p", { class: "hint" }, "normalised innovation squared"));
  }
  const channels = list(found.channels), white = list(found.whiteness);
  if (channels.length && white.some(isNumber)) {
    const box = card(block, "Whiteness of the innovations, autocorrelation at lag one");
    const spoken = channels.map((name, index) => `${words(name)} ${text(white[index], 2)}`).join(", ");
    figure(box, `Whiteness: ${spoken}`, (width) => {
      const left = Math.min(14 + 6.9 * Math.max(...channels.map((name) => Math.min(words(name).length, 22))), width * 0.45), tall = 22, svg = canvas(width, channels.length * tall + 26), most = Math.max(0.2, ...white.filter(isNumber).map(Math.abs)) * 1.1;
      const x = axis([-most, most], [left, width - 52], { count: Math.max(3, Math.floor(width / 140)) }), bottom = channels.length * tall;
      for (const value of x.ticks) svg.append(s("line", { class: "grid", x1: x(value), x2: x(value), y1: 0, y2: bottom }), s("text", { class: "tick", x: x(value), y: bottom + 17, "text-anchor": "middle" }, tickText(value, x.ticks)));
      svg.append(s("line", { class: "rule", x1: x(0), x2: x(0), y1: 0, y2: bottom }));
      channels.forEach((name, index) => {
        const y = index * tall + tall / 2;
        svg.append(s("text", { class: "row-label", x: left - 10, y: y + 4, "text-anchor": "end" }, cut(words(name), Math.min(22, Math.floor((left - 10) / 6.6)))));
        if (!isNumber(white[index])) return;
        svg.append(s("line", { class: "stem", x1: x(0), x2: x(white[index]), y1: y, y2: y }), s("circle", { class: "mark after", cx: x(white[index]), cy: y, r: 4 }),
          s("text", { class: "tick", x: width, y: y + 4, "text-anchor": "end", ...keyed(["checks", "whiteness", index], { source: "evidence" }).attributes }, text(white[index], 2)));
      });
      return svg;
    });
    box.append(h("p", { class: "hint" }, "White innovations lie near zero."));
  }
  const lags = Object.entries(dict(found.autocorrelation)).filter(([, values]) => list(values).length > 1);
  if (lags.length) {
    const box = card(block, "Autocorrelation of the innovations");
    const stage = h("div", {});
    const show = (index) => {
      stage.replaceChildren();
      const [name, values] = lags[index];
      curves(stage, { label: `Autocorrelation of ${words(name)}`, zoom: false, x: { label: "lag in samples" }, panels: [{ label: words(name), height: 140, zero: true, rules: [],
        series: [{ name: "r", label: "autocorrelation", style: "after", x: values.map((_, at) => at + 1), y: values }] }] });
    };
    if (lags.length > 1) box.append(h("div", { class: "controls" }, picker("Channel", lags.map(([name]) => words(name)), show)));
    box.append(stage);
    show(0);
  }
}

for (const [name, build] of [["head", head], ["where", where], ["what", what], ["how much better", better], ["what else", else_], ["curve", freeForm], ["what could be seen", detectable], ["sensors", sensors], ["checks", checks]]) attempt(name, build);
CONTENTS.append(h("a", { href: "#numbers" }, "The numbers"));
document.documentElement.setAttribute("data-drawn", "");
