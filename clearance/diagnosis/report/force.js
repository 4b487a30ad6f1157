// The force that the model lacks: over time with its band, or against where the machine was; and as a curve.

const AXES = {
  time: { key: "time_s", label: "time", short: "time", unit: "s" },
  angle: { key: "crank_angle_deg", label: "crank angle", short: "angle", unit: "°", ticks: degreeTicks },
  position: { key: "slider_position_m", label: "slider position", short: "position", unit: "m" },
  velocity: { key: "slider_velocity_m_s", label: "slider velocity", short: "velocity", unit: "m/s" },
};
const MOST_POINTS = 1200; // of a scatter; more only make it slow

const isTurning = (direction) => /torque|moment/i.test(String(direction));
const along = (direction) => (!direction || isTurning(direction) ? "" : ` along ${words(direction)}`);
const acting = (one) => `${isTurning(one.direction) ? words(one.direction) : "force"} on the ${BODIES[one.body] ?? words(one.body)}${along(one.direction)}`;

function missingForce(block) {
  const forces = list(EVIDENCE.missing_force).filter((one) => list(one?.time_s).length > 1 && list(one.value).length === one.time_s.length);
  if (!forces.length) return;
  const lead = RIGHT ? "Unknown force that would still help" : "What the model lacks";
  const box = card(block, `${lead}: ${acting(forces[0])}`, "missing-force");
  const heading = box.querySelector("h3"), stage = h("div", {}), controls = h("div", { class: "controls" });
  let force = forces[0], view = "time";
  const views = Object.keys(AXES).filter((name) => forces.some((one) => list(one[AXES[name].key]).length > 1));
  if (forces.length > 1) controls.append(picker("Where", forces.map((one) => [one.recording, acting(one)].filter(Boolean).join(": ")), (index) => { force = forces[index]; show(); }));
  if (views.length > 1) controls.append(choice("Against", views.map((name) => [name, AXES[name].short]), view, (value) => { view = value; show(); }));
  box.append(controls, stage);
  show();

  function show() {
    stage.replaceChildren();
    heading.textContent = `${lead}: ${acting(force)}`;
    const { key, ...x } = AXES[view], at = list(force[key]);
    if (at.length !== force.value.length) { stage.append(h("p", { class: "hint" }, "Not known here.")); return; }
    const panel = { label: isTurning(force.direction) ? `missing ${words(force.direction)}` : "missing force", unit: force.unit, height: 240, zero: true };
    const one = { name: "force", label: "estimate", style: "after" };
    if (view === "time") {
      panel.series = [{ ...one, x: at, y: force.value, low: force.low, high: force.high }];
      curves(stage, { label: `${acting(force)} over time with its 95 % band`, x, panels: [panel] });
      stage.append(h("p", { class: "hint" }, "Band: 95 % interval. Where it holds zero, nothing is seen to be missing."));
      return;
    }
    panel.points = scattered(at, force);
    panel.series = [{ ...one, label: "average", ...binned(at, force.value) }];
    curves(stage, { label: `${acting(force)} against ${x.label}`, x, panels: [panel], hover: view === "angle" ? (angle) => crank.turn(angle, "force") : null });
    stage.append(h("p", { class: "hint" }, "Points: estimates with their 95 % intervals. Line: their average."));
  }
}

function scattered(at, force) {
  const every = Math.ceil(at.length / MOST_POINTS), points = [];
  for (let index = 0; index < at.length; index += every) points.push([at[index], force.value[index], list(force.low)[index], list(force.high)[index]]);
  return points;
}

function binned(at, values, count = 36) {
  const [low, high] = extent(at), sums = Array.from({ length: count }, () => [0, 0, 0]);
  at.forEach((x, index) => {
    if (!isNumber(x) || !isNumber(values[index])) return;
    const bin = sums[clamp(Math.floor(((x - low) / (high - low || 1)) * count), 0, count - 1)];
    bin[0] += 1; bin[1] += x; bin[2] += values[index];
  });
  const full = sums.filter(([number]) => number > 0);
  return { x: full.map(([number, x]) => x / number), y: full.map(([number, , y]) => y / number) };
}

