// What the accelerometers were found to do, each within 1.5 times its tolerance.

const DEEDS = { gain: ["Gain", 1, ""], mounting_angle: ["Axis turned", 1, "°"], delay: ["Late by", 1e6, " µs"], bias: ["Offset", 1, " m/s²"] };

function sensors() {
  const found = dict(DIAGNOSIS.sensors), channels = Object.keys(found);
  if (!channels.length) return;
  const kinds = Object.keys(DEEDS).filter((kind) => channels.some((name) => isNumber(dict(found[name])[kind]?.value)));
  const block = section("sensors", "What the sensors do", "Within 1.5 times the tolerances that were given, each accelerometer was calibrated by the same fit. Delays count from the crank angle, or from the sensor that shows none." + (EVIDENCE.sensors_file ? " sensors.yaml holds these values for other recordings." : ""));
  const cell = (name, kind) => {
    const [, scale, unit] = DEEDS[kind], one = dict(found[name])[kind], path = ["sensors", name, kind];
    if (!isNumber(one?.value)) return h("td", { class: "right" }, "–");
    const options = { scale, within: isNumber(one.low) && isNumber(one.high) ? [one.low * scale, one.high * scale] : null };
    return h("td", { class: "right" }, number([...path, "value"], options), unit, options.within && h("span", { class: "unit nowrap" }, number([...path, "low"], options), " to ", number([...path, "high"], options)));
  };
  card(block, "").append(h("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": "What the sensors do" }, h("table", { class: "sizes" },
    h("thead", {}, h("tr", {}, h("th", {}, "Channel"), kinds.map((kind) => h("th", { class: "right" }, DEEDS[kind][0])))),
    h("tbody", {}, channels.map((name) => h("tr", {}, h("th", { scope: "row" }, words(name)), kinds.map((kind) => cell(name, kind))))))));
}
