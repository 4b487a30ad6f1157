// What these sensors could have shown at all: the smallest sizes by effect, sensor set, clearance and speed.

function detectable() {
  const map = dict(EVIDENCE.detectability), here = dict(map.here);
  const clearances = list(map.clearance_m), speeds = list(map.speed_rpm), sets = Object.keys(dict(map.sensor_sets));
  const effects = list(map.effects).map((effect, index) => ({ effect, index })).filter(({ effect }) => sets.some((name) => list(dict(effect?.size)[name]).length));
  const own = list(here.effects).filter((effect) => effect?.name !== undefined);
  const mapped = clearances.length > 0 && speeds.length > 0 && effects.length > 0;
  if (!mapped && !own.length) return;
  const block = section("seen", "What could be seen", "The smallest size of each effect that these sensors can show, nine times out of ten at a false alarm rate of 5 %. Beside a model that is otherwise right a diagnosis asserts from about 2.4 times that size, where neither chance nor another integrator's errors reach. What makes parts loose or elastic is looked for where it leaves a fifth more than noise: from that size on. What is smaller cannot be seen here, which is not the same as absent.");
  if (own.length) ownSizes(card(block, "In these recordings"), own);
  if (mapped) sizeMap(card(block, `Any recording of ${isNumber(map.seconds) ? `${text(map.seconds)} s` : "this length"}${isNumber(map.noise) ? ` at ${text(100 * map.noise)} % noise` : ""}`, "detectability"), map, here, effects, sets);
}

const unitOf = (one) => `${words(one.parameter)}${unitText(one.unit) ? ` [${unitText(one.unit)}]` : ""}`;
const unseen = () => h("td", { class: "right unseen" }, "cannot be seen here");

function ownSizes(box, effects) {
  box.append(h("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": "Smallest sizes that these recordings can show" }, h("table", { class: "sizes" },
    h("thead", {}, h("tr", {}, h("th", {}, "Effect"), h("th", { class: "right" }, "Smallest size seen"))),
    h("tbody", {}, effects.map((effect) => { const index = EVIDENCE.detectability.here.effects.indexOf(effect); return h("tr", {}, h("th", { scope: "row" }, title(effect.name), h("span", { class: "unit" }, unitOf(effect))),
      isNumber(effect.size) ? h("td", { class: "right" }, number(["detectability", "here", "effects", index, "size"], { source: "evidence", digits: 2 })) : unseen()); })))));
}

function sizeMap(box, map, here, effects, sets) {
  const first = Math.max(0, effects.findIndex(({ effect }) => effect.name === list(DIAGNOSIS.effects)[0]?.name));
  const present = sets.indexOf(here.sensors), ordered = present < 0 ? sets : [sets[present], ...sets.filter((_, index) => index !== present)];
  let chosen = first, sensors = ordered[0];
  const stage = h("div", {}), pick = picker("Effect", effects.map(({ effect }) => title(effect.name)), (index) => { chosen = index; show(); });
  pick.querySelector("select").value = first;
  box.append(h("div", { class: "controls" }, pick, picker("Sensors", ordered.map((name) => `${words(name)}${name === here.sensors ? " (these)" : ""}`), (index) => { sensors = ordered[index]; show(); })), stage);
  const closest = (values, value, measure) => (isNumber(value) ? values.reduce((best, one, index) => (measure(one, value) < measure(values[best], value) ? index : best), 0) : -1);
  const row = closest(map.clearance_m, here.clearance_m, (a, b) => Math.abs(Math.log(a / b))), column = closest(map.speed_rpm, here.speed_rpm, (a, b) => Math.abs(a - b));
  show();

  function show() {
    const { effect, index } = effects[chosen], sizes = list(effect.size[sensors]), below = effect.seen === "below";
    const [low, high] = extent(sizes.flat().filter((value) => value > 0));
    const rank = (value) => Math.log(value / low) / Math.log(high / low), shade = (value) => (high > low * 1.05 ? Math.round(4 * (below ? rank(value) : 1 - rank(value))) : 2);
    const isHere = (r, c) => r === row && c === column && sensors === here.sensors;
    const cell = (r, c) => {
      const value = list(sizes[r])[c], mark = isHere(r, c) ? { class: "here", "aria-label": "nearest to these recordings" } : {};
      if (!isNumber(value)) return fill(unseen(), isHere(r, c) ? { class: "right unseen here" } : {}, []);
      const end = value === effect.weakest ? `at ${below ? "least" : "most"} ` : "";
      return h("td", { ...mark, class: `right d${shade(value)} ${mark.class ?? ""}` }, end, number(["detectability", "effects", index, "size", sensors, r, c], { source: "evidence", digits: 2 }));
    };
    const shaped = list(effect.shape).map((one) => `, ${words(one.name)} ${text(one.value)}${unitText(one.unit) ? ` ${unitText(one.unit)}` : ""}`).join("");
    stage.replaceChildren(h("p", { class: "small-head" }, `${below ? "Highest" : "Smallest"} ${unitOf(effect)}${shaped}${effect.of === "sensor" ? ", in the sensor that shows it least" : ""}`),
      h("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": `${below ? "Highest" : "Smallest"} ${unitOf(effect)} of ${words(effect.name)}, by clearance and speed` }, h("table", { class: "map" },
        h("thead", {}, h("tr", {}, h("th", {}, "Clearance"), map.speed_rpm.map((_, c) => h("th", { class: "right" }, h("span", {}, number(["detectability", "speed_rpm", c], { source: "evidence" }), " rpm"))))),
        h("tbody", {}, map.clearance_m.map((_, r) => h("tr", {}, h("th", { scope: "row" }, number(["detectability", "clearance_m", r], { source: "evidence", scale: 1000 }), " mm"), map.speed_rpm.map((_, c) => cell(r, c))))))),
      h("p", { class: "hint" }, `${row >= 0 && sensors === here.sensors ? "Framed: nearest to these recordings. " : ""}Stronger colour: ${below ? "higher values" : "smaller sizes"} can be seen.${effect.of === "structure" ? "" : " Sizes fall with the root of a recording's length."}`));
    const framed = stage.querySelector(".here"), frame = stage.querySelector(".scroll"); // into view on a narrow page
    if (framed) frame.scrollLeft = Math.max(0, framed.offsetLeft + framed.offsetWidth - frame.clientWidth + 12);
  }
}
