"use strict";
// Data, numbers as text, and small helpers that build elements. Text goes in as text nodes only, never as markup.

const read = (id) => JSON.parse(document.getElementById(id).textContent);
const SOURCES = { diagnosis: read("diagnosis"), evidence: read("evidence") };
const DIAGNOSIS = SOURCES.diagnosis, EVIDENCE = SOURCES.evidence;
const CALM = matchMedia("(prefers-reduced-motion: reduce)");

const RIGHT = DIAGNOSIS.verdict === "none"; // the model is right as it is
const BEFORE = { name: "before", label: "model before", style: "before" };
const AFTER = { name: "after", label: "model corrected", style: "after" };
const RECORDED = { name: "recorded", label: "recorded", style: "recorded" };

const BODIES = { crank: "crank", rod: "rod", slider: "slider", frame: "frame", joint_b: "joint B", joint_c: "joint C", instrument: "an instrument" };

window.addEventListener("error", (event) => { // a broken picture must not pass for a missing one
  document.documentElement.setAttribute("data-error", event.message);
});

function fill(element, attributes, children) {
  for (const [name, value] of Object.entries(attributes || {})) {
    if (value === null || value === undefined || value === false) continue;
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else element.setAttribute(name, value === true ? "" : value);
  }
  for (const child of children.flat(4)) if (child !== null && child !== undefined && child !== false) element.append(child);
  return element;
}
const h = (tag, attributes, ...children) => fill(document.createElement(tag), attributes, children);
const s = (tag, attributes, ...children) => fill(document.createElementNS("http://www.w3.org/2000/svg", tag), attributes, children);

const isNumber = (value) => typeof value === "number" && Number.isFinite(value);
const list = (value) => (Array.isArray(value) ? value : []);
const dict = (value) => (value && typeof value === "object" && !Array.isArray(value) ? value : {});
const filled = (value) => Object.keys(dict(value)).length > 0;
const clamp = (value, low, high) => Math.min(Math.max(value, low), high);
const words = (name) => String(name ?? "").replaceAll("_", " ");
const cut = (shown, most) => (shown.length > most ? `${shown.slice(0, Math.max(most - 1, 1))}…` : shown);
const title = (name) => words(name).replace(/^./, (first) => first.toUpperCase());
const unitText = (unit) => String(unit ?? "").replace(/\^2|\*\*2/g, "²").replace(/\^3/g, "³").replace(/^1$|^-$/, "");

function extent(values, start = [Infinity, -Infinity]) { // spread arguments would overflow the stack on long series
  let [low, high] = start;
  for (const value of values) if (isNumber(value)) { if (value < low) low = value; if (value > high) high = value; }
  return [low, high];
}

// ---- numbers as text

const SUPERSCRIPT = "⁰¹²³⁴⁵⁶⁷⁸⁹";
const grouped = (digits) => digits.replace(/^(-?\d{5,})/, (whole) => whole.replace(/\B(?=(\d{3})+$)/g, "\u202f"));

function scientific(value, digits) {
  const [mantissa, exponent] = value.toExponential(digits - 1).split("e");
  const power = [...String(Math.abs(Number(exponent)))].map((digit) => SUPERSCRIPT[digit]).join("");
  return `${mantissa.replace(/\.?0+$/, "").replace("-", "−")}\u202f×\u202f10${exponent[0] === "-" ? "⁻" : ""}${power}`;
}

function text(value, digits = 3) {
  if (!isNumber(value)) return "–";
  if (value === 0) return "0";
  const size = Math.abs(value);
  if (size >= 1e6 || size < 1e-4) return scientific(value, digits);
  const places = clamp(digits - 1 - Math.floor(Math.log10(size)), 0, 8);
  let shown = value.toFixed(places);
  if (shown.includes(".")) shown = shown.replace(/\.?0+$/, "");
  return grouped(shown).replace("-", "−");
}

function textWithin(value, low, high) { // as many digits as the interval is worth
  const half = (high - low) / 2;
  if (!isNumber(half) || !(half > 0)) return text(value, 4);
  const power = Math.floor(Math.log10(half) + 1e-9), places = -power + (half / 10 ** power < 2.95 ? 1 : 0);
  const size = Math.max(Math.abs(low), Math.abs(high), Math.abs(value));
  if (places > 6 || places < -5 || size >= 1e6) return text(value, clamp(2 + Math.floor(Math.log10(size / half)), 3, 6));
  return grouped(value.toFixed(Math.max(places, 0))).replace("-", "−");
}