function freeForm() {
  const curve = filled(EVIDENCE.free_form) ? EVIDENCE.free_form : dict(DIAGNOSIS.free_form);
  const table = list(curve.table).filter((pair) => list(pair).length === 2);
  if (table.length < 2) return;
  const argument = curve.argument ? words(curve.argument) : "its argument";
  const unit = { x: curve.argument_unit ?? { slider_position: "m", slider_velocity: "m/s", crank_angle: "°", rod_angle: "rad", crank_speed: "rad/s", contact_force: "N", time: "s" }[curve.argument] ?? "", y: curve.unit ?? (isTurning(curve.direction) ? "N m" : "N") };
  const resists = unit.y === "N s/m"; // of what fills a gap: force over the journal's velocity
  const what = resists ? `damping in ${BODIES[curve.body] ?? words(curve.body)}` : acting(curve);
  const block = section("curve", "The missing force as a curve", `No law is assumed: the ${what} against ${argument}, as the recordings have it.`);
  const box = card(block, title(`${what} against ${argument}`));
  const banded = list(curve.low).length === table.length && list(curve.high).length === table.length;
  const [source, path] = filled(EVIDENCE.free_form) ? ["evidence", ["free_form"]] : ["diagnosis", ["free_form"]];
  const one = (...key) => number([...path, ...key], { source, digits: 4 });
  const held = (index) => !banded || isNumber(curve.low[index]);
  const known = table.map((_, index) => index).filter(held);
  if (known.length > 2) {
    curves(box, { label: `${what} against ${argument}${banded ? " with its 95 % band" : ""}`, x: { label: argument, unit: unit.x }, panels: [{ label: resists ? "damping" : isTurning(curve.direction) ? words(curve.direction) : "force", unit: unit.y, height: 300, zero: true,
      series: [{ name: "curve", label: "free-form force", style: "after", x: table.map((pair) => pair[0]), y: table.map((pair, index) => (held(index) ? pair[1] : null)), ...(banded ? { low: curve.low, high: curve.high } : {}) }] }] });
  } else {
    for (const index of known) box.append(h("p", {}, `At ${argument} `, one("table", index, 0), `${unitText(unit.x)}: `, h("b", {}, one("table", index, 1)), ` (`, one("low", index), "–", one("high", index), `) ${unitText(unit.y)}.`));
  }
  const gaps = known.length === table.length ? "" : " Elsewhere the recordings do not come, and the table says nothing.";
  if (banded) box.append(h("p", { class: "hint" }, `${known.length > 2 ? "Band" : "In brackets"}: 95 % interval.${gaps}`));
  const rivals = Object.keys(dict(dict(DIAGNOSIS.free_form).left_out));
  if (rivals.length > 1) box.append(h("p", { class: "hint" }, "Chosen by what is left where a part of the recordings is predicted by the others (1: noise alone). As a function of ",
    rivals.flatMap((name, index) => [`${index ? "; " : ""}${words(name)}: `, number(["free_form", "left_out", name], { source: "diagnosis", digits: 4 })]), "."));
  const cell = (...key) => h("td", { class: "right" }, one(...key));
  box.append(h("details", {}, h("summary", {}, `Table (${table.length} points)`), h("div", { class: "scroll short", tabindex: "0", role: "region", "aria-label": "Table of the force" }, h("table", {},
    h("thead", {}, h("tr", {}, [[argument, unit.x], ["value", unit.y], ...(banded ? [["low", unit.y], ["high", unit.y]] : [])].map(([name, of]) => h("th", { class: "right" }, unitText(of) ? `${name} [${unitText(of)}]` : name)))),
    h("tbody", {}, table.map((_, index) => h("tr", {}, cell("table", index, 0), cell("table", index, 1), banded && [cell("low", index), cell("high", index)])))))));
}