function look(path, source = "diagnosis") {
  return path.reduce((value, key) => (value === null || value === undefined ? undefined : value[key]), SOURCES[source]);
}

// A number on the page says where in the embedded data it comes from: data-key, data-source, data-value, data-scale.
function keyed(path, { source = "diagnosis", scale = 1 } = {}) {
  const value = look(path, source);
  return {
    value: isNumber(value) ? value * scale : null,
    attributes: isNumber(value) ? { "data-key": path.join("."), "data-source": source, "data-value": value, "data-scale": scale } : {},
  };
}

function number(path, options = {}) {
  const { value, attributes } = keyed(path, options);
  const shown = options.within ? textWithin(value, ...options.within) : text(value, options.digits ?? 3);
  return h("span", { class: "number", ...attributes }, shown);
}

// "5.1 N (4.8–5.4)", from a path that holds value, low, high or from three keys.
function interval(path, { source = "diagnosis", scale = 1, unit = "", keys = ["value", "low", "high"] } = {}) {
  const [value, low, high] = keys.map((key) => look([...path, key], source));
  const options = { source, scale, within: isNumber(low) && isNumber(high) ? [low * scale, high * scale] : null };
  const one = (key) => number([...path, key], options);
  const tail = unitText(unit) ? `\u00a0${unitText(unit)}` : "";
  if (!isNumber(value)) return h("span", {}, "–");
  if (!options.within) return h("span", { class: "interval" }, one(keys[0]), tail);
  return h("span", { class: "interval" }, h("b", {}, one(keys[0]), tail), " ", h("span", { class: "range" }, "(", one(keys[1]), "–", one(keys[2]), ")"));
}

// ---- pieces of a page

function figure(parent, label, draw, { className = "", height = null } = {}) {
  const holder = h("div", { class: `picture ${className}` });
  parent.append(holder);
  let width = 0, frame = 0;
  const paint = () => {
    const now = Math.floor(holder.clientWidth);
    if (now < 40 || now === width) return;
    width = now;
    const svg = draw(width);
    svg.setAttribute("role", "img");
    svg.setAttribute("aria-label", label);
    holder.querySelector(":scope > svg")?.remove();
    holder.prepend(svg);
  };
  new ResizeObserver(() => { cancelAnimationFrame(frame); frame = requestAnimationFrame(paint); }).observe(holder);
  paint();
  return { holder, repaint: () => { width = 0; paint(); } };
}

const canvas = (width, height, ...children) =>
  s("svg", { viewBox: `0 0 ${width} ${height}`, width, height, class: "drawing" }, ...children);

function tip(holder) {
  const box = h("div", { class: "tip", role: "status", hidden: true });
  holder.append(box);
  return {
    show(x, y, ...content) {
      box.replaceChildren(...content);
      box.hidden = false;
      const width = holder.clientWidth;
      box.style.left = `${clamp(x + 14 + box.offsetWidth > width ? x - 14 - box.offsetWidth : x + 14, 0, Math.max(0, width - box.offsetWidth))}px`;
      box.style.top = `${Math.max(0, y - box.offsetHeight - 8)}px`;
    },
    hide() { box.hidden = true; },
  };
}

let choices = 0;
function choice(label, options, selected, change) {
  const name = `choice-${++choices}`;
  return h("fieldset", { class: "segments" }, h("legend", {}, label), options.map(([value, shown]) =>
    h("label", {}, h("input", { type: "radio", name, value, checked: value === selected, onchange: () => change(value) }), h("span", {}, shown))));
}

function picker(label, options, change) {
  return h("label", { class: "picker" }, h("span", {}, label),
    h("select", { onchange: (event) => change(Number(event.target.value)) }, options.map((option, index) => h("option", { value: index }, option))));
}

// One crank angle for the whole page: the drawing, the maps and the phase averages follow it.
const crank = {
  angle: 55, followers: [],
  follow(call) { this.followers.push(call); },
  turn(angle, from = null) { this.angle = ((angle % 360) + 360) % 360; for (const call of this.followers) call(this.angle, from); },
};
